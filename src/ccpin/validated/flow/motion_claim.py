"""The claim that steps enclose one motion, end to end: Theorem M of `enclosure`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import accumulate
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices, Mask
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.validated.arithmetic.balls import ball, flint, hull, magnitude, upper
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed
from ccpin.validated.arithmetic.series import NotInvertibleError, gradients
from ccpin.validated.flow.defect import sizes_along
from ccpin.validated.flow.start_claim import PRECISION, ClosedStart, state_of
from ccpin.validated.flow.step import ProvenStep
from ccpin.validated.flow.step_claim import StepEnclosed, end_of_step, start_of_step, step_of
from ccpin.validated.loop_equations import ClosedLoopEquations


@provable
@dataclass(frozen=True, eq=False)
class MotionEnclosed(ProvableClaim):
    """The motion from a closed start exists over K steps, closed and nonsingular, on one branch of σ.

    Premises: the fact about the start, and those about the steps, in order.

    Attributes:
        sampled: Before which steps a sampled law reads its efforts anew, of shape (K,).
        precision: In bits, of the arithmetic.

    Found: `times` (K + 1,), when the steps end, exact, in seconds since the start; `determinant` (K,), lower bounds of
    |det ψ_q′| during each; `left_open` (K,), upper bounds of |φ_i| during each for the rows of φ that are left out.
    """

    equations: ClosedLoopEquations
    sampled: Annotated[Mask, Form("k", "b")]
    precision: Annotated[Indices, PRECISION]
    theorem = "enclosure"

    def examined(self, *premises: Fact) -> Examined:
        """That each step begins where the one before ends; the rows left out are bounded."""
        loop, bits = self.equations, int(self.precision[0])
        require(len(premises) > 0 and type(premises[0].claim) is ClosedStart, "no start")
        start, *steps = premises
        require([type(step.claim) is StepEnclosed for step in steps], "premises that are no steps")
        require(len(steps) == len(self.sampled), "steps of which it is not said whether a law is read before them")
        require(loop.efforts is not None or not self.sampled.any(), "samples of a law that is not sampled")
        with flint().ctx.workprec(bits):
            try:
                require(is_chain(loop, state_of(start), steps, self.sampled, bits), "a step begins elsewhere")
                open_by = [left_open(loop, step_of(step)) for step in steps]
            except NotInvertibleError:
                require(False, "the motors' efforts, or the rows left out, are not proven to exist along the motion")
        determinant = np.array([float(step.found["quantity"][0]) for step in steps])
        found = {"times": times_of(steps), "determinant": determinant, "left_open": np.array(open_by, dtype=float)}
        return Examined(np.ones(1, dtype=np.bool_), found)


def is_chain(
    loop: ClosedLoopEquations, begin: ExactBox, steps: Sequence[Fact], sampled: Sequence[bool] | Mask, bits: int
) -> bool:
    """Whether the first of some steps is from a box that holds another, and each next from one that holds its end.

    Raises:
        NotInvertibleError: The motors' efforts are not proven to exist.
    """
    for step, read in zip(steps, sampled, strict=True):
        state = boxed(loop.at_a_sample(begin.balls()), bits) if read else begin
        if not start_of_step(step).holds(state):
            return False
        begin = end_of_step(step)
    return True


def times_of(steps: Sequence[Fact]) -> Array:
    """When steps end, from 0 on.

    Raises:
        NotProvedError: A time is no double.
    """
    exact = list(accumulate((Fraction(float(step.claim.length[0])) for step in steps), initial=Fraction(0)))
    require([Fraction(float(time)) == time for time in exact], "a time that is no double")
    return np.array([float(time) for time in exact])


def left_open(loop: ClosedLoopEquations, step: ProvenStep) -> float:
    """An upper bound of |φ_i| along a step for the rows of φ left out as redundant; 0 where there are none.

    φ_i(x(t)) is φ_i(p(t)), whose Taylor series `defect` bounds, and at most |∂φ_i/∂x| times the error off that.
    """
    if loop.left_out is None:
        return 0.0
    along = sizes_along(loop.left_out, step.polynomial, ball(step.length))
    slopes = gradients(loop.left_out, hull(step.boxes))
    off = (sum((magnitude(a) * e for a, e in zip(row, step.error, strict=True)), ball(0)) for row in slopes)
    return max(upper(size + change) for size, change in zip(along, off, strict=True))


def end_of(motion: Fact) -> ExactBox:
    """The box of states at a motion's end."""
    *_, last = motion.premises
    return state_of(last) if type(last.claim) is ClosedStart else end_of_step(last)
