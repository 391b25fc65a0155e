"""Cells said to hold no closed configuration.

Where all dependent coordinates turn, boxes of their whole turns over the cell are halved until each is shown to hold
none: by the lemma of `reach`, or a row of φ over the box, or of

    Ãφ(θ) ∈ Ãφ(θ₀) + Ãφ_θ(box)(θ − θ₀)

that 0 is not in; what of a box the latter leaves, solved for one coordinate at a time, takes its place. Where a
dependent coordinate slides, or there are more than six, the lemma alone is tried, over parts of the cell.
"""

from __future__ import annotations

import numpy as np
from flint import arb

from ccpin.auditing.closures import Closures, exact
from ccpin.auditing.document import Array, Document, Integers, corners
from ccpin.auditing.reach import Box, Reach, above, below

_BUDGET, _REACH = 8000, 400  # boxes over one cell, and where the lemma alone is tried
_MOST = 6
_SLOPES = 0.4  # rad: boxes whose turns are wider are halved before slopes are tried
_SHRUNK = 0.7
_FINE = 0.002  # of the size: last joints of chains in no other loop are halved after all others move φ by less


class Emptiness:
    """What is needed to look at empty cells of a document, made once."""

    def __init__(self, closures: Closures, document: Document) -> None:
        self.closures, self.document = closures, document
        slides = {int(j) for c in document.chains for j, p in zip(c.joints, c.prismatic, strict=True) if p}
        sliding = slides & set(document.dependent.tolist())
        self.reach = Reach(closures, document, sliding)
        known = bool(np.all(document.periodic[document.dependent])) and not np.any(document.moduli)
        self.searched = known and not sliding and len(document.dependent) <= _MOST

    def proved(self, k: int) -> bool | None:
        """Whether the k-th empty cell was proved to be so; ``None`` where there is no way to look at it."""
        low, high = corners(self.document, self.document.empty, k)
        full = Box(np.full(self.closures.n_free, -np.pi - 1e-9), np.full(self.closures.n_free, np.pi + 1e-9))
        full.low[self.document.independent], full.high[self.document.independent] = low, high
        waiting, left = [full], _BUDGET if self.searched else _REACH
        while waiting and left:
            left -= 1
            box = waiting.pop()
            if self.reach.too_far(box):
                continue
            if not self.searched:
                waiting += box.halves(self._widest(box, self.document.independent))
                continue
            smaller = self._narrowed(box)
            if smaller is None:
                continue
            if smaller.half.sum() < _SHRUNK * box.half.sum():
                waiting.append(smaller)
            else:
                waiting += smaller.halves(self._worst(smaller))
        return not waiting if self.searched or not waiting else None

    def _narrowed(self, box: Box) -> Box | None:
        """The box without some of what closes nothing; ``None`` if that is all of it."""
        closures, balls = self.closures, box.balls()
        motions = closures.motions(balls)
        phi = closures.value(balls, motions)
        if not all(phi[i, 0].contains(0) for i in range(closures.m)):
            return None
        dependent = self.document.dependent
        if np.any(box.half[dependent] > _SLOPES):
            return box
        middle = box.middle
        slope = closures.at(middle)[1]
        try:
            A = exact(np.linalg.inv(slope[:, dependent]).astype(np.float64))
        except np.linalg.LinAlgError:
            return box
        point = [arb(float(x)) for x in middle]
        constant = A * closures.value(point, closures.motions(point))
        along = A * closures.jacobian(motions)
        delta = [b - x for b, x in zip(balls, point, strict=True)]
        low, high = box.low.copy(), box.high.copy()
        for row, j in enumerate(int(d) for d in dependent):
            terms = [along[row, k] * delta[k] for k in range(closures.n_free)]
            total = sum(terms, constant[row, 0])
            if not total.contains(0):
                return None
            if along[row, j].contains(0):
                continue
            found = point[j] - (sum((t for k, t in enumerate(terms) if k != j), constant[row, 0])) / along[row, j]
            low[j], high[j] = max(low[j], below(found)), min(high[j], above(found))
            if low[j] > high[j]:
                return None
        return Box(low, high)

    def _worst(self, box: Box) -> int:
        """The coordinate to halve: what moves φ most, those last that the lemma does without."""
        moves = self._moves(box)
        first = self.reach.first[int(np.argmax(moves[self.reach.first]))]
        return int(first) if moves[first] > _FINE else int(np.argmax(moves))

    def _widest(self, box: Box, among: Integers) -> int:
        return int(among[int(np.argmax(self._moves(box)[among]))])

    def _moves(self, box: Box) -> Array:
        """How far φ moves over a box with each coordinate, as shares of its size."""
        slope = np.abs(self.closures.at(box.middle)[1]).max(axis=0, initial=0.0)
        size = slope.max(initial=1e-9)
        return np.asarray((slope / size + 0.1) * box.half)
