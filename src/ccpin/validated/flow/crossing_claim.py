"""The claim that a free motion meets a singular configuration: Theorem X of `crossing`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.validated.arithmetic.balls import Ball, ball, flint, hull, lower, upper
from ccpin.validated.arithmetic.exact_numbers import boxed
from ccpin.validated.arithmetic.series import NotInvertibleError, values
from ccpin.validated.flow.motion_claim import MotionEnclosed, end_of, is_chain
from ccpin.validated.flow.regularity import signed_determinant
from ccpin.validated.flow.start_claim import PRECISION
from ccpin.validated.flow.step import ProvenStep
from ccpin.validated.flow.step_claim import StepEnclosed, step_of
from ccpin.validated.loop_equations import ClosedLoopEquations


@provable
@dataclass(frozen=True, eq=False)
class SingularMet(ProvableClaim):
    """A free motion is singular at a time between two, at which det ψ_q′ has different signs.

    Premises: the fact about the motion, and those about steps that go on with it in other coordinates, in order.

    Attributes:
        first, last: The steps that the two times are in; −1: the first is the motion's end.
        after, before: The two times, in seconds since those steps began.
        precision: In bits, of the arithmetic.

    Found: `time` (2,), the two times since the motion's start, rounded outwards; `state` (X, k) and `state_radius`, in
    the other coordinates, a box around the motion between them.
    """

    equations: ClosedLoopEquations
    first: Annotated[Indices, Form("1", "i", least=-1)]
    after: Annotated[Array, Form("1", least=0.0)]
    last: Annotated[Indices, Form("1", "i", least=0)]
    before: Annotated[Array, Form("1", least=0.0)]
    precision: Annotated[Indices, PRECISION]
    theorem = "crossing"

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The motion's equations, and of the steps those of the first."""
        return (self.equations.digest, *(step.digest for step in premises[1:2] * (len(premises) - 1)))

    def examined(self, *premises: Fact) -> Examined:
        """That the steps go on with the motion in coordinates of the same mechanism, and that the signs differ."""
        require(len(premises) > 1 and type(premises[0].claim) is MotionEnclosed, "no motion, or no steps")
        motion, *facts = premises
        require([type(fact.claim) is StepEnclosed for fact in facts], "premises that are no steps")
        loop, other, bits = self.equations, facts[0].claim.equations, int(self.precision[0])
        first, last, after, before = (
            number[0] for number in (self.first.tolist(), self.last.tolist(), self.after.tolist(), self.before.tolist())
        )
        require(loop.free and other.free == loop.free and other.scalar, "no free motion of the same mechanism")
        with flint().ctx.workprec(bits):
            here = end_of(motion).balls()
            try:
                rates = values(loop.drift, here)
                begin = [*here[: loop.n_x], *(rates[k] for k in other.independent)]
                joined = is_chain(other, boxed(begin, bits), facts, [False] * len(facts), bits)
            except NotInvertibleError:
                joined = False
            require(joined, "steps that do not go on with the motion")
            steps = [step_of(fact) for fact in facts]
            require(first <= last < len(steps), "times of no step")
            require(before <= steps[last].length and after <= steps[first].length, "times of no step")
            require(first < last or after < before, "times in another order")
            one = sign_of(signed_determinant(loop, here if first < 0 else steps[first].box(ball(after))))
            two = sign_of(signed_determinant(loop, steps[last].box(ball(before))))
            require(one * two == -1, "signs that are not proven to differ")
            state = boxed(_between(steps, (first, after), (last, before)), bits)
        since = Fraction(float(motion.found["times"][-1]))
        begins = [since + sum(Fraction(step.length) for step in steps[: max(k, 0)]) for k in (first, last)]
        times = begins[0] + (Fraction(after) if first >= 0 else 0), begins[1] + Fraction(before)
        outwards = [math.nextafter(float(time), side) for time, side in zip(times, (-math.inf, math.inf), strict=True)]
        found = {"time": np.array(outwards), "state": state.parts, "state_radius": state.radius}
        return Examined(np.ones(1, dtype=np.bool_), found)


def sign_of(value: Ball) -> int:
    """+1 or −1 where all numbers of the ball have that sign, else 0."""
    return int(lower(value) > 0.0) - int(upper(value) < 0.0)


def _between(steps: Sequence[ProvenStep], begin: tuple[int, float], end: tuple[int, float]) -> list[Ball]:
    """A box around the motion from a time in one step to a time in another."""
    boxes = []
    for k in range(max(begin[0], 0), end[0] + 1):
        times = begin[1] if k == begin[0] else 0.0, end[1] if k == end[0] else steps[k].length
        boxes.append(steps[k].box(ball(times[0]).union(ball(times[1]))))
    return hull(boxes)
