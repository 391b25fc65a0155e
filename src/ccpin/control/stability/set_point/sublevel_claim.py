"""The claim that a level is Theorem 3's: cells glued to one another, and what U is over them and on their boundary.

`theorems/sublevel.md` (Lemma F) and `theorems/set_point.md`. Cells lie in boxes that are facts; which of them carry one
σ where they touch is what the facts that glue them say. All else is computed here: U over the boxes (Lemma H), which
cells are joined to that of q_d, which parts of their faces none of them goes on behind, and the least U there, which is
the level. So whatever a search leaves out makes it lower.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from ccpin.control.stability.set_point.set_point_cells import CellPart, SetPointCells, joined_to, without
from ccpin.control.stability.set_point.well import Well
from ccpin.proof.facts import Examined, Fact, provable, require
from ccpin.proof.rounding import SLACK


@provable
@dataclass(frozen=True, eq=False)
class SublevelProved(SetPointCells):
    """Of K cells those joined to q_d's hold a connected component 𝒬 of {U < c}, c > 0, with Theorem 3's hypotheses.

    Found: `level` (1,), c in joules; `beta` (1,), β over the cells that meet 𝒬; `within` (K,), in which cells {U < c}
    is 𝒬; `rest` (1,), how far from q_d a robot of the set may come to rest, 0 where there is one robot alone.
    """

    theorem = "set_point"

    def examined(self, *premises: Fact) -> Examined:
        """Lemma F over the cells joined to q_d's; where they meet 𝒬 the gain condition and the motors' grip."""
        boxes = self.boxes(*premises)
        beside, well, start = self.beside(*premises), self.wells(boxes), self.start(boxes)
        cells = [CellPart(*corners) for corners in zip(self.lower, self.upper, strict=True)]
        members = joined_to(start, lambda k: beside[k])
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
        within[joined_to(start, over_low_faces)] = True
        found = {"level": np.array([level]), "beta": np.array([beta]), "within": within}
        found["rest"] = np.array(
            [self._rest([well[k] for k in meeting], [cells[k] for k in meeting], well[start], level)]
        )
        return Examined(np.ones(1, dtype=np.bool_), found)

    def _rest(self, well: list[Well], cells: list[CellPart], at_goal: Well, level: float) -> float:
        """How far from q_d robots of a set come to rest, of cells that meet 𝒬 and the one that holds q_d."""
        law, misjudged = self.equations.law, self.equations.misjudged
        if misjudged == 0.0:
            return 0.0
        top = at_goal.range_over(law.q_d, law.q_d).upper
        require(top < level, "U of every robot is not shown to be below its value on the boundary where q_d is")
        low = [own.beta for own, cell in zip(well, cells, strict=True) if not own.range_over(*cell).lower > top]
        return float(misjudged / (self.equations.gain - np.max(low))) * SLACK


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
                parts = [left for part in parts for left in without(part, other, axes[along])]
        yield from parts


def _meets(well: Well, cell: CellPart, other: CellPart, level: float) -> bool:
    """Whether U is below a level at a point that two cells have in common."""
    low, high = np.maximum(cell.lower, other.lower), np.minimum(cell.upper, other.upper)
    return bool(np.all(low <= high)) and well.range_over(low, high).upper < level
