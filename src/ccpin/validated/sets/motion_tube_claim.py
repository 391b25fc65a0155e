"""The claim that all motions from a box of starts are in a tube round one of them: Theorem Z, slice upon slice."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, NotProvedError, ProvableClaim, provable, require
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly
from ccpin.validated.arithmetic.balls import flint
from ccpin.validated.flow.motion_claim import MotionEnclosed
from ccpin.validated.flow.start_claim import PRECISION
from ccpin.validated.flow.step_claim import step_of
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.curvature import UnboundedError
from ccpin.validated.sets.slices_claim import SlicesHeld, last_section, marks_held
from ccpin.validated.sets.tube_theorem import CrossSection, gains_about, handed_on


@provable
@dataclass(frozen=True, eq=False)
class TubeHeld(ProvableClaim):
    """All motions from a box of starts exist, closed and nonsingular, in a tube round the one from its middle.

    Starts are closed states on the branch of σ on which the middle is. Premises: the fact about the middle's motion,
    and those about slices, in order: of its first step, of the next one, …, the last not to that step's end perhaps.

    Attributes:
        spread: Half-widths of the box, in q and q̇, of shape (2n,).
        cells: Into how many intervals each coordinate of a cross-section is cut where a sampled law is read.
        precision: In bits, of the arithmetic of the motion in the middle.

    Found: `times` (S + 1,), from 0 on, when the slices end, exact, in seconds since the start.
    """

    equations: ClosedLoopEquations
    spread: Annotated[Array, Form("s", least=0.0)]
    cells: Annotated[Indices, Form("1", "i", least=1)]
    precision: Annotated[Indices, PRECISION]
    theorem = "motion_tube"

    def examined(self, *premises: Fact) -> Examined:
        """That slices follow one another, each from a cross-section that holds the last one's end."""
        require(len(premises) > 1 and type(premises[0].claim) is MotionEnclosed, "no motion, or no slices")
        motion, *slices = premises
        require([type(part.claim) is SlicesHeld for part in slices], "premises that are no slices")
        require(len(self.spread) == 2 * self.equations.n, "starts in other coordinates")
        places = self._places(motion, slices)
        with flint().ctx.workprec(int(self.precision[0])), np.errstate(all="ignore"):
            try:
                for before, (part, k) in zip([None, *slices], zip(slices, places, strict=True), strict=False):
                    require(self._holds(motion, k, before, part), "slices that do not hold what the last ones end with")
            except UnboundedError as refused:
                raise NotProvedError(str(refused)) from None
        return Examined(np.ones(1, dtype=np.bool_), {"times": _times(motion, slices, places)})

    def _places(self, motion: Fact, slices: list[Fact]) -> list[int]:
        """Which steps slices are in.

        Raises:
            NotProvedError: They leave one out, or a part of one.
        """
        steps, places, k, mark = motion.premises[1:], list[int](), 0, 0.0
        require(len(steps) > 0, "a motion of no steps")
        for part in slices:
            if mark == steps[k].claim.length[0]:
                k, mark = k + 1, 0.0
            require(k < len(steps) and part.premises[0] is steps[k], "slices of other steps")
            require(part.claim.marks[0] == mark, "slices that do not follow one another")
            places, mark = [*places, k], marks_held(part)[-1]
        return places

    def _holds(self, motion: Fact, k: int, before: Fact | None, part: Fact) -> bool:
        """Whether slices of a step begin with all that those before them, or the starts, hand on.

        Raises:
            UnboundedError: A frame is nearly singular, or the efforts of a sampled law are not bounded.
        """
        loop, gains, begins = self.equations, None, part.claim.marks[0] == 0.0
        sampled = bool(begins and motion.claim.sampled[k])
        section = CrossSection(exactly(np.eye(2 * loop.n)), self.spread) if before is None else last_section(before)
        require(before is not None or sampled == (loop.efforts is not None), "efforts that no law has been read for")
        if sampled:
            gains = gains_about(loop, step_of(motion.premises[1 + k]), section, int(self.cells[0]))
        return bool(np.all(handed_on(part.claim.begin, section, gains) <= part.claim.bound))


def _times(motion: Fact, slices: list[Fact], places: list[int]) -> Array:
    """When slices end, from 0 on.

    Raises:
        NotProvedError: A time is no double.
    """
    begins = motion.found["times"].tolist()
    ends = [
        Fraction(begins[k]) + Fraction(mark)
        for k, part in zip(places, slices, strict=True)
        for mark in marks_held(part)[1:].tolist()
    ]
    require([Fraction(float(time)) == time for time in ends], "a time that is no double")
    return np.array([0.0, *map(float, ends)])


class TimeSlice(NamedTuple):
    """A slice of the tube, proven.

    Attributes:
        time: t_m in seconds, since the start.
        half: h/2.
        frame, rate, curve: A_m, L, M, of shape (N, N).
        end: A at the slice's end, of shape (N, N).
        bound: u, of shape (N,).
        kept: z₀ + hGu, of shape (N,).
        reach: Half-widths |A_m||P|u of the tube about ξ̄, of shape (N,).
    """

    time: float
    half: float
    frame: Array
    rate: Array
    curve: Array
    end: BallArray
    bound: Array
    kept: Array
    reach: Array


@lru_cache(maxsize=64)
def slices_of(tube: Fact) -> tuple[TimeSlice, ...]:
    """What a fact about a tube says of each slice."""
    told, times = list[tuple[Array, ...]](), tube.found["times"]
    for part in tube.premises[1:]:
        claim, found, held = part.claim, part.found, np.s_[: len(part.found["bound"])]
        ends = map(BallArray, found["end"], found["end_radius"])
        columns = claim.frame[held], claim.rate[held], claim.curve[held], ends
        told += zip(*columns, *(found[name] for name in ("bound", "kept", "reach")), strict=True)
    middles, halves = 0.5 * (times[1:] + times[:-1]), 0.5 * np.diff(times)
    return tuple(TimeSlice(*own, *rest) for *own, rest in zip(middles.tolist(), halves.tolist(), told, strict=True))
