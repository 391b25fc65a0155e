"""σ on every sheet over cells that are known to be regular, carried from one counted point of each part to all of it.

A *part* is a connected union of cells over which no configuration is singular, so that every q of it has as many closed
configurations as one that was counted (Proposition C of `counting`). A cell is certified when as many boxes of Theorem
N are proved over it, each glued at a common face to a box of a certified neighbour, no two to the same one. Neighbours'
boxes carry different solutions, so these do, and they are all there is over the cell. Over the other cells, those that
hold a fold of some sheets, the sheets that have none there are carried on one by one, as far as Theorem N goes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ccpin.arrays import Array, Indices, Mask, joined, rows_of
from ccpin.covering.cells import CellStatus, CellTree, place
from ccpin.covering.faces import CellFaces, contacts_of
from ccpin.covering.proposals.krawczyk import certify_points
from ccpin.covering.proposals.solving import newton
from ccpin.covering.proposals.tasks import CellsToProve, glue_boxes, prove_cells
from ccpin.covering.region import Region
from ccpin.covering.runner import Report, Runner
from ccpin.proof.cell_tree import LEVELS
from ccpin.proof.equations import Problem
from ccpin.proof.newton import Boxes, encloses, predict, without_turns

_CHUNK = 2000  # boxes of a task
_NEAR = 1e-6  # rad, m: pairs worth a proof
_NEWTON = 12  # steps


class CountedRegion(NamedTuple):
    """A part: its cells, the cell that was counted, and all solutions over that cell's centre, (k, n′)."""

    cells: Indices
    counted: int
    theta: Array


class Members(NamedTuple):
    """Boxes by cell: box k of a cell that has several, (K,) each; sorted by cell."""

    cell: Indices
    box: Indices


def parts_of(tree: CellTree, region: Region, regular: Indices) -> list[Indices]:
    """The connected unions of regular leaves, the largest first."""
    if not regular.size:
        return []
    contacts = contacts_of(tree, region, regular)
    inside = np.isin(contacts.leaf, regular)
    number = np.full(len(tree.child), -1, dtype=np.intp)
    number[regular] = np.arange(len(regular))
    ends = number[contacts.cell[inside]], number[contacts.leaf[inside]]
    graph = coo_array((np.ones(len(ends[0])), ends), shape=(len(regular), len(regular)))
    labels = connected_components(graph, directed=False)[1]
    size = np.bincount(labels, weights=tree.shares(regular))
    return [regular[labels == k] for k in np.argsort(-size, kind="stable")]


class Glued(NamedTuple):
    """Pairs of boxes that carry the same σ at a face, (K,) each, and the face's middle in the coordinates of each."""

    first: Indices
    second: Indices
    at_first: Array
    at_second: Array


class _Continued(NamedTuple):
    """Boxes over K cells, each carried on from a known one over a common face.

    Attributes:
        cell: The cells, of shape (K,).
        boxes: The boxes.
        good: Whether each is proved, and glued to the one it came from.
        origin, at_origin, at_cell: That one, and the face's middle in the coordinates of each.
    """

    cell: Indices
    boxes: Boxes
    good: Mask
    origin: Indices
    at_origin: Array
    at_cell: Array


class Front:
    """Certified boxes of all sheets, growing from the counted cells.

    Attributes:
        boxes: The boxes.
        members: Which boxes each certified cell has.
        glued: Which boxes carry the same σ as the one they were reached from.
    """

    def __init__(
        self,
        runner: Runner,
        region: Region,
        tree: CellTree,
        parts: list[CountedRegion],
        depth: int,
        report: Report,
    ) -> None:
        self.runner, self.problem, self.region, self.tree, self.parts = runner, runner.problem, region, tree, parts
        self._smallest, self._report = 1 << (LEVELS - depth), report
        none, n = np.zeros(0, dtype=np.intp), runner.problem.system.n
        no_boxes = certify_points(self.problem, np.zeros((1, self.problem.system.n_free))).boxes.without_rows(n)
        self.boxes, self.members = no_boxes, Members(none, none)
        self.glued = Glued(none, none, np.zeros((0, n)), np.zeros((0, n)))
        self._passed = set[tuple[int, int]]()
        self.part = np.full(len(tree.child), -1, dtype=np.intp)
        for k, part in enumerate(parts):
            self.part[part.cells] = k
        self.tree.status[np.flatnonzero(self.part >= 0)] = CellStatus.UNREACHED

    def run(self) -> None:
        """Certify what can be reached.

        Raises:
            Stopped: An interrupt was asked for; what was certified by then is kept.
        """
        for k in range(len(self.parts)):
            self._first(k)
        while self._wave():
            waiting = self.tree.leaves(CellStatus.UNREACHED)
            self._report(self.tree, len(self.boxes.kappa), int(np.sum(self.part[waiting] >= 0)))
        while self._pass():
            self._report(self.tree, len(self.boxes.kappa), 0)

    def _first(self, k: int) -> None:
        """Certify the counted cell of a part, or that piece of it which holds the counted point."""
        part = self.parts[k]
        q = place(self.tree, self.region, np.array([part.counted]))[0]
        if not len(part.theta):
            self.tree.status[part.cells] = CellStatus.EMPTY
            return
        cell = np.array([part.counted])
        point = certify_points(self.problem, part.theta)
        while True:
            items = np.repeat(cell, len(part.theta))
            found, proved = self._proved(items, part.theta, part.theta)
            delta = q - found.centre[:, self.problem.system.independent]
            ball = point.boxes.centre, point.boxes.radius, point.boxes.modes
            good = proved & encloses(self.problem, found, np.tile(delta[:1], (len(items), 1)), *ball)
            if np.all(good & point.proved):
                self.tree.status[items] = CellStatus.CERTIFIED
                self._add(items, found)
                return
            if not self._split(cell).size:
                return
            cell = self.tree.locate(self.region.cell_coordinates(q))

    def _wave(self) -> bool:
        """Try every cell beside a certified one; whether there were any."""
        leaves = self.tree.leaves()
        waiting = leaves[(self.tree.status[leaves] == CellStatus.UNREACHED) & (self.part[leaves] >= 0)]
        contacts = contacts_of(self.tree, self.region, waiting)
        beside = np.flatnonzero(self.tree.status[contacts.leaf] == CellStatus.CERTIFIED)
        beside = beside[self.part[contacts.leaf[beside]] == self.part[contacts.cell[beside]]]
        if not beside.size:
            return False
        order = beside[np.lexsort((contacts.leaf[beside], -contacts.area[beside], contacts.cell[beside]))]
        first = order[np.flatnonzero(np.diff(contacts.cell[order], prepend=-1))]
        self._try(rows_of(contacts, first))
        return True

    def _try(self, contacts: CellFaces) -> None:
        rows, origin = self._over(contacts.leaf)
        found = self._continued(rows_of(contacts, rows), origin)
        failed = np.unique(found.cell[~found.good])
        kept = rows_of(found, ~np.isin(found.cell, failed))
        self.tree.status[kept.cell] = CellStatus.CERTIFIED
        self._carry(kept)
        self._split(failed)

    def _carry(self, found: _Continued) -> None:
        """Add boxes that were carried on."""
        numbers = len(self.boxes.kappa) + np.arange(len(found.cell))
        self.glued = joined([self.glued, Glued(found.origin, numbers, found.at_origin, found.at_cell)])
        self._add(found.cell, found.boxes)

    def _pass(self) -> bool:
        """Carry single sheets on over cells that are not certified; whether any box was new."""
        leaves = self.tree.leaves()
        status = self.tree.status
        still = leaves[(status[leaves] != CellStatus.CERTIFIED) & (status[leaves] != CellStatus.EMPTY)]
        contacts = contacts_of(self.tree, self.region, still)
        contacts = rows_of(contacts, np.isin(contacts.leaf, self.members.cell))
        rows, origin = self._over(contacts.leaf)
        fresh = np.array(
            [(int(c), int(b)) not in self._passed for c, b in zip(contacts.cell[rows], origin, strict=True)]
        )
        if not np.any(fresh):
            return False
        rows, origin = rows[fresh], origin[fresh]
        self._passed.update(zip(contacts.cell[rows].tolist(), origin.tolist(), strict=True))
        found = self._continued(rows_of(contacts, rows), origin)
        found = rows_of(found, found.good)
        before = len(self.boxes.kappa)
        while found.cell.size:
            found = rows_of(found, ~self._known(found.cell, found.boxes))
            first = np.unique(found.cell, return_index=True)[1]
            self._carry(rows_of(found, first))
            found = rows_of(found, np.setdiff1d(np.arange(len(found.cell)), first))
        return len(self.boxes.kappa) > before

    def _known(self, cells: Indices, boxes: Boxes) -> Mask:
        """Whether boxes carry the σ of one that their cell has."""
        rows, other = self._over(cells)
        at = place(self.tree, self.region, cells[rows])[0]
        same = _near(self.problem, (boxes.take(rows), at), (self.boxes.take(other), at))
        rows, other, at = rows[same], other[same], at[same]
        independent = self.problem.system.independent
        one, known = boxes.take(rows), self.boxes.take(other)
        result = np.zeros(len(cells), dtype=np.bool_)
        if rows.size:
            there = at - one.centre[:, independent], at - known.centre[:, independent]
            agree = glue_boxes(self.runner, one, there[0], known, there[1], _CHUNK)
            result[rows[agree]] = True
        return result

    def _continued(self, contacts: CellFaces, origin: Indices) -> _Continued:
        """Boxes over cells from one box each beyond a common face; which are proved and glued to it."""
        items, parents = contacts.cell, self.boxes.take(origin)
        independent = self.problem.system.independent
        at_origin, at_cell = self.region.position(contacts.at_leaf), self.region.position(contacts.at_cell)
        delta = at_origin - parents.centre[:, independent]
        start = predict(self.problem, parents, delta)
        start[:, independent] = at_cell
        boxes, good = self._proved(items, start, parents.centre)
        tried = np.flatnonzero(good)
        found = boxes.take(tried)
        there = at_cell[tried] - found.centre[:, independent]
        good[tried] = glue_boxes(self.runner, parents.take(tried), delta[tried], found, there, _CHUNK)
        return _Continued(items, boxes, good, origin, at_origin, at_cell)

    def _over(self, cells: Indices) -> tuple[Indices, Indices]:
        """Pairs (k, box) of cells and the boxes they have."""
        low = np.searchsorted(self.members.cell, cells, side="left")
        count = np.searchsorted(self.members.cell, cells, side="right") - low
        rows = np.repeat(np.arange(len(cells)), count)
        offset = np.arange(len(rows)) - np.repeat(np.cumsum(count) - count, count)
        return rows, self.members.box[np.repeat(low, count) + offset]

    def _proved(self, cells: Indices, start: Array, turn_to: Array) -> tuple[Boxes, Mask]:
        """Boxes over cells from configurations near them, and which are proved."""
        centre, half = place(self.tree, self.region, cells)
        found = prove_cells(self.runner, CellsToProve(centre, half, start, turn_to), _CHUNK)
        return found.boxes, found.proved

    def _add(self, cells: Indices, boxes: Boxes) -> None:
        count = len(self.boxes.kappa)
        self.boxes = joined([self.boxes, boxes])
        members = joined([self.members, Members(cells, count + np.arange(len(cells)))])
        self.members = rows_of(members, np.argsort(members.cell, kind="stable"))

    def _split(self, cells: Indices) -> Indices:
        """Halve cells along their longest edge; those that may not be halved are undecided. The new leaves."""
        size = self.tree.size[cells]
        divisible = np.any(size > self._smallest, axis=1)
        self.tree.status[cells[~divisible]] = CellStatus.UNDECIDED
        cells, cut = cells[divisible], np.argmax(size[divisible], axis=1)
        children = self.tree.split(cells, cut)
        self.part = np.concatenate([self.part, np.repeat(self.part[cells], 2)])
        return children


def glued_pairs(runner: Runner, region: Region, tree: CellTree, members: Members, boxes: Boxes) -> Glued:
    """All pairs of boxes on the two sides of a face that are proved to carry the same σ there.

    Raises:
        Stopped: An interrupt was asked for.
    """
    problem = runner.problem
    cells = np.unique(members.cell)
    contacts = contacts_of(tree, region, cells)
    both = np.flatnonzero(np.isin(contacts.leaf, cells) & contacts.upper)
    contacts = rows_of(contacts, both)
    at_cell, at_leaf = region.position(contacts.at_cell), region.position(contacts.at_leaf)
    low = [np.searchsorted(members.cell, side, side="left") for side in (contacts.cell, contacts.leaf)]
    count = [
        np.searchsorted(members.cell, side, side="right") - start
        for side, start in zip((contacts.cell, contacts.leaf), low, strict=True)
    ]
    face = np.repeat(np.arange(len(both)), count[0] * count[1])
    offset = np.arange(len(face)) - np.repeat(np.cumsum(count[0] * count[1]) - count[0] * count[1], count[0] * count[1])
    first = members.box[low[0][face] + offset // np.maximum(count[1][face], 1)]
    second = members.box[low[1][face] + offset % np.maximum(count[1][face], 1)]
    near = _near(problem, (boxes.take(first), at_cell[face]), (boxes.take(second), at_leaf[face]))
    first, second, face = first[near], second[near], face[near]
    one, other, independent = boxes.take(first), boxes.take(second), problem.system.independent
    there = at_cell[face] - one.centre[:, independent], at_leaf[face] - other.centre[:, independent]
    same = glue_boxes(runner, one, there[0], other, there[1], _CHUNK)
    face = face[same]
    return Glued(first[same], second[same], at_cell[face], at_leaf[face])


def _near(problem: Problem, one: tuple[Boxes, Array], other: tuple[Boxes, Array]) -> Mask:
    """Whether two boxes' solutions at two spellings of one q agree as computed: the others need no proof tried."""
    values, dependent = [], problem.system.dependent
    for boxes, q in (one, other):
        delta = q - boxes.centre[:, problem.system.independent]
        values.append(newton(problem, predict(problem, boxes, delta), _NEWTON).theta[:, dependent])
    gap = without_turns(values[0] - values[1], problem.system.periodic[dependent])
    return np.asarray(np.abs(gap).max(axis=1, initial=0.0) < _NEAR)
