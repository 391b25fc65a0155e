"""The claim that a level is Theorem 3's: cells glued to one another, and what U is over them and on their boundary.

`theorems/sublevel.md` (Lemma F) and `theorems/set_point.md`. Cells lie in boxes that are facts; which of them carry one
σ where they touch is what the facts that glue them say. All else is computed here: U over the boxes (Lemma H), which
cells are joined to that of q_d, which parts of their faces none of them goes on behind, and the least U there, which is
the level. So whatever a search leaves out makes it lower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Annotated, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.control.stability.set_point.potential import gravity_bounds
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.well import Well, wells
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.newton import Boxes, encloses, reached
from ccpin.proof.rounding import sum_of
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes


class CellPart(NamedTuple):
    """A part of q-space, as corners of shape (n,); with edges of no length it is one of a face."""

    lower: Array
    upper: Array

    @property
    def middle(self) -> Array:
        """Its middle."""
        return 0.5 * (self.lower + self.upper)


@provable
@dataclass(frozen=True, eq=False)
class SublevelProved(ProvableClaim):
    """Of K cells those joined to q_d's hold a connected component 𝒬 of {U < c}, c > 0, with Theorem 3's hypotheses.

    Premises: the fact about K boxes, in each of which is the cell of its number, and facts that glue these.

    Attributes:
        lower, upper: The cells' corners, of shape (K, n).

    Found: `level` (1,), c in joules; `beta` (1,), β over the cells that meet 𝒬; `within` (K,), in which cells {U < c}
    is 𝒬.
    """

    equations: SetPointEquations
    lower: Annotated[Array, Form("KP")]
    upper: Annotated[Array, Form("KP")]
    theorem = "set_point"

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The closures: what is known of boxes is about them alone."""
        return (self.equations.closures.digest,) * len(premises)

    def examined(self, *premises: Fact) -> Examined:
        """Lemma F over the cells joined to q_d's; where they meet 𝒬 the gain condition and the motors' grip."""
        require(len(premises) > 0 and type(premises[0].claim) is SolutionsInBoxes, "no boxes")
        boxes, pairs = premises[0].claim.boxes, glued_pairs(premises[0], premises[1:])
        self._require_cells(boxes)
        well, cells = self.wells(boxes), [CellPart(*corners) for corners in zip(self.lower, self.upper, strict=True)]
        beside, start = _beside(pairs, len(cells)), self._start(boxes)
        members = _joined(start, lambda k: beside[k])
        edge = [(k, part) for k in members for part in exposed(cells[k], [cells[j] for j in beside[k]])]
        level = np.min([well[k].range_over(*part).lower for k, part in edge])
        require(level > 0.0, "U is not shown to be above 0 on the boundary")
        meeting = [k for k in members if not well[k].range_over(*cells[k]).lower >= level]
        require(start in meeting, "U is not below its value on the boundary where q_d is")
        beta = np.max([well[k].beta for k in meeting])
        require(beta < self.equations.gain, "the gain condition is not shown to hold")
        require([well[k].effort > 0.0 for k in meeting], "motors are not shown to have a grip")
        convex = set(meeting)

        def over_low_faces(k: int) -> list[int]:
            return [j for j in beside[k] & convex if _meets(well[k], cells[k], cells[j], level)]

        within = np.zeros(len(cells), dtype=np.bool_)
        within[_joined(start, over_low_faces)] = True
        return Examined(
            np.ones(1, dtype=np.bool_), {"level": np.array([level]), "beta": np.array([beta]), "within": within}
        )

    def wells(self, boxes: Boxes) -> list[Well]:
        """U over boxes (Lemma H)."""
        own = self.equations
        bounds = gravity_bounds(own.closures.problem, own.potential, boxes)
        centres = boxes.centre[:, own.closures.system.independent]
        return wells(own.law, centres, boxes.half, boxes.directions, bounds)

    def _require_cells(self, boxes: Boxes) -> None:
        """That each cell lies in the box of its number, as widened, and has room; to the last bit.

        Raises:
            NotProvedError: One does not.
        """
        system = self.equations.closures.system
        require(boxes.half.shape == self.lower.shape, "other boxes than cells, or with other parameters than q")
        across = boxes.directions[:, system.independent]
        require(np.array_equal(across, np.broadcast_to(np.eye(system.n), across.shape)), "parameters that are not q")
        require(self.lower < self.upper, "a cell without room")
        allowed = reached(system, boxes)
        for corner in (self.lower, self.upper):
            gap, rest = sum_of(corner, -boxes.centre[:, system.independent])
            require((np.abs(gap) - allowed) + np.abs(rest) <= 0.0, "a cell is not in its box")

    def _start(self, boxes: Boxes) -> int:
        """A cell that holds q_d, in whose tube the law's configuration is (hypothesis 4)."""
        own, problem = self.equations, self.equations.closures.problem
        held = np.flatnonzero(np.all((self.lower <= own.law.q_d) & (own.law.q_d <= self.upper), axis=1))
        some = boxes.take(held)
        delta, theta = own.law.q_d - some.centre[:, problem.system.independent], np.tile(own.theta, (len(held), 1))
        known = held[encloses(problem, some, delta, theta, np.zeros_like(some.radius))]
        require(len(known) > 0, "q_d is in no cell, or not with the law's configuration")
        return int(known[0])


def glued_pairs(solutions: Fact, glue: tuple[Fact, ...]) -> Indices:
    """The pairs (G, 2) of boxes of a fact that facts glue at a common q on the line: q̃ is no function on circles.

    Raises:
        NotProvedError: The facts are of other kinds, or about other boxes.
    """
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for fact in glue:
        require(type(fact.claim) in (GluedBoxes, Met), "premises of other kinds")
        own = fact.premises if type(fact.claim) is GluedBoxes else fact.premises[1:]
        require(len(own) == 1 and own[0] is solutions, "boxes of other facts")
        both = np.stack([fact.claim.first, fact.claim.second], axis=1)
        pairs.append(both[np.all(fact.found["turn"] == 0, axis=1)])
    return np.concatenate(pairs)


def exposed(cell: CellPart, beside: list[CellPart]) -> Iterator[CellPart]:
    """The parts of a cell's faces behind which none of the cells beside it goes on, but for what has no area.

    Corners are compared to the last bit: cells that leave a gap, however small, do not cover.
    """
    axes = np.arange(len(cell.lower))
    for k, side in product(axes, (0, 1)):
        at, along = cell[side][k], axes != k
        parts = [CellPart(np.where(along, cell.lower, at), np.where(along, cell.upper, at))]
        for other in beside:
            low, high = other.lower[k], other.upper[k]
            if (low <= at < high) if side else (low < at <= high):
                parts = [left for part in parts for left in _without(part, other, axes[along])]
        yield from parts


def _without(part: CellPart, other: CellPart, axes: Indices) -> list[CellPart]:
    """Parts that are left of one where another is taken out of it, along some axes."""
    low, high, left = part.lower.copy(), part.upper.copy(), list[CellPart]()
    if np.any((other.upper[axes] <= low[axes]) | (high[axes] <= other.lower[axes])):
        return [part]
    for k in axes:
        if low[k] < other.lower[k]:
            end = high.copy()
            end[k] = other.lower[k]
            left.append(CellPart(low.copy(), end))
            low[k] = other.lower[k]
        if other.upper[k] < high[k]:
            begin = low.copy()
            begin[k] = other.upper[k]
            left.append(CellPart(begin, high.copy()))
            high[k] = other.upper[k]
    return left


def _meets(well: Well, cell: CellPart, other: CellPart, level: float) -> bool:
    """Whether U is below a level at a point that two cells have in common."""
    low, high = np.maximum(cell.lower, other.lower), np.minimum(cell.upper, other.upper)
    return bool(np.all(low <= high)) and well.range_over(low, high).upper < level


def _beside(pairs: Indices, count: int) -> list[set[int]]:
    """By number, which cells are in a pair with one."""
    beside: list[set[int]] = [set() for _ in range(count)]
    for i, j in pairs.tolist():
        beside[i].add(j)
        beside[j].add(i)
    return beside


def _joined(start: int, following: Callable[[int], Iterable[int]]) -> list[int]:
    """What is reached from one number, itself included."""
    found, pending = {start}, [start]
    while pending:
        new = set(following(pending.pop())) - found
        found |= new
        pending += new
    return sorted(found)
