"""What the search for sheets hands to the kernel, cells, points that are counted, boxes, and what it gets."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, Indices, Mask, joined, rows_of
from ccpin.covering.cells import CellStatus, CellTree, place
from ccpin.covering.claims import Seams, cells_of, proved_boxes, proved_glue
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.region import Region
from ccpin.covering.runner import Arrays, Runner
from ccpin.domain.documents.store import HasBoxes
from ccpin.domain.sheets.counting import solutions_task
from ccpin.domain.sheets.cover import CountedRegion, Glued, Members, parts_of
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.exhausted import Excluded
from ccpin.proof.facts import Fact, prove
from ccpin.proof.newton import Boxes
from ccpin.proof.ranges import Ranges
from ccpin.proof.solution_counts import CompleteCells, CountedCells
from ccpin.work import Stopped


class HasSheets(HasBoxes, Protocol):
    """Boxes of sheets, over which cells they lie, which carry the same σ; how many there are, within which limits."""

    @property
    def ranges(self) -> Ranges:
        """With the limits that are kept."""

    @property
    def members(self) -> Members:
        """Which lie over which cells."""

    @property
    def glued(self) -> Glued:
        """Which carry the same σ at a common point."""

    @property
    def count(self) -> NDArray[np.int64]:
        """How many configurations the q of each cell have."""


@dataclass(frozen=True, eq=False)
class ProvedSheets:
    """Facts about sheets.

    Attributes:
        cells: How many configurations there are over cells, and over which cells all are in boxes (`CompleteCells`).
        solutions: The boxes.
        glue: Which of them carry the same σ at a common point.
    """

    cells: Fact
    solutions: Fact
    glue: tuple[Fact, ...]

    @property
    def count(self) -> NDArray[np.int64]:
        """How many configurations the q of each cell have; −1 where that is not proved."""
        return np.asarray(self.cells.found["count"])

    @property
    def boxes(self) -> Boxes:
        """The boxes."""
        boxes: Boxes = self.solutions.claim.boxes
        return boxes

    @property
    def members(self) -> Members:
        """Which boxes lie over which cells."""
        return Members(self.cells.claim.cell, self.cells.claim.box)

    @property
    def glued(self) -> Glued:
        """The pairs of boxes that carry the same σ, and a common point in the coordinates of each."""
        claims = [fact.claim for fact in self.glue]
        first, second, at_first, at_second = (
            np.concatenate([getattr(claim, name) for claim in claims]) for name in Seams._fields
        )
        q = self.boxes.centre[:, self.solutions.claim.equations.system.independent]
        return Glued(first, second, q[first] + at_first, q[second] + at_second)

    def says(self, sheets: HasSheets) -> bool:
        """Whether these facts are about such sheets, and say that of their cells."""
        over, cells = self.cells.premises[0].premises[0].claim, self.cells.claim
        own = [*self.boxes, *self.members, *self.glued[:2], self.count]
        own += [over.lower, over.upper, over.wrapped, cells.cut, cells.child, over.limits]
        told = [*sheets.boxes, *sheets.members, *sheets.glued[:2], sheets.count]
        told += [*cells_of(sheets.region, sheets.tree).values(), sheets.ranges.limits]
        same = all(np.array_equal(one, other) for one, other in zip(told, own, strict=True))
        return same and closures_of(sheets.reading.problem).digest == self.cells.digest


_COUNTED, _AT_ONCE = 64, 8  # parts, and how many at once


def excluded_over(problem: Problem, region: Region, ranges: Ranges, tree: CellTree, kept: Mask) -> Fact:
    """The fact about the leaves that are not kept: no closed configuration over them is singular or at a limit.

    Raises:
        Stopped: An interrupt was asked for.
    """
    claim = Excluded(
        closures_of(problem),
        **cells_of(region, tree),
        kept=kept,
        limits=ranges.limits,
        middle=ranges.middle,
        singular=np.ones(1, dtype=np.bool_),
    )
    return prove(claim)


def counted_over(problem: Problem, excluded: Fact, cell: Indices, q: Array, found: list[Boxes]) -> Fact:
    """The fact about how many configurations there are over parts, from boxes over a q (K, n) in a cell of each."""
    none = certify_boxes(problem, np.zeros((0, problem.system.n_free)), q[:0], np.eye(problem.system.n)).boxes
    solutions, kept = proved_boxes(problem, joined([none, *found]))
    point = np.repeat(np.arange(len(found)), [len(boxes.kappa) for boxes in found])[kept]
    claim = CountedCells(closures_of(problem), cell=np.asarray(cell, dtype=np.int64), q=q, point=point)
    return prove(claim, excluded, solutions)


def counted_parts(
    runner: Runner, tree: CellTree, region: Region, ranges: Ranges, regular: Indices
) -> tuple[list[CountedRegion], Fact]:
    """The largest parts of cells that are said to be regular, those that were counted, and the fact about them.

    Once an interrupt was asked for nothing more is counted.
    """
    problem, kept, found = runner.problem, np.ones(len(tree.child), dtype=np.bool_), list[Boxes]()
    try:
        runner.check()
        kept[regular] = False
        excluded = excluded_over(problem, region, ranges, tree, kept)
    except Stopped:
        excluded = excluded_over(problem, region, ranges, tree, np.ones_like(kept))
    unions = parts_of(tree, region, np.flatnonzero(excluded.found["empty"]))[:_COUNTED]
    cells = np.array([int(cells[int(np.argmax(tree.shares(cells)))]) for cells in unions], dtype=np.intp)
    q = place(tree, region, cells)[0]
    with suppress(Stopped):
        for first in range(0, len(unions), _AT_ONCE):
            chunks: list[Arrays] = [(*ranges, middle) for middle in q[first : first + _AT_ONCE]]
            found += [Boxes(*arrays) for arrays in runner.map(solutions_task, chunks)]  # type: ignore[arg-type]
    cells, q = cells[: len(found)], q[: len(found)]
    counted = counted_over(problem, excluded, cells, q, found)
    theta, point, own = counted.premises[1].claim.centre, counted.claim.point, counted.found["own"]
    known = np.flatnonzero(counted.found["count"][cells] >= 0)
    return [CountedRegion(unions[k], int(cells[k]), theta[own & (point == k)]) for k in known], counted


def proved_sheets(
    problem: Problem, tree: CellTree, boxes: Boxes, members: Members, glued: Glued, counted: Fact
) -> ProvedSheets:
    """The facts about boxes of sheets; what the kernel refuses of them is left out."""
    solutions, kept = proved_boxes(problem, boxes)
    number = np.where(kept, np.cumsum(kept) - 1, -1)
    members = rows_of(members, kept[members.box])
    glued = rows_of(glued, kept[glued.first] & kept[glued.second])
    first, second = number[glued.first], number[glued.second]
    q = boxes.take(kept).centre[:, problem.system.independent]
    seams = Seams(first, second, glued.at_first - q[first], glued.at_second - q[second])
    claim = CompleteCells(
        closures_of(problem),
        cut=np.asarray(tree.cut, dtype=np.int64),
        child=np.asarray(tree.child, dtype=np.int64),
        cell=np.asarray(members.cell, dtype=np.int64),
        box=np.asarray(number[members.box], dtype=np.int64),
    )
    return ProvedSheets(prove(claim, counted, solutions), solutions, proved_glue(problem, seams, (solutions,)))


def proved_again(runner: Runner, sheets: HasSheets) -> ProvedSheets:
    """The facts about sheets of which only what they say is known."""
    tree, leaves = sheets.tree, sheets.tree.leaves()
    counted = counted_parts(runner, tree, sheets.region, sheets.ranges, leaves[sheets.count[leaves] >= 0])[1]
    return proved_sheets(runner.problem, tree, sheets.boxes, sheets.members, sheets.glued, counted)


def mark(tree: CellTree, proved: ProvedSheets) -> bool:
    """Call those leaves undecided that are called more than is proved of them; whether there were any."""
    any_was = False
    for status, known in (
        (CellStatus.CERTIFIED, proved.cells.found["complete"]),
        (CellStatus.EMPTY, proved.count == 0),
    ):
        leaves = tree.leaves(status)
        tree.status[leaves[~known[leaves]]] = CellStatus.UNDECIDED
        any_was |= not known[leaves].all()
    return any_was
