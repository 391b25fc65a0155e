"""𝒱 about a set point over boxes of states, as claims about arrivals count it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.proof.facts import Fact, require
from ccpin.validated.arithmetic.ball_arrays import exactly, hull, raised
from ccpin.validated.arithmetic.balls import Ball, ball
from ccpin.validated.arithmetic.exact_numbers import ExactBox
from ccpin.validated.arithmetic.series import values
from ccpin.validated.flow.start_claim import ClosedStart, state_of
from ccpin.validated.loop_equations import HALF_A_TURN, ClosedLoopEquations, too_far_turned
from ccpin.validated.sets.arrival_equations import ArrivalEquations
from ccpin.validated.sets.branch import jets_of, states_of
from ccpin.validated.sets.curvature import boxes
from ccpin.validated.sets.slices_claim import last_instant

_MARGIN = 1e-9  # relative: the level and the bounds it comes from are doubles


class LyapunovAt(NamedTuple):
    """𝒱 about a set point, over boxes of states.

    Attributes:
        loop: The closed loop.
        potential: V(q_d).
    """

    loop: ClosedLoopEquations
    potential: Ball

    def over(self, box: Sequence[Ball]) -> Ball:
        """𝒱 on a box of states.

        Raises:
            NotInvertibleError: It is not proven to exist there.
            NotProvedError: An angle may be half a turn off, where it is another function.
        """
        require(not too_far_turned(self.loop, box), HALF_A_TURN)
        assert self.loop.lyapunov is not None, "asked when equations are made"
        return values(self.loop.lyapunov, box)[0] - self.potential

    def at_rest(self, box: Sequence[Ball]) -> Ball:
        """U on a box of configurations (as `over`)."""
        return self.over(self.loop.at_rest(box))

    def on_section(self, slices: Fact) -> Ball:
        """An upper bound of 𝒱 on the cross-section of a tube in the middle of the last of some slices.

        𝒱(ξ̄) + |∇𝒱 A||z| + ½ |Aᵀ𝒱″A||z||z|, 𝒱″ over a box about it.

        Raises:
            UnboundedError, NotInvertibleError: 𝒱 is not proven to be bounded there.
        """
        loop, last = self.loop, len(slices.found["bound"]) - 1
        assert loop.lyapunov is not None, "asked when equations are made"
        instant, frame = last_instant(slices), slices.claim.frame[last]
        bound, reach = (slices.found[name][last] for name in ("bound", "reach"))
        around = boxes(loop, instant, reach[None], int(slices.claim.cells[0]))
        over = jets_of(around.states, loop, loop.lyapunov)
        thin = jets_of(states_of(loop, around.centre, instant.middle.at(np.s_[:, loop.n_x :])), loop, loop.lyapunov)
        edges = exactly(frame)
        first = (thin.slope @ edges).size[0, 0] @ bound
        bend = hull(over.bend, around.pieces).at((0, 0))
        second = bound @ ((exactly(frame.T) @ bend @ edges).size @ bound)
        return thin.value.at(0).balls()[0] + ball(float(raised(first + raised(0.5 * second)))) - self.potential


def lyapunov_at(equations: ArrivalEquations, goal: Fact) -> LyapunovAt:
    """𝒱 about the set point, σ(q_d) being that of a fact.

    Raises:
        NotProvedError: It is none about σ(q_d).
    """
    loop = equations.loop
    require(type(goal.claim) is ClosedStart, "no set point")
    require(ExactBox(goal.claim.q, goal.claim.q_radius).holds(equations.q_d), "another set point")
    require(np.array_equal(goal.claim.near, equations.x_d[list(loop.dependent)]), "a set point on another branch")
    return LyapunovAt(loop, values(loop.energies, loop.at_rest(state_of(goal).balls()))[1])


def lowered(equations: ArrivalEquations, well: LyapunovAt, level: float) -> Ball:
    """A level as 𝒱 is counted here: less what the law's V(q_d) is off, and a margin."""
    return ball(level) * (1 - ball(_MARGIN)) - abs(well.potential - ball(equations.potential_d))


def section_of(slices: Fact) -> ExactBox:
    """A box of states around the motion in a tube's middle, in the middle of the last of some slices."""
    middle = last_instant(slices).middle
    return ExactBox(middle.mid[0][:, None], middle.rad[0])
