"""The equations of closed loops, φ(θ) = 0, as the kernel sees them: values, two derivatives, bounds over boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.domain.bounds import Bounds, Frame
from ccpin.domain.bounds_planar import Phasors, phasor_values, phasors_of, planar_bounds
from ccpin.domain.chain_stack import ChainStack, stack_chains
from ccpin.domain.chains import Chain, ClosureSystem
from ccpin.proof.digests import digest
from ccpin.proof.facts import known, require, sealed
from ccpin.proof.reach import Lengths, ReachDrift
from ccpin.proof.taylor import Pattern, Point, taylor_bounds
from ccpin.proof.tips import Rows, Turns, by_joint, crossed, move, positions, turns_of

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
    def stack(self) -> ChainStack:
        """The chains side by side."""
        return stack_chains(self.system.chains, self.system.n_free, self.system.m)

    @cached_property
    def turns(self) -> Turns:
        """The constants of a sweep."""
        return turns_of(self.stack)

    @cached_property
    def _lengths(self) -> Lengths:
        return Lengths.of(self.stack, self.turns)

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

    def at(self, theta: Array) -> tuple[Point, Array]:
        """φ and its derivatives at θ (B, N), and |∂x/∂θ| of the chains, of shape (k, C, B)."""
        motion, sums, (count, size) = move(self.turns, theta), self._sums, theta.shape
        joints = self.turns.joints.size
        a, b = motion.a.reshape(3, joints, count), motion.b.reshape(3, joints, count)
        slope = np.zeros((count, self.system.m * size))
        slope[:, sums.first.places] = sums.first.sums(b).T
        slope = slope.reshape(count, self.system.m, size) + self.system.couplings
        second = sums.second.sums(crossed(a[:, sums.upper], b[:, sums.deeper]))
        point = Point(self._phi(theta, motion.x), slope, second, sums.pattern, self.rounding(theta))
        return point, np.sqrt(np.sum(motion.b**2, axis=0))

    def _phi(self, theta: Array, tips: Array) -> Array:
        s = self.system
        phi = theta @ s.couplings.T + s.offset
        for row in np.flatnonzero(s.moduli):
            phi[:, row] -= s.moduli[row] * np.round(phi[:, row] / s.moduli[row])
        weights = np.transpose(self.stack.weights, (2, 0, 1)).reshape(3 * len(s.chains), s.m)
        return np.asarray(phi + tips.reshape(len(weights), len(theta)).T @ weights)

    def bounds(self, centre: Array, frame: Frame, reach: bool = False) -> Bounds:
        """Y, Z and Z̄ of boxes about θ_c (B, N): those of phasors where there are any, unless reach bounds are asked for."""
        if self.phasors is not None and not reach:
            return planar_bounds(self.phasors, phasor_values(self.phasors, centre), frame)
        point, arms = self.at(centre)
        count, m = len(centre), self.system.m
        chains = len(self.system.chains)
        rows = frame.preconditioner @ np.transpose(self.stack.weights, (1, 2, 0)).reshape(m, 3 * chains)
        gains = np.sqrt(np.square(rows.reshape(count, m, 3, chains)).sum(axis=2))
        drift = ReachDrift(self._lengths, gains, by_joint(self.turns, np.abs(centre)), arms, point.rounding)
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
    entries = Rows(second)
    pattern = Pattern(entries.places % system.m, entries.places // system.m, *_columns(list(unknowns)), system.n_free)
    return _Sums(Rows(first), entries, *_columns(pairs), pattern)


def _columns(pairs: list[tuple[int, int]]) -> Indices:
    return np.array(pairs, dtype=np.intp).reshape(-1, 2).T


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


_MADE: WeakKeyDictionary[ClosureSystem, dict[bool, Closures]] = WeakKeyDictionary()


def closures_of(system: ClosureSystem, planar: bool) -> Closures:
    """The equations of a system, made once.

    Raises:
        NotProvedError: Its numbers are not those of closures.
    """
    made = _MADE.setdefault(system, {})
    if planar not in made:
        made[planar] = Closures(system, planar)
    return made[planar]
