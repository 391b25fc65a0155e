"""That the rest of a region holds no singular closed configuration but those on a document's curves.

The search is the auditor's own, so that no covering need be stored: from the region and whole turns of the dependent
joints (the ranges stated, of those that slide), cut into equal parts; of the document it uses the tubes, proved apart,
and the boxes listed as uncovered. A part is halved until each box of θ is shown to hold none, or only what a tube
holds, or lies in a listed box.

**Lemma A.** On a box of θ no configuration closes where 0 is not in φ(box), nor where 0 is not in a row of
Pφ(θ_c) + Pφ_θ(box)(θ − θ_c), P any matrix; solved for one coordinate each row leaves a part of the box. None is
singular where |1 − Pφ_y(box)|u < u for a P and a u > 0.

*Proof.* The mean value theorem, and Neumann's series. ∎

**Lemma B.** Let A hold [φ_y; lᵀ] over a box of θ, P be a matrix with last column p, and u > 0 have
|p| + |1 − PA|u ≤ u, |1 − PA|u < u. Then each w ≠ 0 with φ_y w = 0 in the box is a multiple of one with lᵀw = 1, and
that has |w − p| ≤ |1 − PA|u.

*Proof.* Where lᵀw = 0, w = (1 − PA)w with |1 − PA| of spectral radius below 1, so w = 0. Else lᵀw = 1 may be had:
w = p + (1 − PA)w, hence |w| ≤ Σ |1 − PA|ᵏ|p| ≤ u. ∎

**Lemma C.** Let x = x_c + st + e, |s| ≤ σ, |e| ≤ r, e_j = 0, hold all (θ, w) of a box by Lemma B, X a box about
these, P a matrix with row j zero. Each zero of G among them has e in −PG(x_c) − PG′(X)t s + (1 − PG′(X))e, which may be
cut with |e| ≤ r again and again. Where that leaves nothing, none of the box is singular; where what it leaves lies in a
proved tube with the same l, all that are lie on its curve.

*Proof.* G(x) = G(x_c) + M(st + e) with M in the hull of G′(X); P times that is 0, and e is added on both sides. ∎

Sums of slopes over boxes are in balls; corners of boxes are doubles, outward, and listed boxes are 1e-12 wider.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat
from scipy.linalg import qr

from ccpin.auditing.boxes import contracts, defect
from ccpin.auditing.closures import Closures, columns, exact, floats
from ccpin.auditing.curves import Placed, Singular, placed, turns, without_turns
from ccpin.auditing.document import Array, Curves, Integers
from ccpin.auditing.reach import Box, Reach, above, below

_FINE = 0.15  # rad: last joints of chains are cut after all others
_CELL = 0.4  # rad: how wide parts are
_FEWEST, _MOST = 6, 10  # how often all is halved
_BUDGET, _LEAST = 20_000, 1e-6  # boxes of a part, and how narrow
_WIDER = 1e-12  # region, ranges and listed boxes
_SLOPES = 0.9  # rad: boxes whose turns are wider are halved before slopes are tried
_NEAR = 1.5  # half lengths of the nearest tube: wider boxes are in none
_BESIDE, _PASSES, _GAIN = 3, 3, 0.8
_SHRUNK, _WIDE = 0.7, 3.0
_HELD = 0.2  # of a box: where a listed box holds so much the rest is cut off


class Cover:
    """What is needed to look at parts of a document's region, made once."""

    def __init__(self, closures: Closures, document: Curves) -> None:
        self.closures, self.document = closures, document
        self.turning = turns(closures, document)
        self.tubes = [placed(closures, document, k) for k in range(len(document.tubes))]
        size = closures.n_free
        self._free = np.array(self.turning[:size])
        self.reach, self.every = Reach(closures, document, frozenset()), np.arange(size)
        self._middles = np.array([tube.theta for tube in document.tubes]).reshape(-1, size)
        self._lengths = np.array([tube.half for tube in document.tubes])
        self._listed = 0.5 * (document.uncovered_lower + document.uncovered_upper)
        self.parts = parts(closures, document)
        self._reach = 0.5 * (document.uncovered_upper - document.uncovered_lower) + _WIDER

    def proved(self, number: int) -> bool:
        """Whether a part was proved to hold no singular configurations but those of tubes and listed boxes."""
        waiting, left = [self.parts[number]], _BUDGET
        while waiting:
            box, left = waiting.pop(), left - 1
            rest = self._left_of(box)
            if rest is None:
                continue
            if left <= 0 or rest.box.half.max() < _LEAST:
                return False
            face = self._face(rest.box)
            if face is not None:
                waiting += rest.box.cut(*face)
            elif rest.box.half.sum() < _SHRUNK * box.half.sum():
                waiting.append(rest.box)
            else:
                waiting += rest.box.halves(rest.axis)
        return True

    def _left_of(self, box: Box) -> _Left | None:
        """What may hold other singular configurations of a box; ``None``: nothing."""
        if self._is_listed(box) or self.reach.too_far(box):
            return None
        balls = box.balls()
        motions = self.closures.motions(balls)
        phi = self.closures.value(balls, motions)
        if not all(phi[i, 0].contains(0) for i in range(self.closures.m)):
            return None
        at, slope = _Middle.of(self.closures, box), self.closures.jacobian(motions)
        if box.half[self._free].max(initial=0.0) > _SLOPES:
            return _Left(box, self._steepest(box, at.slope, self.every))
        if self._regular(slope, at.slope):
            return None
        left = self._closing(box, slope, at)
        return None if left is None or self._in_a_tube(left.box) else left

    def _regular(self, slope: arb_mat, at: Array) -> bool:
        """Whether φ_y is regular on the box (Lemma A)."""
        dependent = self.document.dependent
        try:
            inverse = _inverse(at[:, dependent])
        except np.linalg.LinAlgError:
            return False
        return contracts(defect(exact(inverse) * columns(slope, dependent)))

    def _closing(self, box: Box, slope: arb_mat, at: _Middle) -> _Left | None:
        """The box without some of what closes nothing (Lemma A), P the inverse of the columns that move φ most.

        It is to be halved along another column, or where these are wider than the others make them along the widest.
        """
        m = self.closures.m
        pivots = qr(at.slope * box.half, mode="r", pivoting=True)[1][:m]
        try:
            P = exact(_inverse(at.slope[:, pivots]))
        except np.linalg.LinAlgError:
            return _Left(box, self._steepest(box, at.slope, self.every))
        constant, along = P * at.value, P * slope
        low, high, half = box.low.copy(), box.high.copy(), box.half
        rest = np.setdiff1d(self.every, pivots)
        implied = np.abs(floats(along)[:, rest]) @ half[rest]
        wide = np.array([bool(along[row, int(j)].contains(0)) for row, j in enumerate(pivots)])
        wide |= half[pivots] > _WIDE * implied
        for row in range(m):
            deltas = [arb(float(a)).union(arb(float(b))) - x for a, b, x in zip(low, high, at.point, strict=True)]
            terms = [along[row, k] * delta for k, delta in enumerate(deltas)]
            if not sum(terms, constant[row, 0]).contains(0):
                return None
            j = int(pivots[row])
            if along[row, j].contains(0):
                continue
            others = sum((term for k, term in enumerate(terms) if k != j), constant[row, 0])
            found = at.point[j] - others / along[row, j]
            low[j], high[j] = max(low[j], below(found)), min(high[j], above(found))
            if low[j] > high[j]:
                return None
        left = Box(low, high)
        return _Left(left, self._steepest(left, at.slope, pivots[wide] if np.any(wide) else rest))

    def _steepest(self, box: Box, slope: Array, among: Integers) -> int:
        """Along which of some coordinates φ moves most over a box."""
        moves = np.abs(slope).max(axis=0, initial=0.0)
        moves = (moves / moves.max(initial=1e-9) + 0.1) * box.half
        first = np.intersect1d(among, self.reach.first)
        if first.size and moves[first].max() > _FINE:
            return int(first[int(np.argmax(moves[first]))])
        return int(among[int(np.argmax(moves[among]))])

    def _in_a_tube(self, box: Box) -> bool:
        """Whether all singular configurations of the box are on one tube's curve, or there are none (Lemma C)."""
        gap = box.middle - self._middles
        gap -= np.where(self._free, 2.0 * np.pi * np.round(gap / (2.0 * np.pi)), 0.0)
        distance = np.abs(gap).max(axis=1)
        for k in np.argsort(distance, kind="stable")[:_BESIDE]:
            if box.half.max() <= _NEAR * self._lengths[k] and settled(box, self.tubes[int(k)], self.turning):
                return True
        return False

    def _is_listed(self, box: Box) -> bool:
        """Whether a listed box holds all of a box."""
        return bool(np.any(np.all(np.abs(self._off(box)) + box.half <= self._reach, axis=1)))

    def _off(self, box: Box) -> Array:
        """From the listed boxes' middles to a box's, without whole turns."""
        gap = box.middle - self._listed
        return np.asarray(gap - np.where(self._free, 2.0 * np.pi * np.round(gap / (2.0 * np.pi)), 0.0))

    def _face(self, box: Box) -> tuple[int, float] | None:
        """Where to cut a box of which a listed box holds a good part: its axis and place; ``None``: there is none."""
        middle, reach = box.middle - self._off(box), self._reach - 0.5 * _WIDER
        low, high = np.maximum(box.low, middle - reach), np.minimum(box.high, middle + reach)
        shares = np.maximum(high - low, 0.0) / np.maximum(2.0 * box.half, 1e-300)
        held = np.prod(shares, axis=1)
        if held.max(initial=0.0) < _HELD:
            return None
        k = int(np.argmax(held))
        axis = int(np.argmin(shares[k]))
        place = low[k, axis] if low[k, axis] - box.low[axis] > box.high[axis] - high[k, axis] else high[k, axis]
        return (axis, float(place)) if box.low[axis] < place < box.high[axis] else None


class _Left(NamedTuple):
    """What is left of a box, and along which axis it is to be halved."""

    box: Box
    axis: int


class _Middle(NamedTuple):
    """A box's middle, φ there in balls, and φ_θ in plain floating point."""

    point: list[arb]
    value: arb_mat
    slope: Array

    @staticmethod
    def of(closures: Closures, box: Box) -> _Middle:
        point = [arb(float(x)) for x in box.middle]
        motions = closures.motions(point)
        return _Middle(point, closures.value(point, motions), floats(closures.jacobian(motions)))


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def searched(document: Curves) -> Box:
    """The region, whole turns, and the ranges of what slides."""
    free = np.array([document.free(j) for j in range(document.couplings.shape[1])])
    low, high = np.full(len(free), -np.pi - 1e-9), np.full(len(free), np.pi + 1e-9)
    slides = [k for k, j in enumerate(document.dependent) if not free[int(j)]]
    chosen = document.dependent[slides]
    low[chosen], high[chosen] = document.range_lower[slides] - _WIDER, document.range_upper[slides] + _WIDER
    low[document.independent], high[document.independent] = document.lower - _WIDER, document.upper + _WIDER
    return Box(low, high)


def parts(closures: Closures, document: Curves) -> list[Box]:
    """Equal parts of that, cut along coordinates that are no chain's last."""
    found, first = [searched(document)], Reach(closures, document, frozenset()).first
    for depth in range(_MOST):
        axis = first[int(np.argmax(found[0].half[first]))]
        if depth >= _FEWEST and 2.0 * found[0].half[axis] <= _CELL:
            break
        found = [half for box in found for half in box.halves(int(axis))]
    return found


def listed_share(document: Curves) -> float:
    """How much of all that is searched lies in listed boxes, at most."""
    width = 2.0 * searched(document).half
    listed = document.uncovered_upper - document.uncovered_lower
    return float(min(1.0, np.prod(np.minimum(listed / width, 1.0), axis=1).sum()))


class _Slanted(NamedTuple):
    """x_c + st + e, |s| ≤ σ, e between the bounds (0 in row j)."""

    centre: list[arb]
    along: int
    tangent: Array
    half: float
    low: Array
    high: Array


def settled(box: Box, tube: Placed, turning: list[bool]) -> bool:
    """Lemmas B and C for a box of θ and a tube beside it."""
    system = tube.system
    around = system.closures.motions(box.balls())
    kernel = _kernel(box, tube, columns(system.closures.jacobian(around), system.dependent))
    if kernel is None:
        return False
    x = np.concatenate([box.middle, kernel[0]])
    extent = np.concatenate([np.nextafter(np.maximum(box.high - box.middle, box.middle - box.low), np.inf), kernel[1]])
    slope = system.at(x)[1]
    tangent = np.linalg.svd(slope)[2][-1]
    along = int(np.argmax(np.abs(tangent)))
    tangent = tangent / tangent[along]
    others = np.delete(np.arange(system.n_free), along)
    try:
        P = exact(_inverse(slope[:, others]))
    except np.linalg.LinAlgError:
        return False
    reach = (extent + np.abs(tangent) * extent[along]) * (1.0 + 1e-12)
    reach[along] = 0.0
    slanted = _Slanted([arb(float(v)) for v in x], along, tangent, float(extent[along]), -reach, reach)
    for _ in range(_PASSES):
        smaller = _narrowed(system, slanted, P, others)
        if smaller is None or _inside(smaller, tube, turning):
            return True
        if not np.any((smaller.high - smaller.low)[others] < _GAIN * (slanted.high - slanted.low)[others]):
            return False
        slanted = smaller
    return False


def _kernel(box: Box, tube: Placed, inner: arb_mat) -> tuple[Array, Array] | None:
    """p and |1 − PA|u of Lemma B."""
    m = tube.system.closures.m
    A = arb_mat(m + 1, m, [*inner.entries(), *tube.system.pairing])
    left = np.asarray(np.linalg.pinv(floats(A)), dtype=np.float64)
    rest = defect(exact(left) * A)
    rough = np.array([[float(x.upper()) for x in row] for row in rest])
    if not np.all(np.isfinite(rough)) or np.abs(rough).sum(axis=1).max() >= 10.0:
        return None
    u = np.linalg.solve(np.eye(m) - rough, np.abs(left[:, -1]) + 1e-12) if m else np.zeros(0)
    if not np.all(u > 0.0):
        return None
    u = u * (1.0 + 1e-6)
    image = [sum((x * arb(float(v)) for x, v in zip(row, u, strict=True)), arb(0)) for row in rest]
    sound = all(
        abs(arb(float(p))) + y <= float(v) and y < float(v) for p, y, v in zip(left[:, -1], image, u, strict=True)
    )
    return (left[:, -1], np.array([above(y) for y in image])) if sound else None


def _narrowed(system: Singular, box: _Slanted, P: arb_mat, others: Array) -> _Slanted | None:
    """What Lemma C leaves; ``None``: nothing."""
    middle = 0.5 * (box.low + box.high)
    centre = [x + arb(float(d)) for x, d in zip(box.centre, middle, strict=True)]
    half = np.nextafter(np.maximum(box.high - middle, middle - box.low), np.inf)
    half[box.along] = 0.0
    s = arb(0, box.half)
    tangent = [arb(float(t)) for t in box.tangent]
    around = [x + t * s + arb(0, float(r)) for x, t, r in zip(centre, tangent, half, strict=True)]
    slope = P * system.jacobian(system.motions(around))
    value = P * system.value(centre, system.motions(centre))
    run = slope * exact(box.tangent)
    low, high = np.zeros_like(half), np.zeros_like(half)
    for row, k in enumerate(map(int, others)):
        found = -value[row, 0] - run[row, 0] * s
        for column in map(int, others):
            found = found + (int(column == k) - slope[row, column]) * arb(0, float(half[column]))
        low[k], high[k] = max(-half[k], below(found)), min(half[k], above(found))
        if low[k] > high[k]:
            return None
    return _Slanted(centre, box.along, box.tangent, box.half, low, high)


def _inside(box: _Slanted, tube: Placed, turning: list[bool]) -> bool:
    """Whether all of it lies in a tube with the same l."""
    j, s = tube.tube.along, arb(0, box.half)
    gap = [x - y for x, y in zip(box.centre, tube.centre, strict=True)]
    gap = [without_turns(g) if turn else g for g, turn in zip(gap, turning, strict=True)]
    e = [arb(float(a)).union(arb(float(b))) for a, b in zip(box.low, box.high, strict=True)]
    t = [arb(float(x)) for x in box.tangent]
    sign = tube.tangent[j]
    reach = (gap[j] + t[j] * s + e[j]) * sign
    if not abs(reach) <= tube.tube.half:
        return False
    for k in map(int, tube.others):
        way = tube.tangent[k] * sign
        off = gap[k] - way * gap[j] + (t[k] - way * t[j]) * s + e[k] - way * e[j]
        if not abs(off) <= tube.radius[k]:
            return False
    return True
