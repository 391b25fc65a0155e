"""A region of q-space in cells over each of which all closed configurations are known, by branch and prune.

Every cell starts with one candidate, a box of all coordinates: the cell and the whole range of each dependent one. A
candidate is narrowed (Proposition N of `narrowing`), and dropped where that shows it to be empty. From what is left
Newton's method leads to a closed configuration over the cell's centre; where Theorem K proves σ from there over the
cell and Proposition U that nothing else is in the candidate, the candidate is done with and σ is among the cell's
sheets. Other candidates are halved, and where the cell's own size is what makes them wide, the cell is (its sheets stay
proved on either half). A cell without candidates is *complete*: its sheets are all there is over it, and if there
are none, it is empty. So at the smallest cells the candidates left enclose every singular configuration over the region.

Branch and prune of generalized aspects is that of S. Caro, D. Chablat, A. Goldsztejn, D. Ishii and C. Jermann, "A branch
and prune algorithm for the computation of generalized aspects of parallel robots", Artificial Intelligence 211, 2014.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.domain.atlas.cells import LEVELS, WHOLE, CellTree, Region
from ccpin.domain.boxes import Boxes, Problem, certify_boxes, certify_points, closure_values
from ccpin.domain.newton import encloses, newton, predict
from ccpin.domain.sheets.narrowing import Candidates, alone_in, narrowed

_NEWTON = 12
_WIDEST = 1.5  # rad: wider candidates are halved before Newton's method is tried from their middle
_NEAR = 1e-6
_RATIO = 4.0
_CURVED = 0.5
_FLOOR = 1e-3
_ROUNDS = 60


class Members(NamedTuple):
    """Which proved boxes carry a sheet over which cells: pairs, (K,) each, and σ over the cell's centre, (K, n′)."""

    cell: Indices
    box: Indices
    theta: Array


class Paver:
    """Cells, sheets and candidates under construction.

    Attributes:
        tree: The cells.
        members: The sheets over each leaf.
        left: The candidates left over the smallest leaves.
    """

    def __init__(self, problem: Problem, region: Region, ranges: tuple[Array, Array]) -> None:
        self.problem, self.region, self.ranges = problem, region, ranges
        self.tree = CellTree.whole(problem.system.n)
        size = problem.system.n_free
        none = np.zeros(0, dtype=np.intp)
        self.boxes = certify_points(problem, np.zeros((1, size))).boxes.without_rows(problem.system.n)
        self.members = Members(none, none, np.zeros((0, size)))
        self.left = self._whole_candidates(none)
        self.tried = 0

    def run(self, depth: int, report: Callable[[], None] | None = None) -> None:
        """Pave the region, halving each of its edges `depth` times at most."""
        smallest = 1 << (LEVELS - depth)
        waiting = self._whole_candidates(np.zeros(1, dtype=np.intp))
        while waiting.cell.size:
            waiting = self._settle(waiting)
            cells = np.unique(waiting.cell)
            size = self.tree.size[cells]
            small = np.all(size <= smallest, axis=1)
            last = np.isin(waiting.cell, cells[small])
            self.left = joined([self.left, rows_of(waiting, last)])
            waiting = self._halve_cells(rows_of(waiting, ~last), cells[~small])
            self.waiting_n = len(waiting.cell)
            if report is not None:
                report()

    def place(self, cells: Indices) -> tuple[Array, Array]:
        """Centres and half widths of cells in q-space."""
        size = self.tree.size[cells]
        return self.region.position(self.tree.lower[cells] + 0.5 * size), 0.5 * self.region.width * (size / WHOLE)

    def _whole_candidates(self, cells: Indices) -> Candidates:
        system = self.problem.system
        centre = np.zeros((len(cells), system.n_free))
        half = np.zeros_like(centre)
        low, high = self.ranges
        centre[:, system.dependent], half[:, system.dependent] = 0.5 * (low + high), 0.5 * (high - low) + 1e-12
        centre[:, system.independent], half[:, system.independent] = self.place(cells)
        return Candidates(cells, centre, half, np.zeros((len(cells), system.m, system.n)))

    def _settle(self, waiting: Candidates) -> Candidates:
        """Narrow, prove and halve candidates until only their cells' size is in the way."""
        stuck = [rows_of(waiting, slice(0))]
        for _ in range(_ROUNDS):
            if not waiting.cell.size:
                break
            self.tried += len(waiting.cell)
            waiting = narrowed(self.problem, waiting, False)
            if not waiting.cell.size:
                break
            waiting = narrowed(self.problem, waiting, True)
            if not waiting.cell.size:
                break
            cut, wide = self._cut(waiting)
            stuck.append(rows_of(waiting, ~wide))
            waiting = _halved(rows_of(waiting, wide), cut[wide])
        return joined([*stuck, waiting])

    def _cut(self, waiting: Candidates) -> tuple[Indices, Mask]:
        """Along which coordinate each candidate would be halved, and whether that is due before its cell is halved."""
        system = self.problem.system
        jacobian = closure_values(self.problem, waiting.centre)[1]
        column = np.abs(jacobian).max(axis=1)
        column = np.maximum(column, _FLOOR * column.max(axis=1, keepdims=True))
        moves = column * waiting.half
        ours, cells = moves[:, system.dependent], moves[:, system.independent].max(axis=1, initial=0.0)
        cut = np.argmax(ours, axis=1)
        scale = column.max(axis=1)
        return system.dependent[cut], ours.max(axis=1, initial=0.0) > np.maximum(_RATIO * cells, _CURVED * np.sqrt(scale * cells))

    def _halve_cells(self, waiting: Candidates, cells: Indices) -> Candidates:
        """Halve cells along their longest edge, and pass their sheets and candidates on."""
        if not cells.size:
            return waiting
        jacobian = closure_values(self.problem, waiting.centre)[1][:, :, self.problem.system.independent]
        stretch = np.zeros((len(cells), self.problem.system.n))
        np.maximum.at(stretch, np.searchsorted(cells, waiting.cell), np.abs(jacobian).max(axis=1))
        width = self.region.width * (self.tree.size[cells] / WHOLE)
        children = self.tree.split(cells, np.argmax(stretch * width, axis=1))
        system = self.problem.system
        parts = []
        for side in (0, 1):
            child = children[side::2][np.searchsorted(cells, waiting.cell)]
            centre, half = waiting.centre.copy(), waiting.half.copy()
            place, half[:, system.independent] = self.place(child)
            shift = place - centre[:, system.independent]
            centre[:, system.independent] = place
            centre[:, system.dependent] += apply(waiting.slopes, shift)
            half[:, system.dependent] += 1e-15 * (1.0 + np.abs(centre[:, system.dependent]))
            parts.append(Candidates(child, centre, half, waiting.slopes))
        held = np.isin(self.members.cell, cells)
        passed = rows_of(self.members, held)
        at = np.searchsorted(cells, passed.cell)
        self.members = joined(
            [rows_of(self.members, ~held), *(self._placed(children[side::2][at], passed.box) for side in (0, 1))]
        )
        return joined(parts)

    def _placed(self, cells: Indices, box: Indices) -> Members:
        """Sheets over cells, with σ over the cells' centres."""
        boxes = rows_of(self.boxes, box)
        delta = self.place(cells)[0] - boxes.centre[:, self.problem.system.independent]
        return Members(cells, box, newton(self.problem, predict(self.problem, boxes, delta), _NEWTON).theta)

    def _done(self, waiting: Candidates) -> Mask:
        """Prove σ from each candidate over its cell; whether that is all there is in the candidate."""
        system = self.problem.system
        done = np.zeros(len(waiting.cell), dtype=np.bool_)
        angles = waiting.half[:, system.dependent][:, system.periodic[system.dependent]]
        rows = np.flatnonzero(np.all(angles <= _WIDEST, axis=1))
        if not rows.size:
            return done
        start = waiting.centre[rows].copy()
        found = newton(self.problem, start, _NEWTON)
        rows, theta = rows[found.settled], found.theta[found.settled]
        held = rows_of(waiting, rows)
        turns = np.round((theta - held.centre) / (2.0 * np.pi)) * system.periodic
        turns[:, system.independent] = 0.0
        theta = theta - 2.0 * np.pi * turns
        tried = certify_boxes(self.problem, theta, held.half[:, system.independent], np.eye(system.n))
        good = np.flatnonzero(tried.proved)
        boxes, held, rows = tried.boxes.take(good), rows_of(held, good), rows[good]
        if good.size:
            known = self._enter(boxes, held.cell)
            done[rows] = known & alone_in(self.problem, boxes, held)
        return done

    def _enter(self, boxes: Boxes, cells: Indices) -> Mask:
        """Make proved boxes over cells sheets of theirs, unless their σ is there already; whether it is (always)."""
        known = np.zeros(len(cells), dtype=np.bool_)
        point = certify_points(self.problem, boxes.centre)
        usable = point.proved
        while True:
            known |= self._same(boxes, point.boxes, cells, usable & ~known)
            rows = np.flatnonzero(usable & ~known)
            if not rows.size:
                return known
            first = rows[np.unique(cells[rows], return_index=True)[1]]
            count = len(self.boxes.kappa)
            self.boxes = joined([self.boxes, boxes.take(first)])
            entered = Members(cells[first], count + np.arange(len(first)), boxes.centre[first])
            self.members = joined([self.members, entered])
            known[first] = True

    def _same(self, boxes: Boxes, points: Boxes, cells: Indices, asked: Mask) -> Mask:
        """Whether each box's σ is proved to be that of a sheet over its cell."""
        result = np.zeros(len(cells), dtype=np.bool_)
        rows, members = _pairs(cells, self.members.cell, asked)
        system = self.problem.system
        gap = boxes.centre[rows] - self.members.theta[members]
        gap -= np.round(gap / (2.0 * np.pi)) * (2.0 * np.pi * system.periodic)
        near = np.abs(gap).max(axis=1, initial=0.0) < _NEAR
        rows, members = rows[near], members[near]
        if rows.size:
            known = rows_of(self.boxes, self.members.box[members])
            ball = points.take(rows)
            delta = ball.centre[:, system.independent] - known.centre[:, system.independent]
            inside = encloses(self.problem, known, delta, ball.centre, ball.radius, ball.modes)
            result[rows[inside]] = True
        return result


def _pairs(cells: Indices, of: Indices, asked: Mask) -> tuple[Indices, Indices]:
    """Pairs (k, j) with cells[k] = of[j], for the k asked."""
    order = np.argsort(of, kind="stable")
    rows = np.flatnonzero(asked)
    low = np.searchsorted(of[order], cells[rows], side="left")
    high = np.searchsorted(of[order], cells[rows], side="right")
    count = high - low
    first = np.repeat(rows, count)
    offset = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    return first, order[np.repeat(low, count) + offset]


def _halved(boxes: Candidates, cut: Indices) -> Candidates:
    """Both halves of candidates."""
    rows = np.arange(len(cut))
    half = boxes.half.copy()
    half[rows, cut] *= 0.5
    parts = []
    for side in (-1.0, 1.0):
        centre = boxes.centre.copy()
        centre[rows, cut] += side * half[rows, cut]
        grown = half.copy()
        grown[rows, cut] *= 1.0 + 4e-16
        grown[rows, cut] += 4e-16 * (1.0 + np.abs(centre[rows, cut]))
        parts.append(Candidates(boxes.cell, centre, grown, boxes.slopes))
    return joined(parts)
