"""A mechanism's closures read as equations φ(θ) = Σ_c B_c x_c(θ) + G θ + d in scalar coordinates.

x_c is the tip of a serial chain: a point, or a fixed direction (`ccpin.proof.chains`). Every closure row of ccpin is
linear in such tips:

- a product w e·(p_B − p_A) with e fixed in the ancestor C is two chains rooted at C, with weights w e and −w e;
- a product of a vector a fixed in frame A with one of frame B or with the gap is one chain rooted at frame A, which
  runs up to C through the joints of A reversed and down to frame B, with weight w a; likewise with A and B changed;
- a distance is kept by a rod (`rods`), whose angles are dependent coordinates behind the mechanism's own.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.closure_kinds import Fixed, Gap, Vector, plane_axes
from ccpin.domain.closures.rods import Rod, rod_length, rod_of
from ccpin.domain.closures.scalar_coordinates import Chart, Elementary, chart_at, elementary_joints, independent_indices
from ccpin.domain.closures.task_coordinates import TaskSpace
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.chains import Chain, ClosureSystem
from ccpin.proof.equations import BoundsName, Problem, problem_of


class Reading(NamedTuple):
    """A mechanism's closures, and how θ and its configurations q′ correspond.

    Attributes:
        problem: The closures with their bounds.
        chart: The scalar coordinates of q′.
        rods: The rods that keep distances; their angles come last in θ.
    """

    problem: Problem
    chart: Chart
    rods: tuple[Rod, ...]

    @property
    def system(self) -> ClosureSystem:
        """The closures."""
        return self.problem.system

    def bounded(self, bounds: BoundsName) -> Reading:
        """The same closures with other bounds.

        Raises:
            UnsupportedMechanismError: Planar bounds were asked for and the mechanism is not planar.
        """
        return self._replace(problem=problem_of(self.system, bounds))

    def theta(self, q_free: Array) -> Array:
        """θ of a configuration (nq,): the chart's, and where the rods point."""
        theta = self.chart.theta(q_free)
        return np.concatenate([theta, *(rod.angles(theta) for rod in self.rods)])

    def configuration(self, theta: Array) -> Array:
        """q′ of θ, over any leading axes: shape (…, n′) → (…, nq)."""
        return self.chart.configuration(theta)


def reading_of(mechanism: Mechanism, q_free: Array, task: TaskSpace | None = None) -> Reading:
    """The closures of a mechanism, in a chart centred at a configuration of shape (nq,).

    With a task space its coordinates, last in θ, are the independent ones and all of the mechanism's depend on them.

    Raises:
        UnsupportedMechanismError: φ holds redundant rows, a row is not of a form that can be bounded here, or an
            independent coordinate is not a scalar one.
    """
    constraints, chart = mechanism.constraints(), chart_at(mechanism, q_free)
    independent = independent_indices(mechanism, chart) if task is None else np.empty(0, dtype=np.intp)
    _refuse_redundant(mechanism, constraints)
    elementary, centre = elementary_joints(mechanism, chart), chart.theta(q_free)
    rods: dict[int, Rod] = {}
    for k, loop in enumerate(constraints.loops):
        if (length := rod_length(loop)) is not None:
            down = steps_along(elementary, loop.path_a), steps_along(elementary, loop.path_b)
            first = max((rod.place.stop for rod in rods.values()), default=chart.n_free)
            rods[k] = rod_of(loop, length, down, centre, first)
    angles = sum(rod.place.stop - rod.place.start for rod in rods.values())
    slides = [slides for joint in chart.joints for slides in joint.kind.slides] + angles * [False]
    loops, rows = constraints.loops, constraints.size + angles
    if task is not None:
        independent = len(slides) + np.arange(len(task.names))
        elementary.append(task.steps_from(len(slides)))
        loops, rows, slides = (*loops, task.loop), rows + task.loop.size, [*slides, *task.slides]
    builder = _ChainCollector(elementary, len(slides), rows)
    row = 0
    for k, loop in enumerate(loops):
        row = builder.add_rod(loop, rods[k], row) if k in rods else builder.add_loop(loop, row)
    builder.add_couplings(constraints, row)
    system = ClosureSystem(
        chains=tuple(builder.chains),
        couplings=builder.couplings,
        offset=builder.offset,
        moduli=builder.moduli,
        independent=independent,
        dependent=np.setdiff1d(np.arange(len(slides)), independent),
        periodic=~np.array(slides, dtype=np.bool_) & ~np.any(builder.couplings != 0.0, axis=0),
    )
    return Reading(problem_of(system), chart, tuple(rods.values()))


def _refuse_redundant(mechanism: Mechanism, constraints: Constraints) -> None:
    expected = mechanism.n_free - mechanism.n
    if constraints.size != expected:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: the closures have {constraints.size} rows of rank {expected}. A certificate about a "
            "choice of rows would say nothing of the rows left out (they agree at the configurations found, which "
            "proves nothing beyond them), so only closures without redundant rows are certified; replace the "
            "closure by one with fewer rows (a spherical instead of a revolute one, say) if that describes the "
            "mechanism as well"
        )


class _ChainCollector:
    """Collects chains and rows in the order of `Constraints`."""

    def __init__(self, elementary: list[list[Elementary]], n_free: int, rows: int) -> None:
        self.elementary = elementary
        self.rows = rows
        self.chains: list[Chain] = []
        self.couplings = np.zeros((rows, n_free))
        self.offset, self.moduli = np.zeros(rows), np.zeros(rows)

    def add_rod(self, loop: ResolvedClosure, rod: Rod, first: int) -> int:
        """The rows p_B − (the rod's end) = 0, without that along the normal of a plane; the next row's number."""
        axes = plane_axes(loop.normal)[: 2 if rod.planar else 3]
        weights = np.zeros((self.rows, 3))
        weights[first : first + len(axes)] = axes
        self.add_chain([*rod.path_b], rod.frame_b[:3, 3], False, weights)
        self.add_chain([*rod.path_a, *rod.steps()], rod.tip, False, -weights)
        return first + len(axes)

    def add_loop(self, loop: ResolvedClosure, first: int) -> int:
        """One loop's rows: products that share a root and a tip share a chain; the next row's number."""
        tips: dict[tuple[str, str, bytes], tuple[Array, Array]] = {}
        for k, row in enumerate(loop.rows.rows, start=first):
            for weight, left, right in row:
                root, other = (right, left) if isinstance(left, Gap) else (left, right)
                if isinstance(root, Gap):
                    raise UnsupportedMechanismError(
                        f"closure '{loop.closure.name}' ({loop.closure.kind}): a row with the gap squared that is no "
                        "plain distance is not bounded; describe what keeps it as a link on a universal joint, closed "
                        "by a spherical one"
                    )
                for sign, end, tip in _ends(loop, root, other):
                    key = (root.frame, end, tip.tobytes())
                    weights = tips.setdefault(key, (tip, np.zeros((self.rows, 3))))[1]
                    weights[k] += sign * weight * root.local
        paths = {"A": loop.path_a, "B": loop.path_b, "C": ()}
        down = {end: steps_along(self.elementary, path) for end, path in paths.items()}
        frames = {"A": loop.frame_a, "B": loop.frame_b, "C": np.eye(4)}
        for (start, end, _), (tip, weights) in tips.items():
            path = [] if start == end else [*_reversed(frames[start], down[start]), *down[end]]
            self.add_chain(path, tip[:3], not tip[3], weights)
        return first + loop.size

    def add_couplings(self, constraints: Constraints, row: int) -> None:
        for k, coupling in enumerate(constraints.couplings, start=row):
            self.moduli[k] = coupling.modulus
            for term in coupling.terms:
                if np.any(term.coefficients[2:]):
                    raise UnsupportedMechanismError(
                        f"coupling '{coupling.coupling.name}' is a polynomial of degree {len(term.coefficients) - 1}; "
                        "only linear couplings are certified"
                    )
                constant, ratio = [*term.coefficients, 0.0, 0.0][:2]
                self.couplings[k, term.idx_v] += ratio
                self.offset[k] += constant - ratio * term.reference

    def add_chain(
        self, path: list[Elementary] | list[Elementary | Array], tip: Array, direction: bool, weights: Array
    ) -> None:
        """Merge constant transforms, and fold what comes after the last joint into the tip."""
        before, joints = np.eye(4), []
        for step in path:
            if isinstance(step, Elementary):
                joints.append(step._replace(placement=before @ step.placement))
                before = np.eye(4)
            else:
                before = before @ step
        tip = before[:3, :3] @ tip + (0.0 if direction else 1.0) * before[:3, 3]
        if not joints:
            self.offset += weights @ tip
            return
        self.chains.append(chain_of(joints, tip, direction, weights))


def chain_of(path: list[Elementary], tip: Array, direction: bool, weights: Array) -> Chain:
    """A chain of elementary joints, root side first."""
    placements = np.array([joint.placement for joint in path])
    return Chain(
        joints=np.array([joint.position for joint in path], dtype=np.intp),
        rotations=placements[:, :3, :3],
        translations=placements[:, :3, 3],
        axes=np.array([joint.axis for joint in path]),
        prismatic=np.array([joint.prismatic for joint in path]),
        tip=tip,
        direction=direction,
        weights=weights,
    )


def steps_along(elementary: list[list[Elementary]], joints: Iterable[int]) -> list[Elementary]:
    """The elementary joints of joints one behind the other."""
    return [step for joint in joints for step in elementary[joint - 1]]


def _ends(loop: ResolvedClosure, root: Fixed, other: Vector) -> list[tuple[float, str, Array]]:
    """A vector seen from the frame of `root`: (sign, frame of the tip's carrier, homogeneous tip there) to be added."""
    frames = {"A": loop.frame_a, "B": loop.frame_b, "C": np.eye(4)}
    if isinstance(other, Fixed):
        return [(1.0, other.frame, np.append(frames[other.frame][:3, :3] @ other.local, 0.0))]
    return [(s, end, frames[end][:, 3]) for s, end in ((1.0, "B"), (-1.0, "A")) if end != root.frame]


def _reversed(frame: Array, path: list[Elementary]) -> list[Elementary | Array]:
    """The same joints walked from the tip's frame up to the root: inverse placements, opposite axes."""
    steps: list[Elementary | Array] = [np.asarray(np.linalg.inv(frame))]
    for joint in reversed(path):
        steps.append(Elementary(np.eye(4), -joint.axis, joint.prismatic, joint.position))
        steps.append(np.asarray(np.linalg.inv(joint.placement)))
    return steps


# From a mechanism and a configuration to the scalar coordinates that certificates are about.
