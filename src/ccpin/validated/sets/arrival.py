"""Whether states are in B₂: below the level, on the set point's branch, and joined to it below the level.

The checks of 2, 3 and 4 of Theorem A (`ccpin/proof/theorems/arrival.md`), and of where 𝒱 < 0 refutes an arrival.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.laws import PDSimpleGravity
from ccpin.errors import InvalidInputError
from ccpin.proof.facts import Fact
from ccpin.validated.arithmetic.ball_arrays import exactly, hull, raised
from ccpin.validated.arithmetic.balls import Ball, ball, upper
from ccpin.validated.arithmetic.series import NotInvertibleError, values
from ccpin.validated.flow.marching import StepOptions, march
from ccpin.validated.flow.motion_task import exact_q
from ccpin.validated.flow.regularity import determinant_bound, regular
from ccpin.validated.flow.start_search import closed_start, unique_there
from ccpin.validated.flow.step import ProvenStep, WatchedField, start_box
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.model.closed_loop import ClosedLoop
from ccpin.validated.sets.branch import jets_of, states_of
from ccpin.validated.sets.curvature import UnboundedError, boxes
from ccpin.validated.sets.instants import Instants
from ccpin.validated.sets.slices_claim import last_instant
from ccpin.validated.sets.subdivision import TOO_EARLY

RETRY = 0.9  # of a level at which nothing was proven
_MARGIN = 1e-9  # relative: the level and the bounds it comes from are doubles


class Goal(NamedTuple):
    """The law's set point: the level less its margins, V(q_d) in balls, the law, the numbers of the computed σ(q_d)."""

    level: float
    potential: Ball
    law: PDSimpleGravity
    x: Array


def unconnected(loop: ClosedLoop, end: Sequence[Ball], goal: Goal, options: StepOptions) -> str:
    """Theorem A's 3 and 4 for a box of states: what could not be proven, or nothing."""
    own = loop.equations
    q_free = list(end[: own.n_x])
    q_d = exact_q(goal.law.model, loop, goal.law.q_d)
    line = [(there - q_free[k].mid()).mid() for there, k in zip(q_d, own.independent, strict=True)]

    def room(box: list[Ball]) -> float:
        """Positive where ψ_q′ is nonsingular and U below the level."""
        regularity = determinant_bound(own, box)
        room_left = goal.level - upper(lyapunov(own, goal, own.at_rest(box)))
        return min(regularity, room_left) if regularity > 0 and room_left > 0 else 0.0

    here = [*q_free, *line]
    for step in march(
        WatchedField(own.drift, room, regular(own).missing), here, 1.0, options._replace(shortest=2.0**-12)
    ):
        if not isinstance(step, ProvenStep):
            return "the line from the state reached to the set point is not proven to stay below the level"
        here = start_box(step.end)
    joint = [a.union(here[k]) for a, k in zip(q_d, own.independent, strict=True)]
    if not unique_there(own, joint, here, goal.x):
        return "the state reached is not proven to be on the set point's branch of σ"
    around_goal = closed_start(own, joint, goal.x)
    if upper(lyapunov(own, goal, own.at_rest(around_goal))) < goal.level:
        return ""
    return "𝒱 is not proven to be below the level next to the set point"


def lyapunov(loop: ClosedLoopEquations, goal: Goal, box: Sequence[Ball]) -> Ball:
    """𝒱 on a box of states."""
    if loop.lyapunov is None:
        raise InvalidInputError("the law has no Lyapunov function")
    return values(loop.lyapunov, box)[0] - goal.potential


def single_valued(loop: ClosedLoop, law: PDSimpleGravity) -> bool:
    """Whether 𝒱 is one continuous function of configuration and velocity, whatever turns a motion has made.

    Then it never rises along any motion, and is 0 at the set point however that is reached. The theorem's text lists
    where it may not be: angles that the law reads on circles, rotation vectors of balls, springs of joints that turn.
    """
    stated = law.model.mechanism.tree.joints
    sprung = (joint for joint in loop.joints if stated[joint.number - 1].stated.stiffness)
    for joint in sprung:
        turns = "r" in {step[0] for step in joint.kind.steps}
        if turns and (joint.kind.unit or joint.x.start not in loop.equations.independent):
            return False
    smooth = True
    for angle in loop.equations.wrapped:
        j = loop.equations.independent.index(angle.place)
        smooth &= bool(law.gravity_d[j] == 0.0 and not np.delete(law.K_p[j], j).any())
    return smooth and not loop.equations.upright


def goal_of(loop: ClosedLoop, law: PDSimpleGravity, level: float) -> Goal:
    """The set point of a law with a level in joules, in balls; the level is lowered as the theorem's text says."""
    x = loop.numbers(law.q_free_d)
    own = loop.equations
    start = closed_start(own, exact_q(law.model, loop, law.q_d), x)
    potential = values(own.energies, own.at_rest(start))[1]
    told = law.model.energy(law.q_d, np.zeros(law.model.n), law.q_free_d).potential
    return Goal(level * (1 - _MARGIN) - upper(abs(potential - ball(told))), potential, law, x)


class SetArrival:
    """Whether a tube's cross-section is in B₂: what is missing, asked slice by slice.

    Attributes:
        goal: The set point and its level.
        largest: An upper bound of 𝒱 on all cross-sections that have arrived, J.
    """

    def __init__(self, loop: ClosedLoop, goal: Goal, options: StepOptions, cells: int) -> None:
        self._loop, self.goal, self._options, self._cells = loop, goal, options, cells
        self._ask_below, self.largest = goal.level, -np.inf

    def __call__(self, slices: Fact) -> str:
        """What is missing at the middle of the last of some slices; nothing where all its states are in B₂."""
        instant = last_instant(slices)
        centre = instant.middle.at(0).balls()
        if not upper(lyapunov(self._loop.equations, self.goal, centre)) < self._ask_below:
            return TOO_EARLY
        bound, reach = (slices.found[name][-1] for name in ("bound", "reach"))
        highest = self._highest(instant, slices.claim.frame[len(slices.found["bound"]) - 1], bound, reach)
        if not highest < self.goal.level:
            return "𝒱 is not below the level on the whole tube"
        missing = unconnected(self._loop, centre, self.goal, self._options)
        if missing:
            self._ask_below *= RETRY
            return missing
        self._ask_below, self.largest = self.goal.level, max(self.largest, highest)
        return ""

    def _highest(self, instant: Instants, frame: Array, bound: Array, reach: Array) -> float:
        """An upper bound of 𝒱 on a cross-section: 𝒱(ξ̄) + |∇𝒱 A||z| + ½ |A ᵀ𝒱″A||z||z|, 𝒱″ over a box about it."""
        loop, program = self._loop.equations, self._loop.equations.lyapunov
        assert program is not None, "laws with a set point have a Lyapunov function"
        try:
            around = boxes(loop, instant, reach[None], self._cells)
            over = jets_of(around.states, loop, program)
            v = instant.middle.at(np.s_[:, loop.n_x :])
            thin = jets_of(states_of(loop, around.centre, v), loop, program)
        except (UnboundedError, NotInvertibleError):
            return np.inf
        edges = exactly(frame)
        first = (thin.slope @ edges).size[0, 0] @ bound
        bend = hull(over.bend, around.pieces).at((0, 0))
        second = bound @ ((exactly(frame.T) @ bend @ edges).size @ bound)
        value = thin.value.at(0).balls()[0]
        return upper(value + ball(float(raised(first + raised(0.5 * second)))) - self.goal.potential)
