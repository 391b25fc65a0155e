"""Closures as plain arrays: φ(θ) = Σ_c B_c x_c(θ) + G θ + d, ready to be evaluated over many boxes at once.

x_c is the tip of a serial chain: a point, or a fixed direction. Every closure row of ccpin is linear in such tips:

- a product w e·(p_B − p_A) with e fixed in the ancestor C is two chains rooted at C, with weights w e and −w e;
- a product of a vector a fixed in frame A with one of frame B or with the gap is one chain rooted at frame A, which
  runs up to C through the joints of A reversed and down to frame B, with weight w a; likewise with A and B changed;
- a distance is kept by a rod (`rods`), whose angles are dependent coordinates behind the mechanism's own.

The derivatives of a tip follow from its joints in the order root to tip, with axes a, origins o and
b = a × (x − o) for a revolute joint of a point chain, a × x of a direction chain, a for a prismatic joint of a
point chain, 0 of a direction chain: for joints j₁ ≤ … ≤ j_k along the chain

    ∂ᵏx/∂θ_{j₁}…∂θ_{j_k} = a_{j₁} × (… × (a_{j_{k−1}} × b_{j_k})),

zero if any but the deepest, j_k, is prismatic (moving along a fixed axis turns nothing), or if a prismatic j_k
is repeated.

Nothing here refers to Pinocchio: a `ClosureSystem` is picklable and is what worker processes receive.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Indices, Mask, numbers
from ccpin.description.closure_kinds import Fixed, Gap, Vector, plane_axes
from ccpin.domain.chart import Chart, Elementary, chart_at, elementary_joints, independent_indices
from ccpin.domain.rods import Rod, rod_length, rod_of
from ccpin.domain.task_space import TaskSpace
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.rounding import UNIT_ROUNDOFF


class Chain(NamedTuple):
    """One chain of k joints, root to tip.

    Attributes:
        joints: Indices in θ, of shape (k,), each once.
        rotations, translations: Frame of a joint before it moves, in the frame of the one above after it has
            moved (the root's for the first), of shapes (k, 3, 3) and (k, 3).
        axes: Unit axes in the joint's own frame, of shape (k, 3).
        prismatic: Whether a joint slides, of shape (k,).
        tip: The tip in the last joint's frame (m, or unit direction), of shape (3,).
        direction: Whether the tip is a direction.
        weights: B_c, of shape (m, 3), in root axes.
    """

    joints: Indices
    rotations: Array
    translations: Array
    axes: Array
    prismatic: Mask
    tip: Array
    direction: bool
    weights: Array


@dataclass(frozen=True, eq=False)
class ClosureSystem:
    """The closures of a mechanism in scalar coordinates θ (n′,), of which n are independent and m = n′ − n depend.

    Attributes:
        chains: The chains c.
        couplings: G, of shape (m, n′): linear couplings.
        offset: d, of shape (m,).
        moduli: Of shape (m,): a coupling of continuous joints holds modulo this angle (0: exactly).
        independent, dependent: Indices in θ, of shapes (n,) and (m,).
        periodic: Whether θ + 2π e_j means the same configuration and the same closures, of shape (n′,).
        chart: How θ and q′ correspond.
        rods: The rods that keep distances; their angles come last in θ.
    """

    chains: tuple[Chain, ...]
    couplings: Array
    offset: Array
    moduli: Array
    independent: Indices
    dependent: Indices
    periodic: Mask
    chart: Chart
    rods: tuple[Rod, ...]

    @property
    def n(self) -> int:
        """Number of independent coordinates."""
        return len(self.independent)

    @property
    def m(self) -> int:
        """Number of dependent coordinates and of closure rows."""
        return len(self.dependent)

    @property
    def n_free(self) -> int:
        """The size of θ: n′, and the angles of rods."""
        return int(self.couplings.shape[1])

    def theta(self, q_free: Array) -> Array:
        """θ of a configuration (nq,): the chart's, and where the rods point."""
        theta = self.chart.theta(q_free)
        return np.concatenate([theta, *(rod.angles(theta) for rod in self.rods)])

    @cached_property
    def scale(self) -> float:
        """An upper bound of every length that enters φ apart from slides, for rounding margins, at least 1 (m).

        It is the sum of all link lengths, directions and offsets with their weights.
        """
        scale = 1.0 + float(np.abs(self.offset).sum() + np.abs(self.couplings).sum())
        for chain in self.chains:
            length = np.linalg.norm(chain.translations, axis=1).sum() + np.linalg.norm(chain.tip)
            scale += float(length) * _largest_row(chain)
        return scale

    @property
    def depth(self) -> int:
        """The largest number of joints in a chain."""
        return max((len(chain.joints) for chain in self.chains), default=0)

    @property
    def rounding(self) -> float:
        """γ: |computed − exact| ≤ γ · `magnitude` for every entry of φ, its Jacobian and its second derivative.

        Each joint costs a 3×3 product, one sine and one cosine: fewer than 40 roundings of quantities at most 1
        or the reach; 64u a joint (and as much again for placements that are orthogonal to rounding only) is ample.
        Products of the bounds with n′×n′ matrices add 4u a column.
        """
        return (128.0 * (self.depth + 2) + 4.0 * self.n_free) * UNIT_ROUNDOFF

    def magnitude(self, theta: Array) -> Array:
        """An upper bound of every length in φ at θ (B, n′): `scale` and the slides, of shape (B,).

        Beyond 4 rad it grows with the angles: planar bounds add them up, with the roundings of so large numbers.
        """
        total = np.full(len(theta), self.scale)
        for chain in self.chains:
            if np.any(chain.prismatic):
                slides = np.abs(theta[:, chain.joints[chain.prismatic]]).sum(axis=1)
                total += slides * _largest_row(chain)
        return np.asarray(total * np.maximum(1.0, 0.25 * np.abs(theta).max(axis=1)))


def closure_system(mechanism: Mechanism, q_free: Array, task: TaskSpace | None = None) -> ClosureSystem:
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
    return ClosureSystem(
        chains=tuple(builder.chains),
        couplings=builder.couplings,
        offset=builder.offset,
        moduli=builder.moduli,
        independent=independent,
        dependent=np.setdiff1d(np.arange(len(slides)), independent),
        periodic=~np.array(slides, dtype=np.bool_) & ~np.any(builder.couplings != 0.0, axis=0),
        chart=chart,
        rods=tuple(rods.values()),
    )


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


def _largest_row(chain: Chain) -> float:
    """The length of the largest row of B_c, at least 1."""
    return float(np.linalg.norm(chain.weights, axis=1).max(initial=1.0))


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


class Seed(NamedTuple):
    """A closed configuration θ (n′,) in a chart centred at it, and the closures in that chart."""

    system: ClosureSystem
    theta: Array


def checked_configuration(mechanism: Mechanism, q_free: ArrayLike) -> Array:
    """A copy of q′ as a vector of shape (nq,).

    Raises:
        InvalidInputError: It is not that many finite numbers.
    """
    vector = numbers(q_free, "q_free").copy()
    if vector.shape != (mechanism.nq,) or not np.all(np.isfinite(vector)):
        raise InvalidInputError(
            f"q_free must be {mechanism.nq} finite numbers, a configuration of {mechanism.name}; "
            f"it has shape {vector.shape}"
        )
    return vector


def seed_at_configuration(mechanism: Mechanism | HasMechanism, q_free: Array) -> Seed:
    """Close a configuration of shape (nq,) at its own independent coordinates, and centre the chart there.

    Raises:
        InvalidInputError: Its shape is wrong, or it cannot be closed.
        SingularConfigurationError: It is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    mechanism = mechanism_of(mechanism)
    q_free = checked_configuration(mechanism, q_free)
    parametrization = mechanism.parametrization()
    closed = parametrization.sigma(parametrization.coordinates.alpha(q_free), guess=q_free).q_free
    system = closure_system(mechanism, closed)
    return Seed(system, system.theta(closed))


def scalar_coordinates_at(mechanism: Mechanism | HasMechanism, q_free: Array) -> Array:
    """q in the scalar coordinates of certificates, of shape (n,): a continuous joint's is its angle.

    Raises:
        InvalidInputError, SingularConfigurationError, UnsupportedMechanismError: As for `seed_at_configuration`.
    """
    seed = seed_at_configuration(mechanism, q_free)
    return np.array(seed.theta[seed.system.independent])


def seed_at_coordinates(mechanism: Mechanism, q0: ArrayLike, guess: ArrayLike | None = None) -> Seed:
    """σ(q₀) on the branch of `guess` (default the reference), q₀ (n,) in scalar coordinates.

    A continuous joint's coordinate is its angle here, a planar joint's are x, y and the angle.

    Raises:
        InvalidInputError: q₀ has the wrong shape.
        UnreachableError, SingularConfigurationError: σ(q₀) does not exist on that branch, or is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    if not mechanism.n:
        raise UnsupportedMechanismError(f"{mechanism.name} has mobility 0: there are no coordinates to certify")
    start = mechanism.q_reference if guess is None else checked_configuration(mechanism, guess)
    system = closure_system(mechanism, start)
    q0 = numbers(q0, "q")
    if q0.shape != (system.n,) or not np.all(np.isfinite(q0)):
        names = ", ".join(mechanism.independent)
        raise InvalidInputError(
            f"q must be {system.n} finite numbers, the scalar coordinates of {names}; it has shape {q0.shape}"
        )
    theta = system.chart.theta(start)
    theta[system.independent] = q0
    parametrization = mechanism.parametrization()
    q = parametrization.coordinates.alpha(system.chart.configuration(theta))
    closed = parametrization.sigma(q, guess=start).q_free
    system = closure_system(mechanism, closed)
    theta = system.theta(closed)
    theta[system.independent] = q0
    return Seed(system, theta)
