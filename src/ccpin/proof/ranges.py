"""Ranges of dependent coordinates, each a proved fact with its reason (Lemma R of `ccpin/proof/theorems/ranges.md`).

A search of all values of the dependent coordinates proves nothing about values that it leaves out. So what it searches
is derived here, from the closures φ(θ) = Σ_c B_c x_c(θ) + Gθ + d, the region of q and the limits that belong to the
claim.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, Indices, Mask
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.chains import Chain, ClosureSystem
from ccpin.proof.facts import NotProvedError

NO_LIMIT = float(np.finfo(np.float64).max)
"""Stands for no limit in documents, which have no infinity."""
_WIDER = 1e-6  # of an interval's ends: far above the roundings of the sums
_ORTHONORMAL = 1e-9  # how far axes and rows may be from orthonormal
_LEAST_SEEN = 1e-3  # of σ: slides that are seen less have no bound worth a search
_ROUNDS, _GAIN = 50, 1e-2  # passes, and what a further one is worth after: fewer leave wider ranges


class Reason(IntEnum):
    """Why no closed configuration that the claim speaks of lies beyond an end of a range."""

    TURN = 0
    LIMIT = 1
    COUPLING = 2
    LENGTHS = 3


class Ranges(NamedTuple):
    """What is searched of m dependent coordinates, and why that is all.

    Attributes:
        lower, upper: The ranges, of shape (m,) each (rad, m).
        reasons: The `Reason` of the lower and of the upper end of each, of shape (m, 2).
        limits: Lower and upper limits that belong to the claim, ±`NO_LIMIT` where there is none, of shape (m, 2).
    """

    lower: Array
    upper: Array
    reasons: NDArray[np.int8]
    limits: Array

    @property
    def middle(self) -> Array:
        """Of each range, of shape (m,): where full turns are cut open is half a turn from it."""
        return np.asarray(0.5 * self.lower + 0.5 * self.upper)

    @property
    def edge(self) -> Array:
        """How near to an end counts as at it, of shape (m,)."""
        return np.asarray(1e-9 * (1.0 + np.maximum(np.abs(self.lower), np.abs(self.upper))))

    @property
    def turning(self) -> Mask:
        """Which are full turns, of shape (m,)."""
        return np.asarray(self.reasons[:, 0] == Reason.TURN)

    def at_limit(self, low: Array, high: Array) -> Mask:
        """Which boxes [low, high], of shape (K, m) each, meet an end that is a limit, of shape (K,)."""
        limited = self.reasons == Reason.LIMIT
        meets = limited[:, 0] & (low <= self.lower + self.edge) | limited[:, 1] & (high >= self.upper - self.edge)
        return np.asarray(np.any(meets, axis=1))


def ranges_of(
    closures: ClosureSystem, middle: Array, region: tuple[Array, Array], limits: Array, names: Sequence[str]
) -> Ranges:
    """The ranges of the dependent coordinates over a region (Lemma R).

    Args:
        closures: φ.
        middle: Of full turns, θ of shape (n′,).
        region: Lower and upper corner of Q, of shape (n,) each.
        limits: Of the dependent coordinates those that belong to the claim, ±`NO_LIMIT` or ±∞ where there is none, of
            shape (m, 2). Those of coordinates that have a full turn are left out.
        names: What to call the coordinates, n′ of them.

    Raises:
        UnsupportedMechanismError: A range is not bounded.
    """
    found = _Intervals(closures, region, limits)
    found.narrow()
    low, high = found.low.copy(), found.high.copy()
    for j in closures.dependent:
        if found.turning[j]:
            low[j], high[j] = middle[j] - np.pi, middle[j] + np.pi
        elif not np.isfinite(high[j] - low[j]):
            raise UnsupportedMechanismError(
                f"'{names[int(j)]}' has no range that could be searched: neither lengths nor couplings bound it over "
                "the region; give the joint a lower and an upper limit, within which configurations then are meant"
            )
    turning = found.turning[closures.dependent]
    stated = np.where(turning[:, None], [-NO_LIMIT, NO_LIMIT], np.clip(limits, -NO_LIMIT, NO_LIMIT))
    reasons = np.where(turning[:, None], Reason.TURN, found.reasons[closures.dependent]).astype(np.int8)
    return Ranges(low[closures.dependent], high[closures.dependent], reasons, stated)


def ranges_over(closures: ClosureSystem, ranges: Ranges, region: tuple[Array, Array]) -> Ranges:
    """The ranges over another region, within the same limits."""
    middle = np.zeros(len(closures.periodic))
    middle[closures.dependent] = ranges.middle
    return ranges_of(closures, middle, region, ranges.limits, [f"coordinate {j}" for j in range(len(middle))])


def proved_ranges(closures: ClosureSystem, middle: Array, region: tuple[Array, Array], limits: Array) -> Ranges:
    """The same, full turns about `middle` (m,), for a claim.

    Raises:
        NotProvedError: A range is not bounded.
    """
    theta = np.zeros(closures.n_free)
    theta[closures.dependent] = middle
    try:
        return ranges_of(closures, theta, region, limits, [f"coordinate {j}" for j in range(closures.n_free)])
    except UnsupportedMechanismError as error:
        raise NotProvedError(str(error)) from error


class _Intervals:
    """Intervals of all coordinates that Lemma R makes smaller.

    Attributes:
        low, high: Their ends, of shape (n′,) each.
        reasons: Of these, of shape (n′, 2); of q and of ends at infinity none.
        turning: Of which φ knows the angle only: they turn chains and enter no coupling, of shape (n′,).
    """

    def __init__(self, closures: ClosureSystem, region: tuple[Array, Array], limits: Array) -> None:
        self._closures, size = closures, len(closures.periodic)
        self.low, self.high = np.full(size, -np.inf), np.full(size, np.inf)
        self.reasons = np.full((size, 2), Reason.LIMIT, dtype=np.int8)
        slides = np.zeros(size, dtype=np.bool_)
        for chain in closures.chains:
            slides[chain.joints[chain.prismatic]] = True
        self.turning = closures.periodic & ~slides & ~np.any(closures.couplings != 0.0, axis=0)
        ours = ~self.turning[closures.dependent]
        known = closures.dependent[ours]
        self.low[known] = np.where(limits[ours, 0] <= -NO_LIMIT, -np.inf, limits[ours, 0])
        self.high[known] = np.where(limits[ours, 1] >= NO_LIMIT, np.inf, limits[ours, 1])
        self.low[closures.independent], self.high[closures.independent] = region
        self._dependent = np.isin(np.arange(size), closures.dependent) & ~self.turning

    def narrow(self) -> None:
        """Apply the lemma until no interval gets much smaller."""
        for _ in range(_ROUNDS):
            before = self.high - self.low
            self._by_couplings()
            self._by_lengths()
            now = self.high - self.low
            if not np.any((now < (1.0 - _GAIN) * before) | (np.isfinite(now) & ~np.isfinite(before))):
                break

    def _by_couplings(self) -> None:
        """Lemma R.1, for every coordinate of every such row."""
        closures = self._closures
        entered = [np.any(chain.weights != 0.0, axis=1) for chain in closures.chains]
        free = ~np.any([np.zeros(len(closures.offset), dtype=np.bool_), *entered], axis=0) & (closures.moduli == 0.0)
        for row in np.flatnonzero(free):
            ratios = closures.couplings[row]
            used = np.flatnonzero(ratios)
            ends = ratios[used] * np.array([self.low[used], self.high[used]])
            for k in np.flatnonzero(self._dependent[used]):
                others = np.delete(ends, k, axis=1)
                total = np.array([others.min(axis=0).sum(), others.max(axis=0).sum()]) + closures.offset[row]
                image = -total / ratios[used[k]]
                self._meet(int(used[k]), float(image.min()), float(image.max()), Reason.COUPLING)

    def _by_lengths(self) -> None:
        """Lemma R.2, for the slides of each chain that have no turn between them."""
        for chain in self._closures.chains:
            rows = np.flatnonzero(np.any(chain.weights != 0.0, axis=1))
            if self._are_points(rows):
                for together in _between_turns(chain):
                    self._bound(rows, chain, [k for k in together if self._dependent[chain.joints[k]]])

    def _are_points(self, rows: Indices) -> bool:
        """Whether point chains enter these rows and nothing else."""
        closures = self._closures
        linear = np.any(closures.couplings[rows]) or np.any(closures.moduli[rows])
        return not linear and not any(c.direction and np.any(c.weights[rows] != 0.0) for c in closures.chains)

    def _bound(self, rows: Indices, chain: Chain, together: list[int]) -> None:
        """Bound slides of a chain: all of them that have no bound yet, or each by itself."""
        reach = np.maximum(np.abs(self.low), np.abs(self.high))
        unknown = [k for k in together if not np.isfinite(reach[chain.joints[k]])]
        for own in [unknown] if unknown else [[k] for k in together]:
            sight = _Sight(chain, rows)
            least = sight.least(own)
            if least < _LEAST_SEEN:
                continue
            rest = float(np.linalg.norm(self._closures.offset[rows]))
            for other in self._closures.chains:
                left_out = own if other is chain else []
                rest += _Sight(other, rows).longest(reach, left_out)
            if np.isfinite(rest):
                for k in own:
                    self._meet(int(chain.joints[k]), -rest / least, rest / least, Reason.LENGTHS)

    def _meet(self, j: int, low: float, high: float, reason: Reason) -> None:
        """Meet an interval with another one, widened; nothing is left as it was if they have nothing in common."""
        room = _WIDER * (1.0 + max([abs(x) for x in (low, high) if np.isfinite(x)], default=0.0))
        low, high = low - room, high + room
        if max(low, self.low[j]) > min(high, self.high[j]):
            return
        if low > self.low[j]:
            self.low[j], self.reasons[j, 0] = low, reason
        if high < self.high[j]:
            self.high[j], self.reasons[j, 1] = high, reason


def _between_turns(chain: Chain) -> Iterator[list[int]]:
    """The slides of a chain that have no turn between them, by their places in it."""
    together = list[int]()
    for k, slides in enumerate(chain.prismatic):
        if slides:
            together.append(k)
        elif together:
            yield together
            together = []
    if together:
        yield together


class _Sight:
    """What some rows of a chain's weights see of its segments.

    Attributes:
        columns: W a of each joint's axis at θ = 0, of shape (k, rows).
        exact: Whether what is before each joint, and at the tip, is seen as it is, of shape (k + 1,).
    """

    def __init__(self, chain: Chain, rows: Indices) -> None:
        self._chain, self._weights = chain, chain.weights[rows]
        self._norm = float(np.linalg.norm(self._weights, 2)) if rows.size else 0.0
        whole = _is_identity(self._weights.T @ self._weights)
        used = self._weights[np.any(self._weights != 0.0, axis=1)]
        flat = len(used) == 2 and _is_identity(used @ used.T)
        turned, rotation = False, np.eye(3)
        self._links, columns, exact = list[Array](), list[Array](), list[bool]()
        for k, slides in enumerate(chain.prismatic):
            exact.append(whole or flat or not turned)
            self._links.append(self._weights @ rotation @ chain.translations[k])
            rotation = rotation @ chain.rotations[k]
            columns.append(self._weights @ rotation @ chain.axes[k])
            if not slides:
                turned, flat = True, flat and bool(np.linalg.norm(columns[-1]) <= _ORTHONORMAL)
        self._links.append(self._weights @ rotation @ chain.tip)
        self.columns, self.exact = np.array(columns), np.array([*exact, whole or flat or not turned])

    def least(self, own: list[int]) -> float:
        """σ for slides at some places without a turn between them; 0 where they are not seen as they are."""
        if not own or not self.exact[own[0]] or len(own) > self.columns.shape[1]:
            return 0.0
        return float(np.linalg.svd(self.columns[own], compute_uv=False)[-1])

    def longest(self, reach: Array, left_out: list[int]) -> float:
        """What is seen at most of all segments but some slides, the others at their longest."""
        chain, total = self._chain, 0.0
        lengths = [*np.linalg.norm(chain.translations, axis=1), np.linalg.norm(chain.tip)]
        for k, (link, length) in enumerate(zip(self._links, lengths, strict=True)):
            total += float(np.linalg.norm(link)) if self.exact[k] else self._norm * float(length)
        for k in np.flatnonzero(chain.prismatic).tolist():
            seen = float(np.linalg.norm(self.columns[k])) if self.exact[k] else self._norm
            if k not in left_out and seen > 0.0:
                total += seen * float(reach[chain.joints[k]])
        return total


def _is_identity(matrix: Array) -> bool:
    return bool(np.abs(matrix - np.eye(len(matrix))).max(initial=0.0) <= _ORTHONORMAL)
