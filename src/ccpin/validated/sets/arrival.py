"""The search for what proves an arrival: the set point, the line to it, and a box about both.

What is found, `Arrived` proves: Theorem A of `ccpin/proof/theorems/arrival.md`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.errors import ConvergenceError
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.validated.arithmetic.balls import Ball, ball, lower, upper
from ccpin.validated.arithmetic.exact_numbers import ExactBox, boxed
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.flow.marching import StepOptions, march
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.start_search import proved_start
from ccpin.validated.flow.step import ProvenStep, start_box
from ccpin.validated.sets.arrival_claim import Arrived, SetArrived
from ccpin.validated.sets.arrival_equations import ArrivalEquations
from ccpin.validated.sets.curvature import UnboundedError
from ccpin.validated.sets.lyapunov import LyapunovAt, lowered, lyapunov_at, section_of
from ccpin.validated.sets.subdivision import TOO_EARLY

RETRY = 0.9  # of a level at which nothing was proven
_SHORTEST = 2.0**-12  # of the line, in one step


class WayToGoal(NamedTuple):
    """What joins states to the set point: a fact about a box about it, and those about the line's steps."""

    around: Fact
    line: tuple[Fact, ...]


class Goal(NamedTuple):
    """The set point searched for.

    Attributes:
        equations: What is claimed of.
        level: c in joules.
        sublevel: The fact that c is Theorem 3's, where it is one.
        point: The fact about σ(q_d).
        well: 𝒱 about it.
        lowered: The level, as 𝒱 is counted there.
        options: How to step along a line.
        precision: In bits.
    """

    equations: ArrivalEquations
    level: float
    sublevel: Fact | None
    point: Fact
    well: LyapunovAt
    lowered: Ball
    options: StepOptions
    precision: int

    def highest(self, box: Sequence[Ball]) -> float:
        """An upper bound of 𝒱 on a box of states; infinite where none is proven."""
        try:
            return upper(self.well.over(box))
        except (NotInvertibleError, NotProvedError):
            return np.inf

    def below(self, box: Sequence[Ball]) -> bool:
        """Whether U is below the level on a box of configurations."""
        return bool(ball(self.highest(self.equations.loop.at_rest(box))) < self.lowered)

    def not_below(self, step: ProvenStep) -> str:
        """That U is not below the level on a step's boxes, in words; nothing where it is."""
        return "" if all(map(self.below, step.boxes)) else "U is not below the level on the line"

    def arrived(self, moved: Fact, joined: WayToGoal) -> Fact:
        """The fact that a motion, or a tube, ends in B₂.

        Raises:
            NotProvedError: It is none.
        """
        claim = Arrived(self.equations, np.array([self.level]), np.array([self.precision]))
        levels = () if self.sublevel is None else (self.sublevel,)
        return prove(claim, moved, self.point, joined.around, *levels, *joined.line)

    def all_arrived(self, covered: Fact, parts: Sequence[Fact]) -> Fact:
        """The fact that all motions from a box of starts do.

        Raises:
            NotProvedError: It is none.
        """
        return prove(SetArrived(self.equations, np.array([self.level])), covered, *parts)


def goal_of(
    equations: ArrivalEquations, level: float, sublevel: Fact | None, options: StepOptions, precision: int
) -> Goal:
    """The set point of a law, with a level.

    Raises:
        ConvergenceError: σ(q_d) is not proven to exist.
    """
    still = np.zeros(equations.loop.n)
    point = proved_start(equations.loop, equations.q_d, equations.x_d, still, precision)
    well = lyapunov_at(equations, point)
    return Goal(equations, level, sublevel, point, well, lowered(equations, well, level), options, precision)


def connection(goal: Goal, end: ExactBox) -> WayToGoal | str:
    """What joins a box of states to the set point below the level, or what could not be proven."""
    equations, options = goal.equations, goal.options._replace(shortest=_SHORTEST)
    loop, q_d = equations.loop, equations.q_d.balls()
    here = end.balls()[: loop.n_x]
    line = [(there - here[k].mid()).mid() for there, k in zip(q_d, loop.independent, strict=True)]
    here, facts = [*here, *line], list[Fact]()
    for step in march(ProvedSteps(loop.steady, goal.precision, goal.not_below), here, 1.0, options):
        if not isinstance(step, ProvenStep) or step.fact is None:
            return "the line from the state reached to the set point is not proven to stay below the level"
        here = start_box(step.end)
        facts.append(step.fact)
    joint = boxed([a.union(here[k]) for a, k in zip(q_d, loop.independent, strict=True)], goal.precision)
    try:
        around = proved_start(loop, joint, equations.x_d, np.zeros(loop.n), goal.precision)
    except ConvergenceError:
        return "the state reached is not proven to be on the set point's branch of σ"
    claim, y = around.claim, loop.dependent
    if not ExactBox(claim.y, claim.radius).holds(boxed(here, goal.precision).rows(y)):
        return "the state reached is not proven to be on the set point's branch of σ"
    if not goal.below(state_of(around).balls()):
        return "𝒱 is not proven to be below the level next to the set point"
    return WayToGoal(around, tuple(facts))


class SetArrival:
    """Whether a tube's cross-section is in B₂: what is missing, asked slice by slice.

    Attributes:
        goal: The set point and its level.
        joined: What joins the middle of a cross-section to the set point, by the fact about the slices that end there.
    """

    def __init__(self, goal: Goal) -> None:
        self.goal, self.joined = goal, dict[Fact, WayToGoal]()
        self._ask_below = self._level = lower(goal.lowered)

    def __call__(self, slices: Fact) -> str:
        """What is missing at the middle of the last of some slices; nothing where all its states are in B₂."""
        centre = section_of(slices)
        if not self.goal.highest(centre.balls()) < self._ask_below:
            return TOO_EARLY
        try:
            below = self.goal.well.on_section(slices) < self.goal.lowered
        except (UnboundedError, NotInvertibleError):
            below = False
        if not below:
            return "𝒱 is not below the level on the whole tube"
        joined = connection(self.goal, centre)
        if isinstance(joined, str):
            self._ask_below *= RETRY
            return joined
        self._ask_below, self.joined[slices] = self._level, joined
        return ""
