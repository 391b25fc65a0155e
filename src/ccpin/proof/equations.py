"""The equations φ(θ) = 0 of closures, as the kernel sees them: values, two derivatives, bounds over boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ccpin.arrays import Array, Indices, choice, cross
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.bounds import Bounds, Frame
from ccpin.proof.chains import Chain, ChainStack, ClosureSystem, gather, stack_chains
from ccpin.proof.digests import digest
from ccpin.proof.facts import known, require, sealed
from ccpin.proof.phasors import Phasors, phasor_values, phasors_of, planar_bounds
from ccpin.proof.reach_bounds import ChainLengths, ReachDrift, chain_reach
from ccpin.proof.taylor import Pattern, Point, taylor_bounds
from ccpin.proof.tips import Rows, Turns, by_joint, crossed, moved, positions, sweep, turns_of

BoundsName = Literal["auto", "reach", "planar"]


class Requirements(NamedTuple):
    """What boxes are to meet besides Theorem N (`ccpin.proof.requirements`).

    Attributes:
        lower, upper: Limits of θ, of shape (n′,) each, ±∞ where there is none.
        driven: Indices in θ of the coordinates that motors drive; none: they are not looked at.
        units: What a unit of each parameter counts as where dexterity is measured: 1, or a length for turns, (n,).
        dexterity: The least 1/κ; 0: that the motors determine the motion is all that is asked.
    """

    lower: Array
    upper: Array
    driven: Indices
    units: Array
    dexterity: float


class Problem(NamedTuple):
    """What is to be proved, picklable.

    Attributes:
        system: The closures.
        stack: Their chains side by side.
        phasors: Their phasor form, where planar bounds are used.
        requirements: What is asked besides, if anything.
    """

    system: ClosureSystem
    stack: ChainStack
    phasors: Phasors | None
    requirements: Requirements | None = None


def problem_of(system: ClosureSystem, bounds: BoundsName = "auto") -> Problem:
    """Choose the bounds: planar where every chain is planar (``"auto"``), or as told.

    Raises:
        UnsupportedMechanismError: Planar bounds were asked for and the mechanism is not planar.
    """
    choice(bounds, "bounds", ("auto", "reach", "planar"))
    phasors = None if bounds == "reach" else phasors_of(system)
    if bounds == "planar" and phasors is None:
        raise UnsupportedMechanismError(
            "planar bounds need closures whose turning axes are parallel, with slides before the turns; "
            'use bounds="reach"'
        )
    return Problem(system, stack_chains(system.chains, system.n_free, system.m), phasors)


_ORTHONORMAL = 1e-12
"""How far placements and axes may be from orthonormal: a chain of a hundred such joints stays within the slack."""


@known
@dataclass(frozen=True, eq=False)
class Closures:
    """φ(θ) = Σ_c B_c x_c(θ) + Gθ + d = 0 in N = n + m scalar coordinates.

    Attributes:
        system: Its numbers, in copies that cannot be written to.
        planar: Whether bounds are to be those of phasors, where they prove anything.
    """

    system: ClosureSystem
    planar: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "system", _copied(self.system))
        _require_sound(self.system)

    def __reduce__(self) -> tuple[type[Closures], tuple[Any, ...]]:
        return Closures, (self.system, self.planar)

    @property
    def sizes(self) -> Mapping[str, int]:
        """N unknowns, M rows, P independent coordinates."""
        return {"N": self.system.n_free, "M": self.system.m, "P": self.system.n}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all that φ is made of, and of which coordinates are independent."""
        s = self.system
        return digest((s.chains, s.couplings, s.offset, s.moduli, s.independent, s.dependent, s.periodic))

    @cached_property
    def phasors(self) -> Phasors | None:
        """The phasor form, where it is asked for and there is one."""
        return phasors_of(self.system) if self.planar else None

    @cached_property
    def problem(self) -> Problem:
        """What is to be proved of them, nothing besides."""
        return Problem(self.system, self.stack, self.phasors)

    @cached_property
    def stack(self) -> ChainStack:
        """The chains side by side."""
        return stack_chains(self.system.chains, self.system.n_free, self.system.m)

    @cached_property
    def turns(self) -> Turns:
        """The constants of a sweep."""
        return turns_of(self.stack)

    @cached_property
    def _lengths(self) -> ChainLengths:
        return ChainLengths.of(self.stack)

    @cached_property
    def _sums(self) -> _Sums:
        return _sums_of(self.system, self.stack.joints.shape[1])

    def rounding(self, theta: Array) -> Array:
        """What every entry of φ and its first two derivatives is within of the exact one, at |θ| (B, N) at most."""
        return self.system.rounding * self.system.magnitude(theta)

    def values(self, theta: Array) -> Array:
        """φ at θ (B, N), of shape (B, m)."""
        if self.phasors is not None:
            return phasor_values(self.phasors, theta).phi
        return self._phi(theta, positions(self.turns, theta))

    def first(self, theta: Array) -> tuple[Array, Array]:
        """φ and φ_θ at θ (B, N), of shapes (B, m) and (B, m, N)."""
        if self.phasors is not None:
            found = phasor_values(self.phasors, theta)
            return found.phi, found.jacobian
        motion = sweep(self.turns, theta)
        return self._phi(theta, motion.x), self._slope(motion.b)

    def at(self, theta: Array) -> tuple[Point, Array]:
        """φ and its derivatives at θ (B, N), and |∂x/∂θ| of the chains, of shape (k, C, B)."""
        motion, sums, shape = sweep(self.turns, theta), self._sums, (3, self.turns.joints.size, len(theta))
        a, b = motion.a.reshape(shape), motion.b.reshape(shape)
        second = sums.second.sums(crossed(a[:, sums.upper], b[:, sums.deeper]))
        point = Point(self._phi(theta, motion.x), self._slope(motion.b), second, sums.pattern, self.rounding(theta))
        return point, np.sqrt(np.sum(motion.b**2, axis=0))

    def _slope(self, arms: Array) -> Array:
        """φ_θ from ∂x/∂θ (3, k, C, B)."""
        (m, size), count = self.system.couplings.shape, arms.shape[-1]
        slope = np.zeros((count, m * size))
        slope[:, self._sums.first.places] = self._sums.first.sums(arms.reshape(3, self.turns.joints.size, count)).T
        return np.asarray(slope.reshape(count, m, size) + self.system.couplings)

    def _phi(self, theta: Array, tips: Array) -> Array:
        s = self.system
        phi = theta @ s.couplings.T + s.offset
        for row in np.flatnonzero(s.moduli):
            phi[:, row] -= s.moduli[row] * np.round(phi[:, row] / s.moduli[row])
        weights = np.transpose(self.stack.weights, (2, 0, 1)).reshape(3 * len(s.chains), s.m)
        return np.asarray(phi + tips.reshape(len(weights), len(theta)).T @ weights)

    def bounds(self, centre: Array, frame: Frame, reach: bool = False) -> Bounds:
        """Y, Z and Z̄ of boxes about θ_c (B, N): of phasors where there are any, unless reach bounds are asked for."""
        if self.phasors is not None and not reach:
            return planar_bounds(self.phasors, phasor_values(self.phasors, centre), frame)
        point, arms = self.at(centre)
        count, m = len(centre), self.system.m
        chains = len(self.system.chains)
        rows = frame.preconditioner @ np.transpose(self.stack.weights, (1, 2, 0)).reshape(m, 3 * chains)
        square = np.square(rows).reshape(count, m, 3, chains)
        gains = np.sqrt(square[:, :, 0] + square[:, :, 1] + square[:, :, 2])
        drift = ReachDrift(self._lengths, gains, by_joint(self.turns.joints, np.abs(centre)), arms, point.rounding)
        return taylor_bounds(point, frame, drift)


class _Sums(NamedTuple):
    """How vectors by joint become φ_θ, and a_i × b_j of pairs of joints the entries of φ_θθ."""

    first: Rows
    second: Rows
    upper: Indices
    deeper: Indices
    pattern: Pattern


def _sums_of(system: ClosureSystem, depth: int) -> _Sums:
    chains, unknowns = len(system.chains), dict[tuple[int, int], int]()
    first, second, pairs = list[Any](), list[Any](), list[tuple[int, int]]()
    for c, chain in enumerate(system.chains):
        rows = np.flatnonzero(np.any(chain.weights != 0.0, axis=1)).tolist()
        at = [(depth - len(chain.joints) + j) * chains + c for j in range(len(chain.joints))]
        joints = chain.joints.tolist()
        for i, one in enumerate(joints):
            first += [(row * system.n_free + one, at[i], chain.weights[row]) for row in rows]
            for j in range(i, len(joints)) if not chain.prismatic[i] else ():
                pair = unknowns.setdefault((min(one, joints[j]), max(one, joints[j])), len(unknowns))
                second += [(pair * system.m + row, len(pairs), chain.weights[row]) for row in rows]
                pairs.append((at[i], at[j]))
    entries, (one, other), (upper, deeper) = Rows(second), _columns(list(unknowns)), _columns(pairs)
    pattern = Pattern(entries.places % system.m, entries.places // system.m, one, other, system.n_free)
    return _Sums(Rows(first), entries, upper, deeper, pattern)


def _columns(pairs: list[tuple[int, int]]) -> tuple[Indices, Indices]:
    table = np.array(pairs, dtype=np.intp).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _copied(system: ClosureSystem) -> ClosureSystem:
    """The system with arrays that cannot be written to."""
    chains = tuple(Chain(*(sealed(value) for value in chain)) for chain in system.chains)
    names = ("couplings", "offset", "moduli", "independent", "dependent", "periodic")
    return replace(system, chains=chains, **{name: sealed(getattr(system, name)) for name in names})


def _require_sound(system: ClosureSystem) -> None:
    """That the numbers are those of closures: bounds are about rotations, unit axes and circles.

    Raises:
        NotProvedError: They are not.
    """
    size = system.n_free
    both = np.sort(np.concatenate([system.independent, system.dependent]))
    require(np.array_equal(both, np.arange(size)), "coordinates that are neither independent nor dependent, or both")
    turning = ~np.any(system.couplings != 0.0, axis=0)
    for chain in system.chains:
        require(len(np.unique(chain.joints)) == len(chain.joints), "a chain that names a joint twice")
        off = np.abs(np.swapaxes(chain.rotations, 1, 2) @ chain.rotations - np.eye(3)).max(initial=0.0)
        unit = np.abs(np.linalg.norm(chain.axes, axis=1) - 1.0).max(initial=0.0)
        require(max(off, unit) <= _ORTHONORMAL, "a placement or an axis that is not orthonormal")
        turning[chain.joints[chain.prismatic]] = False
    require(turning | ~system.periodic, "a circle that is none")


def row_of(closures: Closures, chains: tuple[Chain, ...]) -> Closures:
    """Other chains in the coordinates of closures, as closures of one row: looked at, and copied, as those are.

    Raises:
        NotProvedError: They are none.
    """
    system = closures.system
    require(len(chains) > 0 and [chain.weights.shape == (1, 3) for chain in chains], "no chains of one row")
    none = np.zeros((1, system.n_free))
    return Closures(replace(system, chains=chains, couplings=none, offset=np.zeros(1), moduli=np.zeros(1)))


_MADE: WeakKeyDictionary[ClosureSystem, dict[bool, Closures]] = WeakKeyDictionary()


def closures_of(problem: Problem | Closures) -> Closures:
    """A problem's closures, made once; closures themselves.

    Raises:
        NotProvedError: Its numbers are not those of closures.
    """
    if isinstance(problem, Closures):
        return problem
    made, planar = _MADE.setdefault(problem.system, {}), problem.phasors is not None
    if planar not in made:
        made[planar] = Closures(problem.system, planar)
    return made[planar]


def closure_values(problem: Problem | Closures, theta: Array) -> tuple[Array, Array]:
    """φ (B, m) and φ_θ (B, m, n′) at θ (B, n′)."""
    return closures_of(problem).first(theta)


class Derivatives(NamedTuple):
    """φ (B, m), φ_θ (B, m, n′), φ_θθ (B, m, n′, n′) and |∂x_c/∂θ_j| of the chains (B, C, k)."""

    phi: Array
    jacobian: Array
    hessian: Array
    arms: Array


def derivatives(problem: Problem | Closures, theta: Array) -> Derivatives:
    """φ, φ_θ and φ_θθ at θ (B, n′), by the chains."""
    point, arms = closures_of(problem).at(theta)
    pattern, entries = point.pattern, point.pattern.dense(point.second, problem.system.m)
    hessian = np.zeros((*point.slope.shape, theta.shape[1]))
    hessian[:, :, pattern.first, pattern.other] = hessian[:, :, pattern.other, pattern.first] = entries
    return Derivatives(point.value, point.slope, hessian, np.ascontiguousarray(np.transpose(arms, (2, 1, 0))))


def third_bound(problem: Problem | Closures, theta: Array, arms: Array, box: Array) -> Array:
    """τ ≥ every third and fourth derivative of φ_i over |θ − θ₀| ≤ box (B, n′), of shape (B, m).

    τ_i = Σ_c ‖(B_c)_i‖ max_j ρ_cj with ρ of `chain_reach`, `arms` (B, C, k) being |∂x_c/∂θ_j| at θ₀ (B, n′).
    """
    system, stack = problem.system, problem.stack
    margin = system.rounding * system.magnitude(np.abs(theta) + box)
    reach = chain_reach(stack, arms, gather(stack, np.abs(theta)), gather(stack, box), margin)
    gains = np.swapaxes(np.linalg.norm(stack.weights, axis=2), 0, 1)
    return np.asarray(reach.max(axis=2, initial=0.0) @ gains.T)


def third_along(problem: Problem | Closures, theta: Array, turn: Array) -> Array:
    """Σ_k ∂³φ/∂θ_i∂θ_j∂θ_k v_k at θ (B, n′) for v of shape (B, n′), of shape (B, m, n′, n′)."""
    equations = closures_of(problem)
    system, stack = equations.system, equations.stack
    motion, rates = moved(equations.turns, theta), gather(stack, turn)
    k, size = stack.joints.shape[1], system.n_free
    first, middle, last = np.sort(np.indices((k, k, k)).reshape(3, -1), axis=0)
    product = cross(motion.a[:, :, first], cross(motion.a[:, :, middle], motion.b[:, :, last]))
    tensor = product.reshape(*motion.b.shape[:2], k * k, k, 3)
    turned = (rates[:, :, None, None] @ tensor)[..., 0, :] @ np.swapaxes(stack.weights, 1, 2)
    parts = np.moveaxis(turned.reshape(*motion.b.shape[:2], k, k, system.m), 4, 1)
    place = stack.placement.reshape(-1, k, size)
    return np.asarray((np.swapaxes(place, 1, 2) @ parts @ place).sum(axis=2))
