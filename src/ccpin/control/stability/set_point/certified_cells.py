"""Cells of q-space that are proved to carry σ when they are needed: a lattice that grows, or an atlas's boxes.

Each cell is a box of q-space; a proved one has a box of Theorem N and bounds of U over it (`Well`).
Cells are proved from a proved neighbour and glued to it at the middle of the common face, halved where that fails,
and new ones are laid beside old ones where the lattice may grow.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

import numpy as np

from ccpin.arrays import Array, Indices, joined
from ccpin.control.stability.set_point.potential import Potential, gravity_bounds
from ccpin.control.stability.set_point.set_point_cells import CellPart
from ccpin.control.stability.set_point.sublevel_claim import exposed
from ccpin.control.stability.set_point.well import SetPoint, Well, wells
from ccpin.covering.proposals.solving import glued
from ccpin.covering.proposals.tasks import CellsToProve, prove
from ccpin.domain.closures.system import Reading
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.newton import Boxes, check, predict
from ccpin.proof.rounding import UNIT_ROUNDOFF, widened

Proof = Literal["untried", "proved", "failed"]
_ONE = 16.0 * UNIT_ROUNDOFF  # of 1 + |q|: corners so near are one that was rounded twice
_ROOM = 0.01  # of R and κ: by how much they are raised, and checked again
_ROOM_AT_LEAST = 1e-11  # on R, rad or m: for tubes as thin as rounding


def holding(lower: Array, upper: Array, q: Array) -> Indices:
    """Which boxes (K, n) hold a point, to half of what Theorem N's are wider: middles of corners are rounded again."""
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    return np.flatnonzero(np.all(np.abs(q - middle) <= 0.5 * (half + widened(middle, half)), axis=1))


def aligned(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Corners (K, n) of which those that are one but for roundings are one to the last bit."""
    both = np.concatenate([lower, upper])
    for column in both.T:
        order = np.argsort(column)
        values = column[order]
        begins = np.flatnonzero(np.diff(values, prepend=-np.inf) > _ONE * (1.0 + np.abs(values)))
        ends = np.append(begins[1:], len(values)) - 1
        column[order] = np.repeat(0.5 * (values[begins] + values[ends]), ends + 1 - begins)
    return both[: len(lower)], both[len(lower) :]


@dataclass(eq=False)
class Cell:
    """A box [lower, upper] of q-space.

    Attributes:
        lower, upper: Corners, of shape (n,).
        depth: How often its lattice cell (or atlas box) was halved.
        lattice: Its place in the lattice, or ``None`` for an atlas.
        neighbours: Numbers of the cells it shares a face with, but those that were found to carry another σ there.
        state: Whether σ is proved on it.
        box: Theorem N's data (one row), where proved.
        well: U over it, where proved.
        live: False once it was halved.
    """

    lower: Array
    upper: Array
    depth: int
    lattice: tuple[int, ...] | None
    neighbours: set[int] = field(default_factory=set)
    state: Proof = "untried"
    box: Boxes | None = None
    well: Well | None = None
    live: bool = True


class CellStore:
    """All cells by number.

    Args:
        reading: The closures, and how their coordinates and configurations correspond.
        potential: V′ in the same chart.
        law: The law's numbers.
        lattice: (corner of cell (0, …, 0), edge lengths) of a lattice that may grow; ``None``: it may not.

    Attributes:
        proved: How many cells were proved here; those that came with an atlas are not counted.
        whole: Whether all that an atlas glues is here, glued: it is not where V is no function on its circles.
    """

    def __init__(
        self, reading: Reading, potential: Potential, law: SetPoint, lattice: tuple[Array, Array] | None
    ) -> None:
        self.reading, self.problem, self.potential, self.law = reading, reading.problem, potential, law
        self.cells: list[Cell] = []
        self.proved = 0
        self.whole = True
        self._lattice = lattice
        self._places: dict[tuple[int, ...], list[int]] = {}

    def __getitem__(self, number: int) -> Cell:
        return self.cells[number]

    def add_proved(self, boxes: Boxes, lower: Array, upper: Array, touching: Iterable[tuple[int, int]]) -> None:
        """Cells that come with their boxes, and the pairs of them that touch and are glued; no work is counted."""
        for corner, end in zip(*aligned(lower, upper), strict=True):
            self._append(Cell(corner, end, 0, None))
        for i, j in touching:
            if self.face(i, j) is not None:
                self.cells[i].neighbours.add(j)
                self.cells[j].neighbours.add(i)
        self._settle(list(range(len(self.cells))), boxes)
        self.proved = 0

    def add_first(self, box: Boxes, lower: Array, upper: Array) -> int:
        """The lattice's cell (0, …, 0) with its box."""
        number = self._append(Cell(lower, upper, 0, (0,) * len(lower)))
        self._places[(0,) * len(lower)] = [number]
        self._settle([number], box)
        return number

    def boxes(self, numbers: Iterable[int]) -> Boxes:
        """The boxes of proved cells, one row each."""
        return joined(box for box in (self.cells[k].box for k in numbers) if box is not None)

    def well(self, number: int) -> Well:
        """U over a proved cell."""
        well = self.cells[number].well
        assert well is not None
        return well

    def face(self, i: int, j: int) -> CellPart | None:
        """What two cells share: a face of positive area, or ``None``."""
        a, b = self.cells[i], self.cells[j]
        low, high = np.maximum(a.lower, b.lower), np.minimum(a.upper, b.upper)
        return CellPart(low, high) if np.all(low <= high) and np.sum(low == high) == 1 else None

    def exposed(self, number: int) -> list[CellPart]:
        """What of a cell's faces is not covered by its neighbours."""
        cell = self.cells[number]
        beside = [CellPart(other.lower, other.upper) for other in map(self.cells.__getitem__, cell.neighbours)]
        return list(exposed(CellPart(cell.lower, cell.upper), beside))

    def extend(self, number: int) -> None:
        """Lay the lattice cells beside a cell's own where there are none."""
        place = self.cells[number].lattice
        if self._lattice is None or place is None:
            return
        corner, edges = self._lattice
        for beside in _places_beside(place):
            if beside not in self._places:
                index = np.array(beside)
                new = self._append(Cell(corner + edges * index, corner + edges * (index + 1), 0, beside))
                self._places[beside] = [new]
                self._meet([new], [k for near in _places_beside(beside) for k in self._places.get(near, [])])

    def split(self, number: int, stretch: Array) -> tuple[int, int]:
        """Halve a cell along the edge that σ stretches most; the two halves are untried."""
        cell = self.cells[number]
        k = int(np.argmax(stretch * (cell.upper - cell.lower)))
        middle = 0.5 * (cell.lower[k] + cell.upper[k])
        low, high = cell.upper.copy(), cell.lower.copy()
        low[k] = high[k] = middle
        first = self._append(Cell(cell.lower, low, cell.depth + 1, cell.lattice))
        second = self._append(Cell(high, cell.upper, cell.depth + 1, cell.lattice))
        cell.live = False
        if cell.lattice is not None:
            leaves = self._places[cell.lattice]
            leaves.remove(number)
            leaves += [first, second]
        for other in cell.neighbours:
            self.cells[other].neighbours.discard(number)
        self._meet([first, second], [*cell.neighbours, first, second])
        return first, second

    def stretch(self, number: int) -> Array:
        """‖D_k‖ of a proved cell: how far σ moves the joints for each coordinate, of shape (n,)."""
        return np.asarray(np.linalg.norm(self.boxes([number]).directions[0], axis=0))

    def prove_from(self, origins: Sequence[tuple[int, Array, int]]) -> None:
        """Prove untried cells: (proved cell, a point of q-space common to both, untried cell)."""
        targets = [self.cells[j] for _, _, j in origins]
        parents = self.boxes(i for i, _, _ in origins)
        points = np.array([point for _, point, _ in origins])
        at_parent = points - parents.centre[:, self.problem.system.independent]
        start = predict(self.problem, parents, at_parent)
        start[:, self.problem.system.independent] = points
        centre = np.array([0.5 * (cell.lower + cell.upper) for cell in targets])
        half = np.array([0.5 * (cell.upper - cell.lower) for cell in targets])
        found = prove(self.problem, CellsToProve(centre, half, start, parents.centre))
        rows = np.flatnonzero(found.proved)
        for cell in targets:
            cell.state = "failed"
        if not rows.size:
            return
        boxes = _roomier(self.problem, found.boxes.take(rows))
        same = glued(self.problem, parents.take(rows), at_parent[rows], boxes, points[rows] - centre[rows])
        done = np.flatnonzero(same)
        if done.size:
            self._settle([origins[rows[k]][2] for k in done], boxes.take(done))

    def halve_proved(self, number: int) -> tuple[int, int] | None:
        """Halve a proved cell and prove both halves from it, so that they carry its σ; ``None`` where one fails."""
        children = self.split(number, self.stretch(number))
        middles = [0.5 * (self.cells[k].lower + self.cells[k].upper) for k in children]
        self.prove_from([(number, middle, k) for middle, k in zip(middles, children, strict=True)])
        return children if all(self.cells[k].state == "proved" for k in children) else None

    def agree(self, number: int, others: Sequence[int]) -> list[bool]:
        """Whether a proved cell carries the same σ as its proved neighbours (at the middle of the common faces)."""
        if not others:
            return []
        repeated, boxes = self.boxes([number] * len(others)), self.boxes(others)
        faces = [self.face(number, j) for j in others]
        points = np.array([face.middle for face in faces if face is not None])
        independent = self.problem.system.independent
        there, here = points - boxes.centre[:, independent], points - repeated.centre[:, independent]
        return [bool(value) for value in glued(self.problem, boxes, there, repeated, here)]

    def part(self, i: int, j: int) -> None:
        """Cells that do not carry the same σ are no neighbours, nor will their halves be: their face is exposed."""
        self.cells[i].neighbours.discard(j)
        self.cells[j].neighbours.discard(i)

    def _append(self, cell: Cell) -> int:
        self.cells.append(cell)
        return len(self.cells) - 1

    def _settle(self, numbers: list[int], boxes: Boxes) -> None:
        """Give cells their boxes and bound U over them."""
        centres = boxes.centre[:, self.problem.system.independent]
        found = wells(
            self.law, centres, boxes.half, boxes.directions, gravity_bounds(self.problem, self.potential, boxes)
        )
        for row, (number, well) in enumerate(zip(numbers, found, strict=True)):
            cell = self.cells[number]
            cell.box, cell.well, cell.state = boxes.take(np.array([row])), well, "proved"
        self.proved += len(numbers)

    def _meet(self, new: Iterable[int], others: Iterable[int]) -> None:
        """Make cells that share a face neighbours."""
        for i, j in product(new, others):
            if i != j and self.face(i, j) is not None:
                self.cells[i].neighbours.add(j)
                self.cells[j].neighbours.add(i)


def _places_beside(place: tuple[int, ...]) -> list[tuple[int, ...]]:
    return [(*place[:k], place[k] + step, *place[k + 1 :]) for k in range(len(place)) for step in (-1, 1)]


def _roomier(problem: Problem, boxes: Boxes) -> Boxes:
    """Boxes with somewhat larger tubes where Theorem N, checked again, allows it.

    Theorem N's least R leaves a small box's solution at a corner a margin below the rounding that gluing allows for.
    """
    radius = boxes.radius * (1.0 + _ROOM) + _ROOM_AT_LEAST
    kappa = np.minimum(boxes.kappa * (1.0 + _ROOM) + _ROOM, 0.999)
    usable = check(closures_of(problem), boxes._replace(radius=radius, kappa=kappa)).proved
    return boxes._replace(
        radius=np.where(usable[:, None], radius, boxes.radius), kappa=np.where(usable, kappa, boxes.kappa)
    )
