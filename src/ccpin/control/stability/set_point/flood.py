"""The largest sublevel set of U around q_d that lies in good cells, by flooding them from the bottom.

Lemma F of `ccpin/proof/theorems/sublevel.md`: every union G of cells on the way has a level, the least lower bound of U
over the faces of its boundary; the highest of them is kept. Cells that carry different σ at a face are no neighbours in
the store, nor are their halves. All of it is a proposal: `sublevel_claim` checks G alone, and finds its level again.

The flood adds, one by one, the cell behind the lowest face of G's boundary. A cell that is not good (not proved, or
with ‖∂g/∂q‖ too large) is halved; where that is not allowed or could not raise the level noticeably, the face is
tightened by halving the cell before it; then the flood ends. Work is done only where U is lowest.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.set_point.certified_cells import Cell, CellStore, holding
from ccpin.control.stability.set_point.set_point_cells import CellPart
from ccpin.control.stability.set_point.well import Well

Limit = Literal["domain", "gain", "budget", "depth", "interrupted", "refused"]
_AHEAD = 16  # cells proved in one batch, those next in the flood: costs at most proofs that are not used


class FloodLimits(NamedTuple):
    """How much work a flood may do.

    Attributes:
        depth: How often a cell may be halved.
        cells: How many cells may be proved, beyond those that an atlas brings.
        tolerance: Relative accuracy of the level at which tightening ends.
    """

    depth: int
    cells: int
    tolerance: float = 5e-3


class Sublevel(NamedTuple):
    """What a flood found; it is proved elsewhere (`SublevelProved`).

    Attributes:
        level: c in joules; {U < c} around q_d lies in the members (0: nothing found).
        members: Numbers of the cells.
        limit: What ended the flood.
        point: Where, of shape (n,).
    """

    level: float
    members: tuple[int, ...]
    limit: Limit
    point: Array


class Flooded(NamedTuple):
    """How far a flood is: how many cells it has proved, and the level c in joules that holds so far."""

    cells: int
    level: float


class _Entry(NamedTuple):
    """A face of the boundary, ordered by its level; `beyond` is −1 where there is no cell."""

    level: float
    serial: int
    inside: int
    beyond: int
    face: CellPart
    point: Array
    slack: float


class Flood:
    """One flood; see the module's text.

    Args:
        store: Its cells.
        good: Which wells may be members.
        limits: When to give up.
        go_on: Asked before every cell, with how far it is; after ``False`` the level found so far stands.
    """

    def __init__(
        self, store: CellStore, good: Callable[[Well], bool], limits: FloodLimits, go_on: Callable[[Flooded], bool]
    ) -> None:
        self._store, self._good, self._limits, self._go_on = store, good, limits, go_on
        self._members: dict[int, int] = {}
        self._heap: list[_Entry] = []
        self._serial = 0
        self._added = 0
        self._level, self._at_level = 0.0, 0

    def run(self, q_d: Array) -> Sublevel:
        """Flood from the cells that hold q_d."""
        start = self._start(q_d)
        if isinstance(start, str):
            return Sublevel(0.0, (), start, q_d)
        for number in start:
            self._add(number)
        limit, point = self._flood(q_d)
        chosen = tuple(number for number, order in self._members.items() if order <= self._at_level)
        return Sublevel(self._level, chosen, limit, point) if self._level > 0.0 else Sublevel(0.0, (), limit, point)

    def _start(self, q_d: Array) -> list[int] | Limit:
        """Good cells around q_d, halved until they are; what forbids it, where they never are."""
        pending = [k for k, cell in enumerate(self._store.cells) if cell.live and _holds(cell, q_d)]
        found = list[int]()
        while pending:
            if not self._wanted():
                return "interrupted"
            number = pending.pop()
            cell = self._store[number]
            if cell.well is not None and self._good(cell.well):
                found.append(number)
                continue
            if cell.well is None:
                return "domain"
            if cell.depth >= self._limits.depth or self._spent():
                return "budget" if self._spent() else "depth"
            children = self._store.halve_proved(number)
            if children is None:
                return "domain"
            pending += [k for k in children if _holds(self._store[k], q_d)]
        return found or "domain"

    def _flood(self, q_d: Array) -> tuple[Limit, Array]:
        while self._heap:
            entry = heapq.heappop(self._heap)
            if not self._current(entry):
                continue
            if entry.level > self._level:
                self._level, self._at_level = entry.level, self._added
            if self._spent():
                return "budget", entry.point
            if not self._wanted():
                return "interrupted", entry.point
            limit = self._cross(entry)
            if limit is not None and not self._tighten(entry):
                return limit, entry.point
        return "domain", q_d

    def _cross(self, entry: _Entry) -> Limit | None:
        """Take the cell behind a face, or halve it; what forbids both."""
        if entry.beyond < 0:
            return "domain"
        cell = self._store[entry.beyond]
        if cell.state == "untried":
            self._prove_ahead(entry)
        if cell.well is not None and self._good(cell.well):
            self._add(entry.beyond)
            return None
        if cell.depth >= self._limits.depth or self._rise(entry) <= 0.1 * self._limits.tolerance * self._level:
            return "gain" if cell.well is not None else "domain"
        number = entry.beyond if cell.well is not None else entry.inside
        for child in self._store.split(entry.beyond, self._store.stretch(number)):
            for other in self._store[child].neighbours & self._members.keys():
                self._push(other, child)
        return None

    def _rise(self, entry: _Entry) -> float:
        """About how much U rises from a face across the cell behind it: what halving that cell could gain."""
        cell = self._store[entry.beyond]
        well = cell.well or self._store.well(entry.inside)
        slope = well.gradient + well.hessian @ (entry.point - well.centre)
        return float(np.abs(slope) @ (cell.upper - cell.lower))

    def _prove_ahead(self, entry: _Entry) -> None:
        """Prove the cell behind a face, and with it those that are likely to be next."""
        wanted = {entry.beyond: entry}
        for other in heapq.nsmallest(2 * _AHEAD, self._heap):
            if other.beyond < 0 or len(wanted) >= _AHEAD or not self._current(other):
                continue
            if self._store[other.beyond].state == "untried":
                wanted.setdefault(other.beyond, other)
        self._store.prove_from([(other.inside, other.face.middle, number) for number, other in wanted.items()])

    def _tighten(self, entry: _Entry) -> bool:
        """Halve the member before a face whose level is not sharp; False where it is, or may not be halved."""
        cell = self._store[entry.inside]
        if entry.slack <= self._limits.tolerance * max(entry.level, 0.0) or cell.depth >= self._limits.depth:
            return False
        order = self._members[entry.inside]
        children = self._store.halve_proved(entry.inside)
        if children is None:
            return False
        del self._members[entry.inside]
        self._members |= dict.fromkeys(children, order)
        for child in children:
            self._push_faces(child)
        return True

    def _add(self, number: int) -> None:
        """Make a cell a member; where it disagrees with another member the two are parted, and both have an edge.

        It is asked about every member beside it, also the one it is taken from: it may have been proved from another.
        An atlas's boxes are neighbours only where they are glued.
        """
        others = [k for k in self._store[number].neighbours if k in self._members]
        self._added += 1
        self._members[number] = self._added
        self._store.extend(number)
        if self._store[number].lattice is not None or self._store[number].depth:
            for other, same in zip(others, self._store.agree(number, others), strict=True):
                if not same:
                    self._store.part(number, other)
                    self._push_edge(other)
        self._push_faces(number)

    def _push_faces(self, number: int) -> None:
        for other in self._store[number].neighbours - self._members.keys():
            self._push(number, other)
        self._push_edge(number)

    def _push_edge(self, number: int) -> None:
        for face in self._store.exposed(number):
            self._push_face(number, -1, face)

    def _push(self, inside: int, beyond: int) -> None:
        face = self._store.face(inside, beyond)
        if face is not None:
            self._push_face(inside, beyond, face)

    def _push_face(self, inside: int, beyond: int, face: CellPart) -> None:
        found = self._store.well(inside).range_over(face.lower, face.upper)
        self._serial += 1
        slack = found.upper - found.lower
        heapq.heappush(self._heap, _Entry(found.lower, self._serial, inside, beyond, face, found.point, slack))

    def _current(self, entry: _Entry) -> bool:
        if entry.inside not in self._members:
            return False
        return entry.beyond < 0 or (self._store[entry.beyond].live and entry.beyond not in self._members)

    def _wanted(self) -> bool:
        return self._go_on(Flooded(self._store.proved, self._level))

    def _spent(self) -> bool:
        return self._store.proved >= self._limits.cells


def _holds(cell: Cell, q: Array) -> bool:
    return bool(holding(cell.lower[None], cell.upper[None], q).size)
