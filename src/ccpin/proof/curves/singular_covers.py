"""Claims about all singular curves over a region: what is on none of some curves lies in boxes that are listed.

One box of all coordinates, which holds all that the claim speaks of by Lemma R, is narrowed and halved over and over. A
part is dropped where φ is shown to have no zero or φ_y to be regular (`proof.narrowing`), or where what singular
configurations it may hold lie in tubes (Proposition B of `ccpin/proof/theorems/covering.md`). All tubes are known from
the start, and whoever found them is not believed: what was missed is in a box that stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices, joined, rows_of
from ccpin.proof.candidates import beyond, halved, over_all, rows_to_halve_for
from ccpin.proof.curves.settled_boxes import Nearby, extents, settled_beside
from ccpin.proof.curves.tube_claims import tubes_of
from ccpin.proof.curves.tubes import Stated, stated
from ccpin.proof.equations import Problem, derivatives
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.narrowing import Candidates, narrowed
from ccpin.proof.ranges import Ranges, proved_ranges
from ccpin.work import ended, side_by_side

_CHUNK = 1000  # boxes at once: bounds memory


def narrowed_to_singular(problem: Problem, ranges: Ranges, boxes: Candidates) -> Candidates:
    """The boxes that may hold singular configurations within the ranges, narrowed with both choices of Ã."""
    boxes = narrowed(problem, boxes)
    if boxes.cell.size:
        boxes = narrowed(problem, boxes, True, np.ones(len(boxes.cell), dtype=np.bool_))
    return rows_of(boxes, ~beyond(problem, ranges, boxes))


def halved_steepest(problem: Problem, boxes: Candidates) -> Candidates:
    """Both halves of boxes, cut where φ and φ_y move most."""
    found = derivatives(problem, boxes.centre)
    steepest = np.abs(found.jacobian) + np.abs(found.hessian[:, :, problem.system.dependent]).sum(axis=2)
    moved = steepest[:, rows_to_halve_for(problem)].max(axis=1) * boxes.half
    return halved(problem, boxes, np.argmax(moved, axis=1))


@provable
@dataclass(frozen=True, eq=False)
class SingularCovered(ProvableClaim):
    """Every singular configuration over a region is on the curve of one of some tubes, or in a box that is found.

    Of the closed configurations with lower ≤ q ≤ upper that keep the limits, angles modulo 2π, it speaks of those with
    singular φ_y. Premises: facts about the tubes (`SingularTubes`), or none.

    Attributes:
        lower, upper: The region's corners, of shape (n,) each, n = 2.
        limits: Lower and upper limits of the dependent coordinates, ±`ranges.NO_LIMIT` where there is none; of those
            with a full turn they say nothing; of shape (m, 2).
        middle: θ in the middle of full turns, of shape (n′,).
        resolution: Boxes narrower than this each way are not halved, of shape (1,).
        most: How many boxes may be looked at, of shape (1,); those that wait then, or where work is to end, are listed.

    Found: `lower` and `upper` (K, N) of the boxes; `tried` (1,), how many were looked at; `early` (1,), whether boxes
    are listed that were to be halved.
    """

    lower: Annotated[Array, Form("P")]
    upper: Annotated[Array, Form("P")]
    limits: Annotated[Array, Form("M2")]
    middle: Annotated[Array, Form("N")]
    resolution: Annotated[Array, Form("1", above=0.0)]
    most: Annotated[Indices, Form("1", "i", 0)]
    theorem = "covering"

    def examined(self, *premises: Fact) -> Examined:
        """Branch and prune."""
        require(self.equations.system.n == 2, "singular configurations that are no curves")
        require(self.lower <= self.upper, "a region with its corners exchanged")
        require(self.limits[:, 0] <= self.limits[:, 1], "limits that are exchanged")
        system, problem, tubes = self.equations.system, self.equations.problem, tubes_of(self.equations, premises)
        ranges = proved_ranges(system, self.middle[system.dependent], (self.lower, self.upper), self.limits)
        plain = problem._replace(phasors=None)
        nearby = Nearby(plain, tubes) if len(tubes.half) else None
        waiting, tried = over_all(problem, ranges, self.lower, self.upper), 0
        left = [rows_of(waiting, slice(0))]
        while waiting.cell.size and tried <= self.most[0] and not ended():
            tried += len(waiting.cell)
            parts = [rows_of(waiting, slice(first, first + _CHUNK)) for first in range(0, len(waiting.cell), _CHUNK)]
            waiting = joined(
                side_by_side(lambda part: part if ended() else _pruned(problem, ranges, nearby, part), parts)
            )
            small = extents(problem, waiting).max(axis=1, initial=0.0) < self.resolution
            left.append(rows_of(waiting, small))
            waiting = halved_steepest(problem, rows_of(waiting, ~small))
        listed = joined([*left, waiting])
        reach = extents(problem, listed)
        return Examined(
            np.ones(1, dtype=np.bool_),
            {
                "lower": listed.centre - reach,
                "upper": listed.centre + reach,
                "tried": np.array([tried]),
                "early": np.array([waiting.cell.size > 0]),
            },
        )


def _pruned(problem: Problem, ranges: Ranges, nearby: Nearby | None, boxes: Candidates) -> Candidates:
    """The boxes, narrowed, that may hold singular configurations which are on no curve of a tube."""
    boxes = narrowed_to_singular(problem, ranges, boxes)
    if nearby is None or not boxes.cell.size:
        return boxes
    nearest, worth = nearby.beside(boxes)
    left, rows = np.ones(len(boxes.cell), dtype=np.bool_), np.flatnonzero(worth)
    left[rows] = ~settled_beside(nearby.problem, rows_of(boxes, rows), nearby.tubes, nearest[rows])
    return rows_of(boxes, left)


def covers(fact: Fact, region: tuple[Array, Array], limits: Array, tubes: Stated) -> bool:
    """Whether a fact is about all of a region, within these limits, and about these tubes in this order."""
    require(type(fact) is Fact and type(fact.claim) is SingularCovered, "no fact about singular curves")
    claim, known = fact.claim, stated(tubes_of(fact.claim.equations, fact.premises))
    asked = (claim.lower, claim.upper, claim.limits, *known), (*region, limits, *tubes)
    return all(np.array_equal(one, other) for one, other in zip(*asked, strict=True))
