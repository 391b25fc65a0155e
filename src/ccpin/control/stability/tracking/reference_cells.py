"""Claims over the cells of a reference: that σ is proved on all of them, on the branch of the law's start.

Lemma T of `ccpin/proof/theorems/tracking.md`, of which these are the hypotheses 1 to 3.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import CellForms, TimeCells, forms_of
from ccpin.proof.facts import Fact, Form, ProvableClaim, require
from ccpin.proof.newton import encloses, reached
from ccpin.proof.paths import Followed, follows
from ccpin.proof.rounding import UNIT_ROUNDOFF
from ccpin.proof.solutions import SolutionsInBoxes, glued_by


@dataclass(frozen=True, eq=False)
class OverCells(ProvableClaim):
    """What is claimed over cells of a reference's times, in which errors are bounded.

    Premises: the fact that the reference is followed from the law's start, with its boxes; the fact about the cells'
    boxes, one a cell, with the parameters (s, w); facts that glue each cell's to one of the path's.

    Attributes:
        times: Between the cells, of shape (K + 1,): all of the reference's, the last cell of its rest alone.
        room: Bounds of q_d − q and of another error of this size, of shape (K, 2n).
    """

    times: Annotated[Array, Form("t", least=0.0)]
    room: Annotated[Array, Form("KX", above=0.0)]

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The closures: what is known of boxes is about them alone."""
        return (self.equations.closures.digest,) * len(premises)

    def covered(self, *premises: Fact) -> tuple[Fact, TimeCells]:
        """The boxes, and the cells over which they prove σ.

        Raises:
            NotProvedError: They do not, or these are no such premises.
        """
        require(len(premises) > 2, "a path, cells and what glues them are needed")
        path, solutions, *glue = premises
        require(type(path.claim) is Followed and type(solutions.claim) is SolutionsInBoxes, "no path, or no boxes")
        cells = self._cells()
        self._require_path(path)
        self._require_covered(solutions, cells)
        self._require_glued(path, solutions, glue)
        return solutions, cells

    def states(self, solutions: Fact) -> CellForms:
        """The cells as forms, in the boxes of a premise."""
        return forms_of(self.equations.closures.system, solutions.claim.boxes, self._cells(), self.room)

    def _cells(self) -> TimeCells:
        """The reference between the times.

        Raises:
            NotProvedError: They are not all of it, or one lies across a knot.
        """
        knots, times = self.equations.reference.x, self.times
        require(len(times) == len(self.room) + 1 and np.all(np.diff(times) > 0.0), "times that fall back")
        require(times[0] == 0.0 and times[-1] == knots[-1], "times that are not all of the reference's")
        require(np.isin(knots, times), "a cell beyond a knot")
        with np.errstate(all="ignore"):
            return TimeCells.of(self.equations.motion, times)

    def _require_path(self, path: Fact) -> None:
        """That the reference is followed, in whose first box the law's configuration is.

        Raises:
            NotProvedError: It is not.
        """
        own, system = self.equations, self.equations.closures.system
        require(follows(path, own.reference), "another path than the reference")
        box = path.premises[0].claim.boxes.take(np.array([0]))
        along = box.directions[:, system.independent, 0]
        across = own.theta[system.independent] - (box.centre[:, system.independent] - along)
        require(np.abs(across) <= reached(system, box)[:, 1:], "the law starts beside the path")
        delta, theta = np.concatenate([-np.ones((1, 1)), across], axis=1), own.theta[None]
        require(
            encloses(own.closures, box, delta, theta, np.zeros_like(box.radius)), "the law starts on another branch"
        )

    def _require_covered(self, solutions: Fact, cells: TimeCells) -> None:
        """That each cell's q = q_d(t) − e, |e| ≤ E, lie in its box, about the chord.

        Raises:
            NotProvedError: They do not.
        """
        system, boxes = self.equations.closures.system, solutions.claim.boxes
        require(boxes.half.shape == (len(self.room), 1 + system.n), "boxes of other cells")
        require(np.array_equal(boxes.centre[:, system.independent], cells.place.middle), "boxes about other places")
        require(np.array_equal(boxes.directions[:, system.independent, 0], cells.place.along), "boxes along others")
        away = (self.room[:, : system.n] + cells.place.deviation) * (1.0 + 8.0 * UNIT_ROUNDOFF)
        require((away <= reached(system, boxes)[:, 1:]) & (boxes.half[:, :1] >= 1.0), "a cell is not in its box")

    def _require_glued(self, path: Fact, solutions: Fact, glue: list[Fact]) -> None:
        """That each cell's box is glued to one of the path's at a time that both have.

        Raises:
            NotProvedError: One is not.
        """
        boxes, ends, known = path.premises[0], path.claim.times, np.zeros(len(self.room), dtype=np.bool_)
        for fact in glue:
            own = glued_by(fact)
            require(len(own) == 2 and own[0] is boxes and own[1] is solutions, "boxes of other facts")
            first, second = fact.claim.first, fact.claim.second - (len(ends) - 1)
            some = (first < len(ends) - 1) & (second >= 0) & np.all(fact.found["turn"] == 0, axis=1)
            first, second = first[some], second[some]
            begin = np.maximum(ends[first], self.times[second])
            known[second[begin < np.minimum(ends[first + 1], self.times[second + 1])]] = True
        require(known, "a cell is not glued to the path")
