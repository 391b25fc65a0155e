"""Claims about paths: that boxes one behind the other carry one σ along a tube about polynomials.

A stretch of the path between two parameters is covered by a box of Theorem N with p = 1 + n parameters (s, w), q = q_c
+ s d + w, |s| ≤ 1: the tube about the stretch lies in it where its chord, how far the polynomials stray from that, and
the tube's half widths are within h of the line. At the end of one stretch and the beginning of the next both boxes are
boxes of q-space with the parameters w, and hold the tube's cross-section, which is convex: glued at one point of it
they carry the same σ on all of it (lemma G).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.proof.chords import Polynomials, chords_of
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.newton import reached
from ccpin.proof.rounding import UNIT_ROUNDOFF, sum_of
from ccpin.proof.solutions import Met, SolutionsInBoxes, boxes_of, glued_by


class _Pieces(NamedTuple):
    c: Array
    x: Array


@provable
@dataclass(frozen=True, eq=False)
class Followed(ProvableClaim):
    """From times[0] to times[-1] σ is continued along the tube about the path in one way only, and smooth.

    Premises: the fact about the boxes, one for every stretch between two times, in order; the fact that the first
    carries the start; facts that glue each to the next where it ends. Where the path jumps from a piece to the next it
    is taken to go straight.

    Attributes:
        coefficients, knots: The path, of shapes (d + 1, K, n) and (K + 1,), as `scipy.interpolate.PPoly` has it.
        times: The parameters between the boxes, of shape (B + 1,); no stretch goes beyond a knot.
        tube: Half widths, of shape (n,).

    Found: `seed` (1, N), a configuration to which the start is known.
    """

    coefficients: Annotated[Array, Form("dKP")]
    knots: Annotated[Array, Form("k")]
    times: Annotated[Array, Form("t")]
    tube: Annotated[Array, Form("P", least=0.0)]
    theorem = "theorem_n"

    def examined(self, *premises: Fact) -> Examined:
        """The stretches in their boxes, and these glued one to the next."""
        require(len(premises) > 1 and type(premises[1].claim) is Met, "boxes and their start are needed")
        boxes, start, *glue = premises
        count, n = len(self.times) - 1, len(self.tube)
        require(
            type(boxes.claim) is SolutionsInBoxes and boxes.claim.half.shape == (count, 1 + n),
            "boxes of other stretches",
        )
        self._require_path()
        require(self._covered(boxes), "a stretch of the tube is not in its box")
        found = set[tuple[int, int]]().union(*(_links(fact, boxes) for fact in glue))
        require([(k, k + 1) in found for k in range(count - 1)], "a box is not glued to the next")
        first = (start.claim.first == 0) & (start.claim.second == 0) & (start.claim.at_first[:, 0] == -1.0)
        require(start.premises[1:] == (boxes,) and np.any(first), "the first box does not carry the start")
        seed = boxes_of(start.premises[:1]).centre[start.claim.point[first][:1]]
        return Examined(np.ones(1, dtype=np.bool_), {"seed": seed})

    def _require_path(self) -> None:
        knots, times = self.knots, self.times
        require(len(knots) == self.coefficients.shape[1] + 1 and len(self.coefficients) > 0, "knots of other pieces")
        require(
            len(times) > 1 and np.all(np.diff(knots) > 0.0) and np.all(np.diff(times) > 0.0), "times that fall back"
        )
        require(times[0] >= knots[0] and times[-1] <= knots[-1], "times that the path does not have")
        require(np.isin(knots[(knots > times[0]) & (knots < times[-1])], times), "a stretch beyond a knot")

    def _covered(self, boxes: Fact) -> Mask:
        """Which stretches of the tube lie in their boxes: a line is furthest from a line at an end.

        So does the end of the one before, where the path jumps.
        """
        independent, half = self.equations.system.independent, reached(self.equations.system, boxes.claim.boxes)[:, 1:]
        with np.errstate(all="ignore"):
            chords = chords_of(_Pieces(self.coefficients, self.knots), self.times)
        centre, along = boxes.claim.centre[:, independent], boxes.claim.directions[:, independent, 0]
        here, there = _between(chords.start, centre, -along), _between(chords.end, centre, along)
        away = (np.maximum(here, there) + chords.deviation + self.tube) * (1.0 + 8.0 * UNIT_ROUNDOFF)
        before = (_between(chords.end[:-1], centre[1:], -along[1:]) + self.tube) * (1.0 + 8.0 * UNIT_ROUNDOFF)
        inside = np.all(away <= half, axis=1) & (boxes.claim.half[:, 0] >= 1.0)
        inside[1:] &= np.all(before <= half[1:], axis=1)
        return np.asarray(inside)


def follows(path: Fact, pieces: Polynomials) -> bool:
    """Whether a path is followed from its first knot to its last."""
    require(type(path) is Fact and type(path.claim) is Followed, "no fact about a path")
    claim, whole = path.claim, pieces.x[[0, -1]]
    known = np.array_equal(claim.coefficients, pieces.c) and np.array_equal(claim.knots, pieces.x)
    return known and np.array_equal(claim.times[[0, -1]], whole)


def _between(point: Array, centre: Array, along: Array) -> Array:
    """|point − (centre + along)|, but for the order of u²."""
    gap, rest = sum_of(point, -centre)
    gap, more = sum_of(gap, -along)
    return np.abs(gap + (rest + more))


def _links(glue: Fact, boxes: Fact) -> set[tuple[int, int]]:
    """Which boxes a fact glues to which, at the one's end and the other's beginning, without a turn between them."""
    claim, own = glue.claim, glued_by(glue)
    ends = (claim.at_first[:, 0] == 1.0) & (claim.at_second[:, 0] == -1.0) & ~glue.found["turn"].any(axis=1)
    return set(zip(claim.first[ends].tolist(), claim.second[ends].tolist(), strict=True)) if own == (boxes,) else set()
