"""Claims about how many closed configurations there are: over the q of cells, and that all of them are in boxes.

Proposition C: over a connected union of cells without singular configurations and without any at a limit their number
is the same everywhere, so that it is enough to count them over one q. There branch and prune leaves nothing but boxes
in each of which there is one (Theorem N) and no other (Proposition U).
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations
from typing import Annotated

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ccpin.arrays import Array, Indices, Mask, apply, rows_of
from ccpin.proof.candidates import BEYOND, halved, narrowed_both, over_all, to_halve
from ccpin.proof.cell_tree import WHOLE, HalvedTree, faces_of, lie_within, tree_of
from ccpin.proof.equations import Problem
from ccpin.proof.exhausted import Excluded
from ccpin.proof.facts import Examined, Fact, Form, NotProvedError, ProvableClaim, provable, require
from ccpin.proof.narrowing import Candidates, alone_in
from ccpin.proof.newton import Boxes, without_turns
from ccpin.proof.ranges import Ranges
from ccpin.proof.rounding import SLACK, TURN, blur, sum_of
from ccpin.proof.solutions import at_centres, boxes_of

_MOST = 1_000_000  # candidates over one q
_INNER = 0.25  # of a cell: so far from its middle a q is surely in it
_ROOM = 1e-13  # rad, m
_NEAR = 1e-6  # beside a candidate: which boxes are tried for it


@provable
@dataclass(frozen=True, eq=False)
class CountedCells(ProvableClaim):
    """How many closed configurations that keep the limits every q of some cells has (Proposition C).

    Premises: that over some cells none is singular (`Excluded`), and a fact about boxes over the q
    that are counted; these are points of q, h = 0.

    Attributes:
        cell: Leaves over which none is singular, one at most of each connected union of them, of shape (K,).
        q: A point well inside each, of shape (K, n).
        point: Over which of these q each box is, of shape (B,).

    Found: `count` (T,), of the excluded tree's cells; −1 of those of which nothing is known. `own` (B,): which boxes
    hold those that were counted, each one of its own.
    """

    cell: Annotated[Indices, Form("K", "i", 0)]
    q: Annotated[Array, Form("KP")]
    point: Annotated[Indices, Form("B", "i", 0)]
    theorem = "counting"

    def examined(self, *premises: Fact) -> Examined:
        """Each q counted, and every cell that is connected with its cell."""
        require([type(fact.claim) for fact in premises[:1]] == [Excluded], "nothing says that none is singular")
        excluded, boxes = premises[0].claim, boxes_of(premises[1:])
        require(excluded.singular, "what is excluded are not the singular ones")
        require(len(self.point) == len(boxes.kappa) and np.all(self.point < len(self.cell)), "a box over no q")
        self._require_over(boxes)
        tree = excluded.cells()
        part = _parts(tree, excluded, premises[0].found["empty"])
        require(self.cell < len(part), "a cell that is none")
        require(well_inside(excluded, tree, self.cell, self.q), "a q that is not in its cell")
        ranges, count = excluded.ranges(), np.full(len(part), -1, dtype=np.int64)
        own = np.zeros(len(self.point), dtype=np.bool_)
        require(
            len(np.unique(part[self.cell])) == len(self.cell) and np.all(part[self.cell] >= 0), "cells counted twice"
        )
        for k, q in enumerate(self.q):
            with suppress(NotProvedError):
                rows = np.flatnonzero(self.point == k)
                own[rows] = own_solutions(self.equations.problem, ranges, q, boxes.take(rows))
                count[part == part[self.cell[k]]] = own[rows].sum()
        return Examined(np.ones(1, dtype=np.bool_), {"count": count, "own": own})

    def _require_over(self, boxes: Boxes) -> None:
        """That boxes are over their q alone."""
        independent = self.equations.system.independent
        exactly = np.array_equal(boxes.centre[:, independent], self.q[self.point]) and not np.any(boxes.half)
        require(exactly and boxes.half.shape[1] == len(independent), "a box that is not over its q")


@provable
@dataclass(frozen=True, eq=False)
class CompleteCells(ProvableClaim):
    """Over some cells all closed configurations that keep the limits are in boxes, each in one of its own.

    Premises: `CountedCells`, and facts about boxes, numbered through.

    Attributes:
        cut, child: The tree of cells: that of which they were counted, its leaves halved further, of shape (T,).
        cell, box: Which boxes lie over which leaves, of shape (K,).

    Found: `complete` (T,), over which cells all are; `count` (T,), how many.
    """

    cut: Annotated[Indices, Form("T", "i", 0)]
    child: Annotated[Indices, Form("T", "i", -1)]
    cell: Annotated[Indices, Form("K", "i", 0)]
    box: Annotated[Indices, Form("K", "i", 0)]
    theorem = "counting"

    def examined(self, *premises: Fact) -> Examined:
        """As many boxes over a cell as were counted, no two with the same configuration, each within the limits."""
        require([type(fact.claim) for fact in premises[:1]] == [CountedCells], "nothing says how many there are")
        excluded, boxes = premises[0].premises[0].claim, boxes_of(premises[1:])
        require((self.box < len(boxes.kappa)) & (self.cell < len(self.child)), "a box or a cell that is none")
        tree = tree_of(self.cut, self.child, len(excluded.lower))
        count = self._counts(tree.reached, excluded, premises[0])
        require(tree.reached[self.cell] & (self.child[self.cell] < 0), "a box over no leaf")
        over = lie_within(self.equations, excluded.region, tree, self.cell, boxes, self.box)
        q = boxes.centre[self.box][:, self.equations.system.independent]
        over &= well_inside(excluded, tree, self.cell, q)
        y, error = at_centres(self.equations, premises[1:], self.box)
        ranges = excluded.ranges()
        inside = (y - error >= ranges.lower + ranges.edge) & (y + error <= ranges.upper - ranges.edge)
        good = over & np.isfinite(error).all(axis=1) & inside[:, ~ranges.turning].all(axis=1)
        number = np.bincount(self.cell[good], minlength=len(count))
        all_there = (number == count) & (np.bincount(self.cell, minlength=len(count)) == count)
        all_there[self._alike(q, y, error)] = False
        return Examined(np.ones(1, dtype=np.bool_), {"complete": all_there, "count": count})

    def _counts(self, reached: Mask, excluded: Excluded, counted: Fact) -> Indices:
        """How many configurations the cells of the finer tree have."""
        coarse, cut, child = len(excluded.child), excluded.cut, excluded.child
        inner = np.flatnonzero(child >= 0)
        same = coarse <= len(self.child) and np.array_equal(self.child[inner], child[inner])
        require(same and np.array_equal(self.cut[inner], cut[inner]), "cells of another tree")
        count = np.full(len(self.child), -1, dtype=np.int64)
        count[:coarse] = counted.found["count"]
        cells = np.flatnonzero((child < 0) & reached[:coarse] & (self.child[:coarse] >= 0))
        while cells.size:
            below = self.child[cells]
            count[below] = count[below + 1] = count[cells]
            cells = np.concatenate([below, below + 1])
            cells = cells[self.child[cells] >= 0]
        return count

    def _alike(self, q: Array, y: Array, error: Array) -> Indices:
        """The cells over which two boxes are not proved to hold different configurations.

        Over their middles q (K, n), which are to be the same, y (K, m) is known to within an error (K, m).
        """
        periodic, order = self.equations.system.periodic[self.equations.system.dependent], np.argsort(self.cell)
        cell, found = self.cell[order], [self.cell[:0]]
        for apart in range(1, len(order)):
            pairs = np.flatnonzero(cell[apart:] == cell[:-apart])
            if not pairs.size:
                break
            one, other = order[pairs], order[pairs + apart]
            gap = np.abs(without_turns(y[one] - y[other], periodic))
            differ = np.any(gap > (error[one] + error[other]) * SLACK + _ROOM, axis=1)
            differ &= np.all(q[one] == q[other], axis=1)
            found.append(cell[pairs[~differ]])
        return np.concatenate(found)


def well_inside(excluded: Excluded, tree: HalvedTree, cells: Indices, q: Array) -> Mask:
    """Whether points q (K, n) are in the middle half of cells (K,), of shape (K,)."""
    middle, rest = excluded.region.position(tree.lower[cells] + 0.5 * tree.size[cells])
    gap, of_gap = sum_of(q, -middle)
    width = (excluded.upper - excluded.lower) * (tree.size[cells] / WHOLE)
    return np.asarray(np.all(np.abs(gap + (of_gap - rest)) <= _INNER * width, axis=1))


def _parts(tree: HalvedTree, excluded: Excluded, ours: Mask) -> Indices:
    """The connected union of such leaves that each of them belongs to; −1 of other cells, of shape (T,).

    The ends of a full turn are one where no more than what is excluded beyond them may be between them.
    """
    closed = excluded.wrapped & (np.abs(excluded.upper - excluded.lower - TURN) <= BEYOND)
    faces = faces_of(tree, excluded.cut, excluded.child, closed)
    both = ours[faces.upper] & ours[faces.lower]
    ends = faces.upper[both], faces.lower[both]
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(len(ours), len(ours)))
    return np.where(ours, connected_components(graph, directed=False)[1], -1)


def own_solutions(problem: Problem, ranges: Ranges, q: Array, boxes: Boxes) -> Mask:
    """Which boxes hold the closed configurations within the ranges over q (n,), all that there are, each once.

    Raises:
        NotProvedError: There may be others, or two boxes may hold the same one, or one at an end of the ranges.
    """
    inside, beyond = within(problem, ranges, boxes)
    require(inside | beyond, "a configuration that may be at the end of a range")
    waiting, tried = over_all(problem, ranges, q, q), 0
    while True:
        waiting = narrowed_both(problem, ranges, waiting)
        waiting = rows_of(waiting, ~alone_over(problem, waiting, boxes))
        tried += len(waiting.cell)
        if not waiting.cell.size:
            break
        cut, due = to_halve(problem, waiting)
        require(due & (tried < _MOST), "there may be a configuration that is not known")
        waiting = halved(problem, waiting, cut)
    own, one = inside.copy(), [boxes.take(np.array([k])) for k in range(len(inside))]
    for first, second in combinations(np.flatnonzero(inside).tolist(), 2):
        if not different(problem, one[first], one[second]):
            alike = same(problem, one[first], one[second]) or same(problem, one[second], one[first])
            require(alike, "configurations that may be the same")
            own[second] = False
    return own


def alone_over(problem: Problem, waiting: Candidates, boxes: Boxes) -> Mask:
    """Which candidates over one q hold no configuration but that of one of B boxes, of shape (K,)."""
    done, dependent = np.zeros(len(waiting.cell), dtype=np.bool_), problem.system.dependent
    for k in range(len(boxes.kappa)):
        gap = np.abs(waiting.centre - boxes.centre[k])[:, dependent]
        near = np.all(gap <= waiting.half[:, dependent] + _NEAR, axis=1)
        rows = np.flatnonzero(near & ~done)
        if rows.size:
            done[rows] = alone_in(problem, boxes.take(np.full(len(rows), k)), rows_of(waiting, rows))
    return done


def within(problem: Problem, ranges: Ranges, boxes: Boxes) -> tuple[Mask, Mask]:
    """Which boxes' configurations lie within the ranges that are no full turns, and which beyond; some do not say."""
    ended = ~ranges.turning
    y = boxes.centre[:, problem.system.dependent][:, ended]
    spread = (_spread(boxes) + ranges.edge)[:, ended]
    low, high = ranges.lower[ended], ranges.upper[ended]
    inside = np.all((y - spread >= low) & (y + spread <= high), axis=1)
    return inside, np.any((y + spread < low) | (y - spread > high), axis=1)


def same(problem: Problem, one: Boxes, other: Boxes) -> bool:
    """Whether two boxes over one q are proved to carry the same configuration (Proposition U)."""
    system = problem.system
    centre = other.centre + _gap(problem, one, other)
    half = np.zeros_like(centre)
    half[:, system.dependent] = _spread(one) + (blur(one.centre) + blur(other.centre))[:, system.dependent]
    ball = Candidates(np.zeros(1, dtype=np.intp), centre, half, one.directions[:, system.dependent])
    return bool(alone_in(problem, other, ball)[0])


def different(problem: Problem, one: Boxes, other: Boxes) -> bool:
    """Whether two boxes over one q are proved to carry different configurations."""
    gap = np.abs(_gap(problem, one, other)[:, problem.system.dependent])
    return bool(np.any(gap > (_spread(one) + _spread(other)) * SLACK + _ROOM))


def _gap(problem: Problem, one: Boxes, other: Boxes) -> Array:
    return without_turns(one.centre - other.centre, problem.system.periodic)


def _spread(box: Boxes) -> Array:
    """How far configurations may be from their boxes' centres, of shape (B, m)."""
    return apply(np.abs(box.modes), box.radius)
