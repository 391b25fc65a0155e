"""What is claimed of cells about a set point: each in a box that is a fact, U over it, and which of them are joined.

Which cells carry one σ where they touch is what the facts that glue their boxes say.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.control.stability.set_point.potential import gravity_bounds
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.well import Well, wells
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.newton import Boxes, encloses, reached
from ccpin.proof.rounding import sum_of
from ccpin.proof.solutions import SolutionsInBoxes, glued_by


class CellPart(NamedTuple):
    """A part of q-space, as corners of shape (n,); with edges of no length it is one of a face."""

    lower: Array
    upper: Array

    @property
    def middle(self) -> Array:
        """Its middle."""
        return 0.5 * (self.lower + self.upper)


@dataclass(frozen=True, eq=False)
class SetPointCells(ProvableClaim):
    """What is claimed of K cells about a set point; kinds of claims add to it.

    Premises: the fact about K boxes, in each of which is the cell of its number, and facts that glue these.

    Attributes:
        lower, upper: The cells' corners, of shape (K, n).
    """

    equations: SetPointEquations
    lower: Annotated[Array, Form("KP")]
    upper: Annotated[Array, Form("KP")]

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The closures: what is known of boxes is about them alone."""
        return (self.equations.closures.digest,) * len(premises)

    def boxes(self, *premises: Fact) -> Boxes:
        """The cells' boxes.

        Raises:
            NotProvedError: There are none, or a cell is not in its own.
        """
        require(len(premises) > 0 and type(premises[0].claim) is SolutionsInBoxes, "no boxes")
        boxes: Boxes = premises[0].claim.boxes
        self._require_cells(boxes)
        return boxes

    def beside(self, *premises: Fact) -> list[set[int]]:
        """By number, to which cells one is glued."""
        return _beside(glued_pairs(premises[0], premises[1:]), len(self.lower))

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

    def start(self, boxes: Boxes) -> int:
        """A cell that holds q_d, in whose tube the law's configuration is (hypothesis 4)."""
        own, problem = self.equations, self.equations.closures.problem
        held = np.flatnonzero(np.all((self.lower <= own.law.q_d) & (own.law.q_d <= self.upper), axis=1))
        some = boxes.take(held)
        delta, theta = own.law.q_d - some.centre[:, problem.system.independent], np.tile(own.theta, (len(held), 1))
        known = held[encloses(problem, some, delta, theta, np.zeros_like(some.radius))]
        require(len(known) > 0, "q_d is in no cell, or not with the law's configuration")
        return int(known[0])


@provable
@dataclass(frozen=True, eq=False)
class SlopeBounded(SetPointCells):
    """Over each of D cells, which K cover that are joined to q_d's, on which V is a function: ‖∂g/∂q‖₂ ≤ β.

    Attributes:
        over_lower, over_upper: The D cells' corners, of shape (D, n).

    Found: `beta` (1,), β; `effort` (1,), what the least singular value of ρᵀSᵀ is not below, if that is positive.
    """

    over_lower: Annotated[Array, Form("DP")]
    over_upper: Annotated[Array, Form("DP")]
    theorem = "gravity"

    def examined(self, *premises: Fact) -> Examined:
        """Lemma H over the boxes of all cells that are joined to q_d's, and that these cover."""
        boxes = self.boxes(*premises)
        beside, well = self.beside(*premises), self.wells(boxes)
        members = np.array(joined_to(self.start(boxes), lambda k: beside[k]))
        lower, upper = self.lower[members], self.upper[members]
        for corners in zip(self.over_lower, self.over_upper, strict=True):
            cell = CellPart(*corners)
            near = np.flatnonzero(np.all((lower < cell.upper) & (cell.lower < upper), axis=1))
            parts = [cell]
            for k in near:
                parts = [left for part in parts for left in without(part, CellPart(lower[k], upper[k]))]
            require(not parts, "a cell is not covered by those that are joined to q_d's")
        beta, effort = np.max([well[k].beta for k in members]), np.min([well[k].effort for k in members])
        require(beta < np.inf, "no bound of the slope")
        return Examined(np.ones(1, dtype=np.bool_), {"beta": np.array([beta]), "effort": np.array([effort])})


def glued_pairs(solutions: Fact, glue: tuple[Fact, ...]) -> Indices:
    """The pairs (G, 2) of boxes of a fact that facts glue at a common q on the line: q̃ is no function on circles.

    Raises:
        NotProvedError: The facts are of other kinds, or about other boxes.
    """
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for fact in glue:
        own = glued_by(fact)
        require(len(own) == 1 and own[0] is solutions, "boxes of other facts")
        both = np.stack([fact.claim.first, fact.claim.second], axis=1)
        pairs.append(both[np.all(fact.found["turn"] == 0, axis=1)])
    return np.concatenate(pairs)


def _beside(pairs: Indices, count: int) -> list[set[int]]:
    """By number, which cells are in a pair with one."""
    beside: list[set[int]] = [set() for _ in range(count)]
    for i, j in pairs.tolist():
        beside[i].add(j)
        beside[j].add(i)
    return beside


def joined_to(start: int, following: Callable[[int], Iterable[int]]) -> list[int]:
    """What is reached from one number, itself included."""
    found, pending = {start}, [start]
    while pending:
        new = set(following(pending.pop())) - found
        found |= new
        pending += new
    return sorted(found)


def without(part: CellPart, other: CellPart, axes: Indices | None = None) -> list[CellPart]:
    """Parts that are left of one where another is taken out of it, along some axes (all)."""
    axes = np.arange(len(part.lower)) if axes is None else axes
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
