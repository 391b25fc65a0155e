"""That the rest of a region holds no singular closed configuration but those on a document's curves.

The search is the auditor's own, so that no covering need be stored: from the region and whole turns of the dependent
joints (of those that slide or are coupled all there is, by the lemma of `ranges`), cut into equal parts; of the
document it uses the tubes, proved apart, and the boxes listed as uncovered. A part is halved until each box of θ is
shown to hold none, or only what a tube holds, or lies in a listed box.

**Lemma A.** On a box of θ no configuration closes where 0 is not in φ(box), nor where 0 is not in a row of
Pφ(θ_c) + Pφ_θ(box)(θ − θ_c), P any matrix; solved for one coordinate each row leaves a part of the box. None is
singular where |1 − Pφ_y(box)|u < u for a P and a u > 0.

*Proof.* The mean value theorem, and Neumann's series. ∎

Where both fail, and the box is small, Lemmas B and C of `slanted` leave of it what is about the curve that crosses it:
with the l of a tube beside it, which may hold all that, or else with the kernel of φ_y at θ_c for l. That is what
halving boxes alone cannot do: {φ = 0} and the curve on it are slanted, so that about a curve boxes parallel to the axes
are many before they are so small that φ_y is regular on those off the curve.

Rows of φ known modulo something are linear. They move by a tenth of that at most over boxes whose slopes are used, and
so by less than half of it over what is slanted: no whole multiple but that nearest to the middle's value is there.
Sums of slopes over boxes are in balls; corners of boxes are doubles, outward, and listed boxes are 1e-12 wider.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat
from scipy.linalg import qr

from ccpin.auditing.boxes import contracts, defect
from ccpin.auditing.closures import BallClosures, columns, floats, inverse_of
from ccpin.auditing.reach import CornerBox, Reach, above, below
from ccpin.auditing.reading import Array, Curves
from ccpin.auditing.singular_curves import Singular, placed, turns
from ccpin.auditing.slanted import cut_down
from ccpin.auditing.stated_ranges import intervals

_FINE = 0.15  # rad: last joints of chains are cut after all others
_CELL = 0.4  # rad: how wide parts are
_FEWEST, _MOST = 6, 10  # how often all is halved
_BUDGET, _LEAST = 20_000, 1e-6  # boxes of a part, and how narrow
_WIDER = 1e-12  # region, ranges and listed boxes
_SLOPES = 0.9  # rad: boxes whose turns are wider are halved before slopes are tried
_ROW = 0.1  # of a modulus: boxes over which a row moves more are halved before slopes are tried
_SLANTED = 0.15  # rad or m: boxes wider than this are halved before they are slanted
_NEAR, _FAR, _BESIDE = 1.5, 3.0, 3  # half lengths of a tube: wider boxes, and those farther away, have no use for it
_SHRUNK = 0.7  # of a box's edges in all: narrowed again where less is left, else halved
_HELD = 0.2  # of a box: where a listed box holds so much the rest is cut off


class Exclusion:
    """What is needed to look at parts of a document's region, made once."""

    def __init__(self, closures: BallClosures, document: Curves) -> None:
        self.closures, self.document = closures, document
        self.turning = turns(closures, document)
        self.tubes = [placed(closures, document, k) for k in range(len(document.tubes))]
        size = closures.n_free
        self._free = np.array(self.turning[:size])
        self.reach = Reach(closures, document, frozenset())
        self.curve = np.repeat(np.arange(len(document.sizes)), document.sizes)
        self._extents = np.array([np.abs(t.tangent) * t.half + t.radius for t in document.tubes])
        self._middles = np.array([tube.theta for tube in document.tubes]).reshape(-1, size)
        self._lengths = np.array([tube.half for tube in document.tubes])
        self._listed = 0.5 * (document.uncovered_lower + document.uncovered_upper)
        self.parts = parts(closures, document)
        self._reach = 0.5 * (document.uncovered_upper - document.uncovered_lower) + _WIDER

    def proved(self, number: int) -> bool | None:
        """Whether a part was proved to hold no singular configurations but those of tubes and listed boxes.

        ``None``: it was not.
        """
        waiting, left = [self.parts[number]], _BUDGET
        while waiting:
            box, left = waiting.pop(), left - 1
            rest = self._left_of(box)
            if rest is None:
                continue
            if left <= 0 or rest.half.max() < _LEAST:
                return None
            face = self._face(rest)
            if face is not None:
                waiting += rest.cut(*face)
            elif rest.half.sum() < _SHRUNK * box.half.sum():
                waiting.append(rest)
            else:
                waiting += rest.halves(self._steepest(rest))
        return True

    def _left_of(self, box: CornerBox) -> CornerBox | None:
        """What may hold other singular configurations of a box; ``None``: nothing."""
        if self._is_listed(box) or self.reach.too_far(box):
            return None
        balls = box.balls()
        motions = self.closures.motions(balls)
        phi = self.closures.value(balls, motions)
        if not all(phi[i, 0].contains(0) for i in range(self.closures.m)):
            return None
        if box.half[self._free].max(initial=0.0) > _SLOPES or self._turns_over(phi):
            return box
        at, slope = _Middle.of(self.closures, box), self.closures.jacobian(motions)
        if self._regular(slope, at.slope):
            return None
        left = self._closing(box, slope, at)
        return left if left is None or left.half.max() > _SLANTED else self._beside_curves(left)

    def _turns_over(self, phi: arb_mat) -> bool:
        """Whether a row of φ that is known modulo something moves by a good part of that over the box."""
        moduli = self.closures.moduli
        return any(phi[int(k), 0].rad() > _ROW * float(moduli[k]) for k in np.flatnonzero(moduli))

    def _regular(self, slope: arb_mat, at: Array) -> bool:
        """Whether φ_y is regular on the box (Lemma A)."""
        dependent = self.document.dependent
        A = inverse_of(at[:, dependent])
        return A is not None and contracts(defect(A * columns(slope, dependent)))

    def _closing(self, box: CornerBox, slope: arb_mat, at: _Middle) -> CornerBox | None:
        """The box without some of what closes nothing (Lemma A), P the inverse of the columns that move φ most."""
        pivots = qr(at.slope * np.sqrt(box.half), mode="r", pivoting=True)[1][: self.closures.m]
        P = inverse_of(at.slope[:, pivots])
        if P is None:
            return box
        constant, along = P * at.value, P * slope
        low, high = box.low.copy(), box.high.copy()
        for row, j in enumerate(map(int, pivots)):
            deltas = [arb(float(a)).union(arb(float(b))) - x for a, b, x in zip(low, high, at.point, strict=True)]
            terms = [along[row, k] * delta for k, delta in enumerate(deltas)]
            if not sum(terms, constant[row, 0]).contains(0):
                return None
            if along[row, j].contains(0):
                continue
            others = sum((term for k, term in enumerate(terms) if k != j), constant[row, 0])
            found = at.point[j] - others / along[row, j]
            low[j], high[j] = max(low[j], below(found)), min(high[j], above(found))
            if low[j] > high[j]:
                return None
        return CornerBox(low, high)

    def _steepest(self, box: CornerBox) -> int:
        """Along which coordinate φ moves most over a box; last joints of chains come last."""
        moves = np.abs(self.closures.at(box.middle)[1]).max(axis=0, initial=0.0)
        moves = (moves / moves.max(initial=1e-9) + 0.1) * box.half
        first = self.reach.first
        if moves[first].max(initial=0.0) > _FINE:
            return int(first[int(np.argmax(moves[first]))])
        return int(np.argmax(moves))

    def _beside_curves(self, box: CornerBox) -> CornerBox | None:
        """What is left of a small box by Lemmas B and C, with the tubes beside it if there are any."""
        near, size = self._near(box), box.half.max()
        tubes = [self.tubes[k] for k in near if size <= _NEAR * self._lengths[k]]
        if not tubes:
            inner = self.closures.at(box.middle)[1][:, self.document.dependent]
            weakest = np.linalg.svd(inner)[2][-1]
            return cut_down(box, Singular(self.closures, self.document.dependent, weakest), None, self.turning)
        left: CornerBox | None = box
        for tube in tubes:
            left = None if left is None else cut_down(left, tube.system, tube, self.turning)
        return left

    def beside(self, theta: Array) -> list[int]:
        """The tubes in whose box of θ, twice as wide, a configuration lies."""
        if not len(self._middles):
            return []
        gaps = self._gaps(theta, self._middles)
        inside = np.all(np.abs(gaps) <= 2.0 * self._extents[:, : len(theta)] + _WIDER, axis=1)
        return [int(k) for k in np.flatnonzero(inside)]

    def _near(self, box: CornerBox) -> list[int]:
        """The tubes nearest to a box's middle, of those that are not far from it."""
        distance = np.abs(self._gaps(box.middle, self._middles)).max(axis=1)
        first = np.argsort(distance, kind="stable")[:_BESIDE]
        return [int(k) for k in first if distance[k] <= _FAR * self._lengths[k]]

    def _is_listed(self, box: CornerBox) -> bool:
        """Whether a listed box holds all of a box."""
        return bool(np.any(np.all(np.abs(self._gaps(box.middle, self._listed)) + box.half <= self._reach, axis=1)))

    def _gaps(self, theta: Array, places: Array) -> Array:
        """From places to a configuration, without whole turns."""
        gap = theta - places
        return np.asarray(gap - np.where(self._free, 2.0 * np.pi * np.round(gap / (2.0 * np.pi)), 0.0))

    def _face(self, box: CornerBox) -> tuple[int, float] | None:
        """Where to cut a box of which a listed box holds a good part: its axis and place; ``None``: there is none."""
        middle, reach = box.middle - self._gaps(box.middle, self._listed), self._reach - 0.5 * _WIDER
        low, high = np.maximum(box.low, middle - reach), np.minimum(box.high, middle + reach)
        shares = np.maximum(high - low, 0.0) / np.maximum(2.0 * box.half, 1e-300)
        held = np.prod(shares, axis=1)
        if held.max(initial=0.0) < _HELD:
            return None
        k = int(np.argmax(held))
        axis = int(np.argmin(shares[k]))
        place = low[k, axis] if low[k, axis] - box.low[axis] > box.high[axis] - high[k, axis] else high[k, axis]
        return (axis, float(place)) if box.low[axis] < place < box.high[axis] else None


class _Middle(NamedTuple):
    """A box's middle, φ there in balls, and φ_θ in plain floating point."""

    point: list[arb]
    value: arb_mat
    slope: Array

    @staticmethod
    def of(closures: BallClosures, box: CornerBox) -> _Middle:
        point = [arb(float(x)) for x in box.middle]
        motions = closures.motions(point)
        return _Middle(point, closures.value(point, motions), floats(closures.jacobian(motions)))


def searched(closures: BallClosures, document: Curves) -> CornerBox:
    """The region, whole turns, all that slides and coupled joints can have; what is stated where they have no end."""
    box = intervals(Reach(closures, document, frozenset()))
    low, high = np.full(len(box.low), -np.inf), np.full(len(box.low), np.inf)
    low[document.dependent], high[document.dependent] = document.ranges.lower, document.ranges.upper
    low, high = np.where(np.isfinite(box.low), box.low, low), np.where(np.isfinite(box.high), box.high, high)
    room = _WIDER * (1.0 + np.maximum(np.abs(low), np.abs(high)))
    return CornerBox(low - room, high + room)


def parts(closures: BallClosures, document: Curves) -> list[CornerBox]:
    """Equal parts of that, cut along coordinates that are no chain's last."""
    found, first = [searched(closures, document)], Reach(closures, document, frozenset()).first
    for depth in range(_MOST):
        axis = first[int(np.argmax(found[0].half[first]))]
        if depth >= _FEWEST and 2.0 * found[0].half[axis] <= _CELL:
            break
        found = [half for box in found for half in box.halves(int(axis))]
    return found


def listed_share(closures: BallClosures, document: Curves) -> float:
    """How much of all that is searched lies in listed boxes, at most."""
    width = 2.0 * searched(closures, document).half
    listed = document.uncovered_upper - document.uncovered_lower
    return float(min(1.0, np.prod(np.minimum(listed / width, 1.0), axis=1).sum()))
