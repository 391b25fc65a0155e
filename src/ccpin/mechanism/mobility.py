"""Mobility: how many independent motions the loops leave, which of them are idle, and who should measure them.

n = n′ − rank φ_q′, the rank taken at several closed configurations, because at a single one it may be
accidentally low (a singular pose) and because redundant rows make φ's size say nothing.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.errors import IndependentSetError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import component_names
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.closing import close

_RANK_TOLERANCE = 1e-7
_SAMPLES = 6


class Mobility(NamedTuple):
    """What the constraints leave free.

    Attributes:
        n_free: n′, velocity components of the free system.
        rows: Number of constraint rows kept in φ.
        rank: Generic rank of φ_q′.
        mobility: n = n′ − rank.
        idle: Sentences naming mobilities that move nothing else, e.g. a rod free to spin about its axis.
        notes: How the independent set came about, where the author did not state it exactly.
    """

    n_free: int
    rows: int
    rank: int
    mobility: int
    idle: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def scaled_jacobian(constraints: Constraints, q_free: Array) -> Array:
    """φ_q′ with each row divided by its norm, so that rank is judged without units; rows of round-off stay small."""
    jacobian = constraints.value(q_free).jacobian
    norms = np.linalg.norm(jacobian, axis=1)
    reach = max(float(norms.max(initial=0.0)), 0.1)
    return np.asarray(jacobian / np.maximum(norms, 1e-6 * reach)[:, None])


def rank_at(constraints: Constraints, q_free: Array) -> int:
    """Numerical rank of φ_q′ at a configuration."""
    singular = np.linalg.svd(scaled_jacobian(constraints, q_free), compute_uv=False)
    return int(np.count_nonzero(singular > _RANK_TOLERANCE * max(float(singular.max(initial=0.0)), 1.0)))


def null_space(constraints: Constraints, q_free: Array, rank: int) -> Array:
    """An orthonormal basis of the velocities φ_q′ allows, of shape (n′, n′ − rank)."""
    n_free = constraints.model.nv
    if constraints.size == 0:
        return np.eye(n_free)
    vt = np.linalg.svd(scaled_jacobian(constraints, q_free), full_matrices=True)[2]
    return np.asarray(vt[rank:].T)


def sample_closed(constraints: Constraints, q_free: Array, count: int = _SAMPLES, stride: float = 0.3) -> list[Array]:
    """Closed configurations near one: deterministic random steps along the allowed velocities, closed again."""
    generator = np.random.default_rng(20002)
    samples, here = [q_free], q_free
    for _ in range(3 * count):
        if len(samples) > count:
            break
        basis = null_space(constraints, here, rank_at(constraints, here))
        if basis.shape[1] == 0:
            break
        direction = basis @ generator.standard_normal(basis.shape[1])
        step = stride * direction / np.linalg.norm(direction)
        attempt = close(constraints, pin.integrate(constraints.model, here, step))
        if attempt.closed and constraints.aligned(attempt.q_free):
            here = attempt.q_free
            samples.append(here)
    return samples


def generic_rank(constraints: Constraints, q_free: Array) -> tuple[int, list[Array]]:
    """The generic rank of φ_q′, and closed configurations that have it: `q_free` first if it does.

    Where the first samples' ranks differ, more are taken, further away.
    """
    samples = sample_closed(constraints, q_free)
    ranks = [rank_at(constraints, sample) for sample in samples]
    if ranks[0] < max(ranks):
        samples += sample_closed(constraints, samples[ranks.index(max(ranks))], count=24)[1:]
        ranks = [rank_at(constraints, sample) for sample in samples]
    rank = max(ranks)
    return rank, [sample for sample, r in zip(samples, ranks, strict=True) if r == rank]


def idle_motions(tree: Tree, constraints: Constraints, q_free: Array, basis: Array) -> list[str]:
    """Name the mobilities that move one body (or bodies welded by a closure) of a loop and nothing else."""
    model, data = tree.model, tree.model.createData()
    pin.computeJointJacobians(model, data, q_free)
    spatial = np.array(data.J)
    on_loop = {joint for loop in constraints.loops for joint in (*loop.path_a, *loop.path_b)}
    masses = {j: float(model.inertias[j].mass) for j in range(1, model.njoints)}
    heaviest = max([0.0, *masses.values()])
    heavy = [j for j, mass in masses.items() if mass > 1e-6 * heaviest]
    twists = {j: (spatial * tree.support(j)) @ basis for j in heavy}
    sentences = []
    for group in _welded_groups(constraints, heavy):
        if not on_loop & group:
            continue
        rest = [twists[j] for j in heavy if j not in group]
        allowed = _kernel(np.vstack(rest)) if rest else np.eye(basis.shape[1])
        if not allowed.shape[1]:
            continue
        twist = np.vstack([twists[j] for j in sorted(group) if j in twists]) @ allowed
        if np.abs(twist).max(initial=0.0) < 1e-9:
            continue
        sentences.append(_describe(tree, group, twist[:6, 0], allowed.shape[1]))
    return sentences


def _describe(tree: Tree, group: set[int], twist: Array, count: int) -> str:
    bodies = [name for name, place in tree.attachments.items() if place.joint in group]
    named = " with ".join(sorted(b for b in bodies if tree.model.inertias[tree.attachments[b].joint].mass > 0)[:2])
    linear, angular = twist[:3], twist[3:]
    turning = float(np.linalg.norm(angular))
    pitch = abs(linear @ angular)
    if count == 1 and turning > 1e-9 and pitch < 1e-6 * turning * max(float(np.linalg.norm(linear)), 1.0):
        axis = angular / turning
        point = np.cross(angular, linear) / turning**2
        return (
            f"{named} can spin about its axis: direction {_vector(axis)} through {_vector(point)} at the reference; "
            "it moves nothing else. Leave it independent, or lock one of its joints"
        )
    return f"{named} can move in {count} way{'s' if count > 1 else ''} without moving anything else"


def _vector(v: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in np.where(np.abs(v) < 5e-7, 0.0, v)) + ")"


def _welded_groups(constraints: Constraints, heavy: list[int]) -> list[set[int]]:
    groups = [{j} for j in heavy]
    for loop in constraints.loops:
        if loop.closure.kind == "fixed":
            touched = [g for g in groups if loop.joint_a in g or loop.joint_b in g]
            if len(touched) > 1:
                groups = [g for g in groups if g not in touched] + [set().union(*touched)]
    return groups


def _kernel(matrix: Array) -> Array:
    _, s, vt = np.linalg.svd(matrix, full_matrices=True)
    rank = int(np.count_nonzero(s > 1e-8 * max(float(s.max(initial=0.0)), 1.0)))
    return np.asarray(vt[rank:].T)


def conditioning(constraints: Constraints, q_free: Array, rank: int) -> float:
    """The smallest singular value of the scaled φ_q′ that counts towards its rank, relative to the largest."""
    singular = np.linalg.svd(scaled_jacobian(constraints, q_free), compute_uv=False)
    return float(singular[rank - 1] / singular[0]) if rank else 1.0


def independence(tree: Tree, basis: Array, wanted: list[str]) -> float:
    """How well the wanted joints measure the motions of a null-space basis, in [0, 1].

    It is the smallest nonzero singular value of their rows of the basis (1 where none are wanted).
    """
    names = component_names(tree)
    rows = [basis[names.index(name)] for name in components_of(names, tuple(wanted)) if name in names]
    if not rows or not basis.shape[1]:
        return 1.0
    singular = np.linalg.svd(np.array(rows), compute_uv=False)
    return float(singular[min(len(singular), basis.shape[1]) - 1])


def complete_independent(
    tree: Tree, basis: Array, required: tuple[str, ...], preferred: tuple[str, ...], count: int
) -> tuple[str, ...]:
    """Extend `required` to `count` components whose velocities fix the motion best.

    Components are taken one by one, each the one whose row of the null-space basis (n′, n) at the reference is largest
    in the part the earlier ones leave undetermined; `preferred` ones (motors, say) win unless they are a hundred times
    worse. Whole multi-dof joints are named as such where all their components are chosen.

    Raises:
        IndependentSetError: Components of `required` depend on one another.
    """
    names = component_names(tree)
    rows = {name: basis[i] for i, name in enumerate(names)}
    remaining = np.eye(basis.shape[1])
    chosen: list[str] = []
    for name in components_of(names, required):
        row = rows[name] @ remaining
        length = float(np.linalg.norm(row))
        if length < 1e-7:
            raise IndependentSetError(
                f"'{name}' cannot be independent: at the reference configuration its motion is fixed by "
                f"{', '.join(chosen) or 'the loops alone'}"
            )
        remaining = remaining - np.outer(remaining @ row, row) / length**2
        chosen.append(name)
    favoured = set(components_of(names, preferred))
    while len(chosen) < count:
        lengths = {n: float(np.linalg.norm(rows[n] @ remaining)) for n in names if n not in chosen}
        best = max(lengths, key=lambda n: lengths[n] * (100.0 if n in favoured else 1.0))
        row = rows[best] @ remaining
        remaining = remaining - np.outer(remaining @ row, row) / float(row @ row)
        chosen.append(best)
    return _merge(names, chosen)


def components_of(names: list[str], joints: tuple[str, ...]) -> list[str]:
    """The velocity components, as named in `names`, that joints or components stand for."""
    result = []
    for joint in joints:
        result += [joint] if joint in names else [n for n in names if n.startswith(f"{joint}:")]
    return result


def _merge(names: list[str], chosen: list[str]) -> tuple[str, ...]:
    """Name a joint instead of its components where all are chosen."""
    merged: list[str] = []
    for name in chosen:
        joint, _, component = name.partition(":")
        every = [n for n in names if n.startswith(f"{joint}:")]
        if component and all(n in chosen for n in every):
            name = joint
        if name not in merged:
            merged.append(name)
    return tuple(merged)
