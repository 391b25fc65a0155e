"""Cells over which a number of closed configurations is said, all of them nonsingular.

**Lemma.** Let every closed configuration over a cell that keeps the limits lie, up to whole turns, in one of finitely
many bounded boxes of all coordinates, on each of which |I − Ãφ_y|w < w for a matrix Ã and a w > 0 of its own, and which
lie within the limits and touch none.

1. None of them is singular, and every q of the cell has as many.
2. On a convex set of y over one q with such an Ã and w there is one at most.

*Proof.* Ãφ_y is nonsingular where |I − Ãφ_y| contracts. So near each of them closed configurations are one smooth
function of q, and they keep the limits there, as it is at none. They are a compact set over the cell, which is
connected: a covering with equally many sheets everywhere.
2: the mean of φ_y between two of them contracts alike, is nonsingular, and takes their difference to 0. ∎

The boxes are found by the search of `emptiness`. Those that hold the cell's middle are searched on there, over that q
alone, until each is empty or, by 2 for what it spans with the ball in which a solution is proved (`gluing.near`), holds
no other. Two such balls are told apart, or shown to hold the same solution by 2. What is left is their number.

A certified cell says besides that each of them is in a box of its own that is proved by Theorem N and covers the cell.
As each such box holds one solution over the middle and no two the same, the boxes hold all solutions over the cell: the
one in each is a continuous function of q, and functions that differ somewhere differ everywhere, by 1.
"""

from __future__ import annotations

import numpy as np
from flint import arb

from ccpin.auditing.boxes import contracts, defect
from ccpin.auditing.closures import columns, inverse_of
from ccpin.auditing.empty_cells import Emptiness
from ccpin.auditing.gluing import in_tube, near
from ccpin.auditing.reach import CornerBox
from ccpin.auditing.reading import Array, ClaimedDocument, Counts, StatedRanges, corners

_BUDGET = 2000  # boxes over one q
_TURN = 2.0 * np.pi  # angles this far apart, times a whole number, are one

Solution = tuple[Array, float]
"""θ, and the radius about its y within which a solution is proved to be."""


def counted(search: Emptiness, k: int) -> bool | None:
    """Whether what is said of the k-th counted cell was proved or, by another number, refuted; ``None``: neither."""
    document, counts = search.document, search.document.counts
    stated = document.ranges
    if counts is None or stated is None or not search.searched:
        return None
    boxes = counts.boxes[counts.of == counts.cells.number[k]]
    certified, said = bool(counts.certified[k]), int(counts.said[k])
    kept = search.remaining([search.whole(*corners(document, counts.cells, k))], keep=True)
    if kept is None:
        return None
    low, high = _exact_corners(document, counts, k)
    kept = _within(search, stated, kept)
    if kept is None:
        return None
    found = _over(search, kept, np.array([float((0.5 * (a + b)).mid()) for a, b in zip(low, high, strict=True)]))
    if found is None or len(found) != said:
        return None if found is None else False
    return not certified or _one_each(document, boxes.tolist(), found) or None


def _within(search: Emptiness, stated: StatedRanges, boxes: list[CornerBox]) -> list[CornerBox] | None:
    """Boxes that touch no limit and hold what closes in others; ``None`` where there is no end of those."""
    at, (lower, upper) = search.document.dependent, stated.limits.T
    waiting, found, left = list(boxes), list[CornerBox](), _BUDGET
    while waiting:
        left -= 1
        box = waiting.pop()
        if np.all(lower < box.low[at]) and np.all(box.high[at] < upper):
            found.append(box)
            continue
        if left <= 0:
            return None
        smaller = search.narrowed(box)[0]
        waiting += [] if smaller is None else smaller.halves(search.steepest(smaller))
    return found


def _over(search: Emptiness, boxes: list[CornerBox], q: Array) -> list[Solution] | None:
    """All closed configurations over one q that boxes hold; ``None`` where that is not proved."""
    waiting, found = list[CornerBox](), list[Solution]()
    independent = search.document.independent
    for box in boxes:
        if np.all(box.low[independent] <= q) and np.all(q <= box.high[independent]):
            low, high = box.low.copy(), box.high.copy()
            low[independent] = high[independent] = q
            waiting.append(CornerBox(low, high))
    left = _BUDGET
    while waiting:
        if not left:
            return None
        left -= 1
        box = waiting.pop()
        smaller = search.narrowed(box)[0]
        if smaller is None:
            continue
        solution = near(search.closures, search.document.dependent, smaller.middle)
        if solution is not None and _alone(search, smaller, solution):
            known = _among(search, found, solution)
            if known is None:
                return None
            found += [] if known else [solution]
        else:
            at = search.document.dependent
            waiting += smaller.halves(int(at[int(np.argmax(smaller.half[at]))]))
    return found


def _alone(search: Emptiness, box: CornerBox, solution: Solution) -> bool:
    """Whether 2 holds for what a box over one q spans with a solution's ball."""
    theta, radius = solution
    at, low, high = search.document.dependent, box.low.copy(), box.high.copy()
    low[at] = np.minimum(low[at], np.nextafter(theta[at] - radius, -np.inf))
    high[at] = np.maximum(high[at], np.nextafter(theta[at] + radius, np.inf))
    closures, middle = search.closures, 0.5 * (low + high)
    A = inverse_of(closures.at(middle)[1][:, at])
    slope = closures.jacobian(closures.motions(CornerBox(low, high).balls()))
    return A is not None and contracts(defect(A * columns(slope, at)))


def _among(search: Emptiness, found: list[Solution], solution: Solution) -> bool | None:
    """Whether a solution is one of those found, up to whole turns; ``None`` where that is not proved."""
    at, (theta, radius) = search.document.dependent, solution
    for other, reach in found:
        turns = np.where(np.isin(at, search.turning), np.round((other[at] - theta[at]) / _TURN), 0.0)
        moved = [arb(float(t)) + 2 * arb.pi() * int(n) for t, n in zip(theta[at], turns, strict=True)]
        gaps = [abs(arb(float(x)) - t) for x, t in zip(other[at], moved, strict=True)]
        if any(gap > arb(radius) + arb(reach) for gap in gaps):
            continue
        again, room = other.copy(), 1e-12 + 2.0 * radius
        again[at] = [float(t.mid()) for t in moved]
        spanned = CornerBox(np.minimum(other, again), np.maximum(other, again))
        spanned.low[at] -= room
        spanned.high[at] += room
        return True if _alone(search, spanned, (other, reach)) else None
    return False


def _one_each(document: ClaimedDocument, boxes: list[int], found: list[Solution]) -> bool:
    """Whether each solution over the middle of a cell is in the tube of a box of its own."""
    still = np.zeros(len(document.independent))
    free = list(boxes)
    for theta, radius in found:
        mine = next((b for b in free if in_tube(document, b, theta, radius, still)), None)
        if mine is None:
            return False
        free.remove(mine)
    return True


def _exact_corners(document: ClaimedDocument, counts: Counts, k: int) -> tuple[list[arb], list[arb]]:
    """A cell's corners, not rounded."""
    ends = [(arb(float(a)), arb(float(b)) - arb(float(a))) for a, b in zip(document.lower, document.upper, strict=True)]
    low, high = (
        [start + width * float(share) for (start, width), share in zip(ends, shares[k], strict=True)]
        for shares in (counts.cells.lower, counts.cells.upper)
    )
    return low, high
