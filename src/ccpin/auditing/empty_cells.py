"""Cells said to hold no closed configuration.

The lemmas of `reach` and `platform` are tried first, over parts of the cell. Then boxes over the cell of whole turns of
the dependent coordinates, and of all that slides and coupled joints can have (the lemma of `ranges`), are halved until
each is shown to hold none: by the lemma of `reach`, or a row of φ over the box, or of

    Ãφ(θ) ∈ Ãφ(θ₀) + Ãφ_θ(box)(θ − θ₀)

with Ã = I or Ã ≈ φ_y⁻¹ that 0 is not in; what of a box this leaves, solved for one coordinate at a time, takes its
place. That search is not tried where a slide or a coupled joint has no end, where φ is known modulo something, or more
than six coordinates depend.

The same search, with boxes kept on which |I − Ãφ_y|w < w for some w > 0, is what `counts` begins with.
"""

from __future__ import annotations

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.boxes import contracts, defect
from ccpin.auditing.closures import BallClosures, columns, floats, inverse_of
from ccpin.auditing.legs import Legs
from ccpin.auditing.reach import CornerBox, Reach, above, below
from ccpin.auditing.reading import Array, ClaimedDocument, Integers, corners
from ccpin.auditing.stated_ranges import TURN, intervals

_BUDGET, _REACH = 20_000, 400  # boxes over one cell, and where the lemma alone is tried
_MOST = 6  # dependent coordinates: cells over which there are more are not searched (time)
_WIDE, _SLOPES = 0.8, 0.4  # rad: boxes whose turns are wider are halved before slopes are tried, and Ã
_SHRUNK = 0.7  # of a box's edges in all: narrowed again where less is left, else halved
_CUT = 0.1  # half width, rad or m, down to which first joints of chains are halved before others
_FINE = 0.002  # of the size: last joints of chains in no other loop are halved after all others move φ by less


class Emptiness:
    """What is needed to look at empty cells of a document, made once."""

    def __init__(self, closures: BallClosures, document: ClaimedDocument) -> None:
        self.closures, self.document = closures, document
        dependent = document.dependent
        turns = {int(j) for chain in document.chains for j in chain.joints[~chain.prismatic]}
        self.turning = dependent[document.periodic[dependent]]
        self.angles = np.array(sorted(turns & set(dependent.tolist())), dtype=np.int64)
        self.bounds = intervals(Reach(closures, document, frozenset()))
        endless = set(np.flatnonzero(~np.isfinite(self.bounds.high - self.bounds.low)).tolist())
        slides = {int(j) for chain in document.chains for j in chain.joints[chain.prismatic]}
        self.reach = Reach(closures, document, endless & slides)
        self.platform = Legs.of(self.reach)
        self.searched = not np.any(document.moduli) and not endless and len(dependent) <= _MOST

    def proved(self, k: int) -> bool | None:
        """Whether the k-th empty cell was proved to be so; ``None``: it was not."""
        boxes = [self.whole(*corners(self.document, self.document.empty, k))]
        if self._all_apart(boxes):
            return True
        return (self.searched and self.remaining(boxes, keep=False) == []) or None

    def _all_apart(self, boxes: list[CornerBox]) -> bool:
        """Whether boxes, halved as often as need be, are proved to be empty by `_apart`."""
        waiting, left = list(boxes), _REACH
        while waiting and left:
            left -= 1
            box = waiting.pop()
            if self._apart(box):
                continue
            if not self._apart(self._over_middle(box)):
                return False
            waiting += box.halves(self._widest(box, self.document.independent))
        return not waiting

    def _over_middle(self, box: CornerBox) -> CornerBox:
        """The part of a box over the middle of its q."""
        at, low, high = self.document.independent, box.low.copy(), box.high.copy()
        low[at] = high[at] = box.middle[at]
        return CornerBox(low, high)

    def _apart(self, box: CornerBox) -> bool:
        """Whether chains cannot meet by the lemmas of `reach` or `platform`."""
        return self.reach.too_far(box) or (self.platform is not None and self.platform.cannot_meet(box))

    def whole(self, low: Array, high: Array) -> CornerBox:
        """All that dependent coordinates can have over a cell's corners within the limits.

        Where that has no end it is 0 for slides (`reach` does without them) and a turn, which is all that chains see,
        for the others.
        """
        known = np.isfinite(self.bounds.high - self.bounds.low)
        most = np.where([j in self.reach.unbounded for j in range(len(known))], 0.0, TURN)
        full = CornerBox(np.where(known, self.bounds.low, -most), np.where(known, self.bounds.high, most))
        full.low[self.document.independent], full.high[self.document.independent] = low, high
        return full

    def remaining(self, boxes: list[CornerBox], keep: bool) -> list[CornerBox] | None:
        """Boxes that hold every closed configuration of some; `keep`: those on which φ_y is proved nonsingular.

        ``None`` where the budget ended before.
        """
        waiting, kept, left = list(boxes), list[CornerBox](), _BUDGET
        while waiting:
            if not left:
                return None
            left -= 1
            box = waiting.pop()
            if self.reach.too_far(box):
                continue
            smaller, regular = self.narrowed(box)
            if smaller is None:
                continue
            if keep and regular:
                kept.append(smaller)
            elif smaller.half.sum() < _SHRUNK * box.half.sum():
                waiting.append(smaller)
            else:
                waiting += smaller.halves(self._between(smaller) if keep else self.steepest(smaller))
        return kept

    def narrowed(self, box: CornerBox) -> tuple[CornerBox | None, bool]:
        """What of a box may close (``None``: nothing), and whether φ_y is proved nonsingular on all of it."""
        closures, dependent, balls = self.closures, self.document.dependent, box.balls()
        motions = closures.motions(balls)
        phi = closures.value(balls, motions)
        if not all(phi[i, 0].contains(0) for i in range(closures.m)):
            return None, False
        if np.any(box.half[self.angles] > _WIDE):
            return box, False
        middle = [arb(float(x)) for x in box.middle]
        start = closures.motions(middle)
        slope, value = closures.jacobian(motions), closures.value(middle, start)
        smaller = self._solved(box, middle, value, slope)
        if smaller is None or np.any(box.half[self.angles] > _SLOPES):
            return smaller, False
        A = inverse_of(floats(columns(closures.jacobian(start), dependent)))
        if A is None:
            return smaller, False
        along = A * slope
        return self._solved(smaller, middle, A * value, along), contracts(defect(columns(along, dependent)))

    def _solved(self, box: CornerBox, middle: list[arb], value: arb_mat, slope: arb_mat) -> CornerBox | None:
        """What of a box is left by 0 ∈ f(θ₀) + f_θ(box)(θ − θ₀), row by row, solved for dependent coordinates."""
        low, high = box.low.copy(), box.high.copy()
        delta = [ball - x for ball, x in zip(box.balls(), middle, strict=True)]
        for row in range(self.closures.m):
            terms = [slope[row, k] * delta[k] for k in range(self.closures.n_free)]
            if not sum(terms, value[row, 0]).contains(0):
                return None
            for j in (int(d) for d in self.document.dependent):
                if slope[row, j].contains(0):
                    continue
                rest = sum((t for k, t in enumerate(terms) if k != j), value[row, 0])
                found = middle[j] - rest / slope[row, j]
                low[j], high[j] = max(low[j], below(found)), min(high[j], above(found))
                if low[j] > high[j]:
                    return None
        return CornerBox(low, high)

    def steepest(self, box: CornerBox) -> int:
        """The coordinate to halve: what moves φ most, those last that the lemma does without."""
        moves = self._moves(box)
        first = self.reach.first[int(np.argmax(moves[self.reach.first]))]
        return int(first) if moves[first] > _FINE else int(np.argmax(moves))

    def _between(self, box: CornerBox) -> int:
        """The coordinate to halve where boxes are kept: the same, but of q as late as of those last."""
        first = np.intersect1d(self.reach.first, self.document.dependent)
        wide = np.any(box.half[first] > _CUT)
        return self._widest(box, first) if wide else int(np.argmax(self._moves(box)))

    def _widest(self, box: CornerBox, among: Integers) -> int:
        return int(among[int(np.argmax(self._moves(box)[among]))])

    def _moves(self, box: CornerBox) -> Array:
        """How far φ moves over a box with each coordinate, as shares of its size."""
        slope = np.abs(self.closures.at(box.middle)[1]).max(axis=0, initial=0.0)
        size = slope.max(initial=1e-9)
        return np.asarray((slope / size + 0.1) * box.half)
