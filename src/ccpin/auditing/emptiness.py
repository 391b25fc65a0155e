"""Cells said to hold no closed configuration.

**Lemma.** Let a closure's point rows read Σ_c W_c x_c + d = 0. Cut each chain anywhere: the head's tip h_c(θ) is a
point that the joints above the cut move; what is behind it are segments whose lengths seen by W_c are at most l_i. No
configuration of a box of all coordinates closes these rows where |Σ W_c h_c + d| > Σ l_i; nor, where the lengths are
exactly l_i, where l_k > |Σ W_c h_c + d| + Σ_{i≠k} l_i for some k.

*Proof.* Σ W_c h_c + d and the segments add up to 0: none is longer than all others together. ∎

W_c sees a segment's length as it is where W_cᵀW_c = I, and where W_cW_cᵀ = I and all turns of the chain before it are
about the direction that W_c does not see, so that they keep the part of it that W_c sees.

Where all dependent coordinates turn, boxes of their whole turns over the cell are halved until each is shown to hold
none: so, or by a row of φ over the box, or of

    Ãφ(θ) ∈ Ãφ(θ₀) + Ãφ_θ(box)(θ − θ₀)

with Ã = I or Ã ≈ φ_y⁻¹ that 0 is not in; what of a box this leaves, solved for one coordinate at a time, takes its
place. Where a dependent coordinate slides, or there are more than six, the lemma alone is tried, over parts of the
cell.

The same search, with boxes kept on which |I − Ãφ_y|w < w for some w > 0, is what `counts` begins with.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from flint import arb, arb_mat

from ccpin.auditing.boxes import contracts, defect
from ccpin.auditing.closures import Closures, Motion, Path, columns, exact, floats, motion_of
from ccpin.auditing.document import Array, Document, Integers, corners
from ccpin.auditing.lengths import least_size, norm_of, root_of, segments_of

_BUDGET, _REACH = 20_000, 400  # boxes over one cell, and where the lemma alone is tried
_MOST = 6
_TAIL = 0.6  # rad: joints that may turn more than this each way are behind the cut
_WIDE, _SLOPES = 0.8, 0.4  # rad: boxes whose turns are wider are halved before slopes are tried, and Ã
_SHRUNK, _CUT = 0.7, 0.1
_FINE = 0.002  # of the size: last joints of chains in no other loop are halved after all others move φ by less


class _Group(NamedTuple):
    """The chains of one closure's point rows: their numbers and the rows."""

    rows: tuple[int, ...]
    chains: tuple[int, ...]


class Ball(NamedTuple):
    """A box of all coordinates by its corners, as doubles."""

    low: Array
    high: Array

    @property
    def half(self) -> Array:
        """Half its widths."""
        return 0.5 * (self.high - self.low)

    def balls(self) -> list[arb]:
        """It in balls."""
        return [arb(float(a)).union(arb(float(b))) for a, b in zip(self.low, self.high, strict=True)]


class Emptiness:
    """What is needed to look at empty cells of a document, made once."""

    def __init__(self, closures: Closures, document: Document) -> None:
        self.closures, self.document = closures, document
        by_rows: dict[tuple[int, ...], list[int]] = {}
        for k, chain in enumerate(document.chains):
            rows = tuple(int(r) for r in np.flatnonzero(np.any(chain.weights != 0.0, axis=1)))
            by_rows.setdefault(rows, []).append(k)
        self.groups = [_Group(rows, tuple(chains)) for rows, chains in by_rows.items() if self._plain(rows, chains)]
        self.norms = [norm_of(path.weights) for path in closures.paths]
        self.segments = [segments_of(path, norm) for path, norm in zip(closures.paths, self.norms, strict=True)]
        slides = {int(j) for c in document.chains for j, p in zip(c.joints, c.prismatic, strict=True) if p}
        self._sliding = slides & set(document.dependent.tolist())
        linear = np.any(document.moduli) or np.any(document.couplings[:, document.dependent])
        known = bool(np.all(document.periodic[document.dependent])) and not linear
        own = set(document.dependent.tolist())
        ours = [[j for j in chain.joints.tolist() if j in own] for chain in document.chains]
        loops = [{j for k in group.chains for j in ours[k]} for group in self.groups]
        last = {joints[-1] for joints in ours if joints and sum(joints[-1] in loop for loop in loops) == 1}
        self._first = np.array(sorted({*range(closures.n_free)} - self._sliding - last), dtype=np.int64)
        self.searched = known and not self._sliding and len(document.dependent) <= _MOST

    def _plain(self, rows: tuple[int, ...], chains: list[int]) -> bool:
        document, chosen = self.document, list(rows)
        shared = any(
            k not in chains and np.any(chain.weights[chosen] != 0.0) for k, chain in enumerate(document.chains)
        )
        linear = np.any(document.couplings[chosen] != 0.0) or np.any(document.moduli[chosen] != 0.0)
        return not (shared or linear or any(document.chains[k].direction for k in chains))

    def proved(self, k: int) -> bool | None:
        """Whether the k-th empty cell was proved to be so; ``None`` where there is no way to look at it."""
        low, high = corners(self.document, self.document.empty, k)
        full = self.whole(low, high)
        if self.searched:
            return self.remaining([full], keep=False) == []
        waiting, left = [full], _REACH
        while waiting and left:
            left -= 1
            box = waiting.pop()
            if not self._too_far(box):
                waiting += halves(box, self._widest(box, self.document.independent))
        return not waiting or None

    def whole(self, low: Array, high: Array) -> Ball:
        """The box of all turns of the dependent coordinates over a cell's corners."""
        full = Ball(np.full(self.closures.n_free, -np.pi - 1e-9), np.full(self.closures.n_free, np.pi + 1e-9))
        full.low[self.document.independent], full.high[self.document.independent] = low, high
        return full

    def remaining(self, boxes: list[Ball], keep: bool) -> list[Ball] | None:
        """Boxes that hold every closed configuration of some; `keep`: those on which φ_y is proved nonsingular.

        ``None`` where the budget ended before.
        """
        waiting, kept, left = list(boxes), list[Ball](), _BUDGET
        while waiting:
            if not left:
                return None
            left -= 1
            box = waiting.pop()
            if self._too_far(box):
                continue
            smaller, regular = self.narrowed(box)
            if smaller is None:
                continue
            if keep and regular:
                kept.append(smaller)
            elif smaller.half.sum() < _SHRUNK * box.half.sum():
                waiting.append(smaller)
            else:
                waiting += halves(smaller, self._between(smaller) if keep else self._worst(smaller))
        return kept

    def _too_far(self, box: Ball) -> bool:
        """Whether the chains, cut where they turn freely, cannot meet."""
        balls, half = box.balls(), box.half
        for group in self.groups:
            gap, longest, shortest = [self.closures.offset[row, 0] for row in group.rows], list[arb](), list[arb]()
            for number in group.chains:
                chain, path = self.document.chains[number], self.closures.paths[number]
                pairs = zip(chain.joints.tolist(), chain.prismatic.tolist(), strict=True)
                free = [j in self._sliding if slides else half[j] > _TAIL for j, slides in pairs]
                cut = free.index(True) if any(free) else len(free)
                rest = self._rest(number, cut, balls)
                if rest is None:
                    break
                moved = path.weights * _head(path, cut, balls).x
                gap = [value + moved[row, 0] for value, row in zip(gap, group.rows, strict=True)]
                longest += [long for long, _ in rest]
                shortest += [short for _, short in rest]
            else:
                if _cannot_close(gap, longest, shortest):
                    return True
        return False

    def _rest(self, number: int, cut: int, balls: list[arb]) -> list[tuple[arb, arb]] | None:
        """The most and the least of the segments behind a cut; ``None`` where one slides without bounds."""
        turns, found = self.closures.paths[number].turns[cut:], list[tuple[arb, arb]]()
        for k, turn in enumerate(turns):
            segments = self.segments[number][cut + k]
            if turn.prismatic and turn.joint in self._sliding:
                return None
            found += [segments.before] if k else []
            if turn.prismatic:
                by = abs(balls[turn.joint])
                found.append((by * segments.along[0], least_size(by) * segments.along[1]))
        return [*found, self.segments[number][-1].before] if turns else []

    def narrowed(self, box: Ball) -> tuple[Ball | None, bool]:
        """What of a box may close (``None``: nothing), and whether φ_y is proved nonsingular on all of it."""
        closures, dependent, balls = self.closures, self.document.dependent, box.balls()
        motions = closures.motions(balls)
        phi = closures.value(balls, motions)
        if not all(phi[i, 0].contains(0) for i in range(closures.m)):
            return None, False
        if np.any(box.half[dependent] > _WIDE):
            return box, False
        middle = [arb(float(x)) for x in 0.5 * (box.low + box.high)]
        start = closures.motions(middle)
        slope, value = closures.jacobian(motions), closures.value(middle, start)
        smaller = self._solved(box, middle, value, slope)
        if smaller is None or np.any(box.half[dependent] > _SLOPES):
            return smaller, False
        try:
            A = exact(np.linalg.inv(floats(columns(closures.jacobian(start), dependent))).astype(np.float64))
        except np.linalg.LinAlgError:
            return smaller, False
        along = A * slope
        return self._solved(smaller, middle, A * value, along), contracts(defect(columns(along, dependent)))

    def _solved(self, box: Ball, middle: list[arb], value: arb_mat, slope: arb_mat) -> Ball | None:
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
                low[j], high[j] = max(low[j], _below(found)), min(high[j], _above(found))
                if low[j] > high[j]:
                    return None
        return Ball(low, high)

    def _worst(self, box: Ball) -> int:
        """The coordinate to halve: what moves φ most, those last that the lemma does without."""
        moves = self._moves(box)
        first = self._first[int(np.argmax(moves[self._first]))]
        return int(first) if moves[first] > _FINE else int(np.argmax(moves))

    def _between(self, box: Ball) -> int:
        """The coordinate to halve where boxes are kept: the same, but of q as late as of those last."""
        first = np.intersect1d(self._first, self.document.dependent)
        wide = np.any(box.half[first] > _CUT)
        return self._widest(box, first) if wide else int(np.argmax(self._moves(box)))

    def _widest(self, box: Ball, among: Integers) -> int:
        return int(among[int(np.argmax(self._moves(box)[among]))])

    def _moves(self, box: Ball) -> Array:
        """How far φ moves over a box with each coordinate, as shares of its size."""
        slope = np.abs(self.closures.at(0.5 * (box.low + box.high))[1]).max(axis=0, initial=0.0)
        size = slope.max(initial=1e-9)
        return np.asarray((slope / size + 0.1) * box.half)


def halves(box: Ball, axis: int) -> list[Ball]:
    """The two halves of a box."""
    middle = 0.5 * (box.low[axis] + box.high[axis])
    below, above = box.high.copy(), box.low.copy()
    below[axis] = above[axis] = middle
    return [Ball(box.low, below), Ball(above, box.high)]


def _head(path: Path, cut: int, balls: list[arb]) -> Motion:
    if cut == len(path.turns):
        return motion_of(path, balls)
    return motion_of(Path(path.turns[:cut], path.turns[cut].translation, False, path.weights), balls)


def _cannot_close(gap: list[arb], longest: list[arb], shortest: list[arb]) -> bool:
    """The lemma for a sum of heads, bounds of segments' lengths, and the lengths of those known exactly (else 0)."""
    least = root_of(sum((least_size(x) * least_size(x) for x in gap), arb(0)))
    most = root_of(sum((abs(x) * abs(x) for x in gap), arb(0)))
    total = sum(longest, arb(0))
    return least > total or any(short > most + (total - long) for short, long in zip(shortest, longest, strict=True))


def _below(x: arb) -> float:
    return float(np.nextafter(float(x.lower()), -np.inf))


def _above(x: arb) -> float:
    return float(np.nextafter(float(x.upper()), np.inf))
