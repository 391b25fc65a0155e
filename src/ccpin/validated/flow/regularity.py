"""det ψ_q′ on boxes of states: what every step of the closed loop watches."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ccpin.validated.arithmetic.balls import Ball, ball, determinant, flint, lower
from ccpin.validated.arithmetic.series import values
from ccpin.validated.flow.step import WatchedField
from ccpin.validated.loop_equations import ClosedLoopEquations, too_far_turned


def regular(loop: ClosedLoopEquations) -> WatchedField:
    """The closed loop's equation, |det ψ_q′| watched, and that the law's angles are less than half a turn off."""
    return WatchedField(loop.field, lambda box: determinant_bound(loop, box), lambda box: too_far_turned(loop, box))


def determinant_bound(loop: ClosedLoopEquations, box: Sequence[Ball]) -> float:
    """A lower bound of |det ψ_q′| on a box of states."""
    return lower(ball(signed_determinant(loop, box).abs_lower()))


def signed_determinant(loop: ClosedLoopEquations, box: Sequence[Ball]) -> Ball:
    """± det ψ_q′, always of the same sign, on a box of states or configurations."""
    size = math.isqrt(len(loop.jacobian.outputs))
    return determinant(flint().arb_mat(size, size, values(loop.jacobian, loop.at_rest(box)))) if size else ball(1)
