"""How far dependent coordinates can go, over the region and within the limits that a document states.

**Lemma.** Let S be the closed configurations over the region that keep the limits, and I_j intervals that hold their
θ_j: the region's edges, limits, or all numbers. They may be met with

1. −(d_i + Σ_{k≠j} G_ik I_k)/G_ij, for a row i of φ that is Σ_k G_ik θ_k + d_i alone and not known modulo something;
2. |θ_j| ≤ r/√λ for all j of J, where rows read Σ_c W_c x_c + d = 0, J are slides of one chain with no turn between
   them, seen by W_c as they are (`reach`), U the columns W_c a_j, UᵀU − λ positive definite, and r is |d| and the
   lengths, as the W see them, of all segments of all these chains but those of J.

*Proof.* 1 is the row. 2: the sum of the slides J, as W_c sees it, is minus the sum of d and of what is seen of those
segments; and its square is (Uθ_J)² > λ θ_J², for it is seen as it is before all turns. ∎

Angles known modulo 2π have a whole turn. What a document states must hold what is found here, and end at a limit only
where it says that this is one: then a configuration is in its ranges if and only if it keeps the limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.closures import Path, exact, floats
from ccpin.auditing.lengths import size_of
from ccpin.auditing.reach import ChainGroup, CornerBox, Reach, above, below
from ccpin.auditing.reading import free_angles

TURN = np.pi + 1e-9
"""Half of what angles known modulo 2π may have, and a bit."""
_WIDER = 1e-12  # than the region: cells' corners are rounded
_NONE = float(np.finfo(np.float64).max)
_ROUNDS = 200  # over all rows and lengths, at most
_GAIN = 1e-3  # of an interval: another round where one lost more
_LEAST = 1e-6  # of λ: slides that are seen less have no bound
_PLAIN, _LIMIT, _ENDED = 0, 1, (1, 2, 3)  # reasons of an end: of a whole turn, a limit, all others
_SLACK = 1.0 - 1e-7  # of the least eigenvalue as computed: a λ below it, of which UᵀU − λ > 0 is proved


def intervals(reach: Reach) -> CornerBox:
    """Where all coordinates of S lie; ±∞ where no end was found."""
    return _CoordinateIntervals(reach).found()


def unproved(reach: Reach) -> list[int]:
    """The dependent coordinates whose stated range does not follow from the lemma and the limits stated."""
    stated, dependent = reach.document.ranges, reach.document.dependent
    if stated is None:
        return []
    box, free, wrong = intervals(reach), free_angles(reach.document), list[int]()
    for k, j in enumerate(map(int, dependent)):
        ends, limits, reasons = (stated.lower[k], stated.upper[k]), stated.limits[k], stated.reasons[k]
        if free[j]:
            whole = np.all(reasons == _PLAIN) and np.all(np.abs(limits) == _NONE)
            good = bool(whole) and arb(float(ends[1])) - float(ends[0]) > 2 * arb.pi() - 1e-12
        else:
            said = np.all((reasons != _LIMIT) | (np.array(ends) == limits)) and np.all(np.isin(reasons, _ENDED))
            good = bool(said) and ends[0] <= box.low[j] and box.high[j] <= ends[1]
        wrong += [] if good else [j]
    return wrong


class _CoordinateIntervals:
    """Intervals that the lemma makes smaller."""

    def __init__(self, reach: Reach) -> None:
        self._reach, document = reach, reach.document
        size, stated, free = reach.closures.n_free, document.ranges, np.array(free_angles(reach.document))
        self.low, self.high = np.full(size, -np.inf), np.full(size, np.inf)
        if stated is not None:
            low, high = stated.limits.T
            self.low[document.dependent] = np.where(low <= -_NONE, -np.inf, low)
            self.high[document.dependent] = np.where(high >= _NONE, np.inf, high)
        self.low[free], self.high[free] = -TURN, TURN
        room = _WIDER * (1.0 + np.maximum(np.abs(document.lower), np.abs(document.upper)))
        self.low[document.independent], self.high[document.independent] = document.lower - room, document.upper + room
        self._ours = np.isin(np.arange(size), document.dependent) & ~free

    def found(self) -> CornerBox:
        """The intervals, once none gets much smaller."""
        for _ in range(_ROUNDS):
            before = self.high - self.low
            self._by_couplings()
            for group in self._reach.groups:
                self._by_lengths(group)
            now = self.high - self.low
            if not np.any((now < (1.0 - _GAIN) * before) | (np.isfinite(now) & ~np.isfinite(before))):
                break
        return CornerBox(self.low, self.high)

    def _by_couplings(self) -> None:
        document = self._reach.document
        for row, ratios in enumerate(document.couplings):
            entered = any(np.any(chain.weights[row] != 0.0) for chain in document.chains)
            used = np.flatnonzero(ratios)
            if entered or document.moduli[row] != 0.0:
                continue
            for j in used[self._ours[used]]:
                others = used[used != j]
                if np.all(np.isfinite(self.low[others]) & np.isfinite(self.high[others])):
                    terms = [self._ball(int(k)) * float(ratios[k]) for k in others]
                    image = -sum(terms, self._reach.closures.offset[row, 0]) / float(ratios[j])
                    self._meet(int(j), below(image), above(image))

    def _ball(self, j: int) -> arb:
        return arb(float(self.low[j])).union(arb(float(self.high[j])))

    def _by_lengths(self, group: ChainGroup) -> None:
        for number in group.chains:
            joints = self._reach.document.chains[number].joints
            for together in _between_turns(self._reach.closures.paths[number]):
                ours = [k for k in together if self._ours[joints[k]]]
                unknown = [k for k in ours if not np.isfinite(self.high[joints[k]] - self.low[joints[k]])]
                for own in [unknown] if unknown else [[k] for k in ours]:
                    most = self._bound(group, number, own)
                    for k in own if np.isfinite(most) else ():
                        self._meet(int(joints[k]), -most, most)

    def _bound(self, group: ChainGroup, number: int, own: list[int]) -> float:
        """2 for the slides at places `own` of a chain of a group."""
        least = self._least(group, number, own)
        if least is None:
            return np.inf
        total = size_of(arb_mat([[self._reach.closures.offset[row, 0]] for row in group.rows]))
        for other in group.chains:
            segments = self._reach.segments[other]
            total += segments[-1].before[0]
            for k, turn in enumerate(self._reach.closures.paths[other].turns):
                total += segments[k].before[0]
                if turn.prismatic and not (other == number and k in own):
                    farthest = max(abs(self.low[turn.joint]), abs(self.high[turn.joint]))
                    if not np.isfinite(farthest):
                        return np.inf
                    total += arb(float(farthest)) * segments[k].along[0]
        return above(total / least.sqrt())

    def _least(self, group: ChainGroup, number: int, own: list[int]) -> arb | None:
        """λ; ``None`` where the slides are not seen as they are, or hardly."""
        path, rotation, columns = self._reach.closures.paths[number], exact(np.eye(3)), list[arb_mat]()
        if not own or not self._reach.segments[number][own[0]].as_is:
            return None
        for k in range(max(own) + 1):
            rotation = rotation * path.turns[k].rotation
            columns.append(path.weights * (rotation * path.turns[k].axis))
        U = arb_mat([[columns[k][i, 0] for k in own] for i in group.rows])
        square = U.transpose() * U
        least = float(np.linalg.eigvalsh(floats(square))[0]) * _SLACK
        shifted = square - exact(least * np.eye(len(own)))
        minors = (arb_mat([[shifted[i, j] for j in range(k)] for i in range(k)]).det() for k in range(1, len(own) + 1))
        return arb(least) if least > _LEAST and all(minor > 0 for minor in minors) else None

    def _meet(self, j: int, low: float, high: float) -> None:
        """Meet an interval with another, unless they have nothing in common: S is empty then, and any will do."""
        low, high = max(low, self.low[j]), min(high, self.high[j])
        if low <= high:
            self.low[j], self.high[j] = low, high


def _between_turns(path: Path) -> Iterator[list[int]]:
    """The slides of a chain that have no turn between them, by their places in it."""
    for slides, together in groupby(range(len(path.turns)), lambda k: path.turns[k].prismatic):
        if slides:
            yield list(together)
