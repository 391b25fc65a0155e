"""Assembly modes next to a stated pose that does not close: the file has not said which of them is meant.

A stated pose q′₀ that is open is moved to close it. At the q found, every branch of σ that a few starts lead to is
another way to close the loops: q′₀ with q put in, and q′₀ passed and left behind as far again, q′₀ ⊕ (q′₀ ⊖ q′), where
q′ is the reference; a branch that mirrors the reference at q′₀ lies there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.parametrization import Parametrization
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.poses.loop_closing import solve
from ccpin.mechanism.poses.pose_search import within_limits
from ccpin.mechanism.poses.same_pose import Likeness

_SEED = 20005  # any: the same starts each time
_SPREAD = 1.0  # rad or m: of the starts about the stated pose
_MOST_STARTS = 24  # over all clusters: bounds what loading takes
_EACH = 6  # starts of one cluster, at most
_LARGEST = 60  # velocities: larger clusters are left out, as one start of theirs takes long
_OPEN = 1e-6  # m or rad: a stated pose that is open by less is closed
_REGULAR = 1e-6  # rcond of ψ_q′, above which a pose is nonsingular and on a branch


class Settlement(NamedTuple):
    """A cluster closed: its tree, φ, the stated pose and the reference, of shape (nq,) each."""

    tree: Tree
    constraints: Constraints
    stated: Array
    reference: Array


def told(clusters: Sequence[Settlement], independent: Sequence[str]) -> list[str]:
    """A sentence naming the other branches met, by the joint that tells each from the reference.

    At most `_MOST_STARTS` starts are tried in all, in clusters of up to `_LARGEST` velocities whose stated pose is
    open.

    Args:
        clusters: The clusters, each closed.
        independent: The independent joints and components.
    """
    open_ones = [
        cluster
        for cluster in clusters
        if cluster.tree.model.nv <= _LARGEST
        and np.abs(cluster.constraints.residual(cluster.stated)).max(initial=0.0) > _OPEN
    ]
    named = list[str]()
    for cluster in open_ones[:_MOST_STARTS]:
        names = tuple(name for name in independent if cluster.tree.split(name)[0] in cluster.tree.names)
        count = min(_EACH, max(1, _MOST_STARTS // len(open_ones)))
        named += _choices(cluster, others(cluster, names, count))
    if not named:
        return []
    more = f" (and {len(named) - 3} more)" if len(named) > 3 else ""
    return [
        "the stated pose is open, and at the reference's q the loops close in other ways too: "
        f"{'; '.join(named[:3])}{more}; load(reference={{…}}) or --reference chooses the assembly mode"
    ]


def others(cluster: Settlement, independent: tuple[str, ...], count: int) -> list[Array]:
    """Closed configurations over the reference's q on other branches of σ, inside the joint limits, from few starts."""
    model, constraints = cluster.tree.model, cluster.constraints
    coordinates = IndependentCoordinates(cluster.tree, independent, cluster.reference)
    parametrization = Parametrization(constraints, coordinates, cluster.reference)
    q = coordinates.alpha(cluster.reference)
    equations, likeness = parametrization.equations(q), Likeness(cluster.tree, constraints)
    known, found = [likeness.poses(cluster.reference)], list[Array]()
    for start in _starts(cluster, count):
        attempt = solve(model, equations, coordinates.embed(q, start))
        if not (attempt.closed and constraints.aligned(attempt.q_free) and within_limits(model, attempt.q_free)):
            continue
        poses = likeness.poses(attempt.q_free)
        new = not any(likeness.alike(poses, other) for other in known)
        if new and parametrization.rcond(attempt.q_free) > _REGULAR:
            known.append(poses)
            found.append(attempt.q_free)
    return found


def _starts(cluster: Settlement, count: int) -> Iterable[Array]:
    """The reference mirrored at the stated pose first, then the stated pose and poses spread about it."""
    model, generator = cluster.tree.model, np.random.default_rng(_SEED)
    back = pin.difference(model, cluster.reference, cluster.stated)
    yield np.asarray(pin.integrate(model, cluster.stated, back))
    for k in range(count - 1):
        yield np.asarray(
            pin.integrate(model, cluster.stated, min(k, 1) * _SPREAD * generator.standard_normal(model.nv))
        )


def _choices(cluster: Settlement, branches: Sequence[Array]) -> list[str]:
    """Each branch by the joint with one displacement that is farthest from the reference's."""
    named = []
    for q_free in branches:
        moves = []
        for joint in (joint for joint in cluster.tree.joints if joint.kind.nv == 1):
            here, there = (float(joint.kind.theta(q[joint.q], np.eye(3))[0]) for q in (cluster.reference, q_free))
            move = there - here if joint.kind.sliding else math.remainder(there - here, 2.0 * math.pi)
            unit = "m" if joint.kind.sliding else "rad"
            moves.append((abs(move), f"{joint.name} = {here + move:.4g} in place of {here:.4g} {unit}"))
        named += [max(moves)[1]] if moves else []
    return named
