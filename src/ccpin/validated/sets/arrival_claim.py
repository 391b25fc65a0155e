"""The claims that motions end where Theorem 3 takes over, and that one never does: Theorem A of `arrival`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved
from ccpin.proof.facts import Examined, Fact, Form, NotProvedError, ProvableClaim, provable, require
from ccpin.validated.arithmetic.balls import Ball, flint, upper
from ccpin.validated.arithmetic.exact_numbers import ExactBox
from ccpin.validated.arithmetic.series import NotInvertibleError
from ccpin.validated.flow.motion_claim import MotionEnclosed, end_of, is_chain
from ccpin.validated.flow.start_claim import PRECISION, ClosedStart, state_of
from ccpin.validated.flow.step_claim import StepEnclosed, end_of_step, start_of_step, step_of
from ccpin.validated.sets.arrival_equations import ArrivalEquations
from ccpin.validated.sets.curvature import UnboundedError
from ccpin.validated.sets.lyapunov import LyapunovAt, lowered, lyapunov_at, section_of
from ccpin.validated.sets.motion_tube_claim import TubeHeld
from ccpin.validated.sets.set_claim import SetEnclosed

LEVEL = Form("1", above=0.0)  # joules


@provable
@dataclass(frozen=True, eq=False)
class Arrived(ProvableClaim):
    """A motion, or all in a tube, end in B₂ of a level, from which Theorem 3 leads them to rest at the set point.

    Premises: the fact about the motion or tube, the one about σ(q_d), the one about the box P × Y that joins it to
    where the line ends, the level's if the equations name what it is of, and those about the line's steps, in order.

    Attributes:
        level: c in joules.
        precision: In bits, of the arithmetic.

    Found: `time` (1,), from when on they are there, s; `lyapunov` (1,), what 𝒱 is below then.
    """

    equations: ArrivalEquations
    level: Annotated[Array, LEVEL]
    precision: Annotated[Indices, PRECISION]
    theorem = "arrival"

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """Of steps the loop moved with q̇ constant, of a level what Theorem 3 is about; the loop of all else."""
        own = self.equations

        def subject(premise: Fact) -> str:
            if type(premise.claim) is SublevelProved:
                return own.digest_of_level(premise)
            return own.loop.steady.digest if type(premise.claim) is StepEnclosed else own.loop.digest

        return tuple(map(subject, premises))

    def examined(self, *premises: Fact) -> Examined:
        """Theorem A's 2, 3 and 4, or the corollary's."""
        require(len(premises) > 2, "no motion, no set point, or nothing about it")
        moved, goal, around, *line = premises
        self._require_level(line)
        require(type(around.claim) is ClosedStart, "nothing about the set point")
        require([type(step.claim) is StepEnclosed for step in line], "premises that are no steps")
        with flint().ctx.workprec(int(self.precision[0])), np.errstate(all="ignore"):  # what is not finite is refused
            try:
                well = lyapunov_at(self.equations, goal)
                level = lowered(self.equations, well, float(self.level[0]))
                box, highest = _reached(well, moved)
                require(highest < level, "𝒱 is not below the level")
                end = self._end_of_line(well, level, box, line)
                self._require_joined(well, level, end, goal, around)
            except (NotInvertibleError, UnboundedError) as refused:
                raise NotProvedError(f"𝒱 is not proven to exist: {refused}") from None
        found = {"time": moved.found["times"][-1:], "lyapunov": np.array([upper(highest)])}
        return Examined(np.ones(1, dtype=np.bool_), found)

    def _require_level(self, rest: list[Fact]) -> None:
        """That the first of some premises is about the level, where one is due; it is taken out.

        Raises:
            NotProvedError: It is not, or is below.
        """
        if self.equations.set_point is not None:
            require(len(rest) > 0 and type(rest[0].claim) is SublevelProved, "no level that is proved")
            require(self.level <= rest.pop(0).found["level"], "a level above the one that is proved")

    def _end_of_line(self, well: LyapunovAt, level: Ball, box: ExactBox, line: list[Fact]) -> ExactBox:
        """3: a box of configurations at the line's end; itself where there is none.

        Raises:
            NotProvedError: The steps are no line from the box, or U is not below the level on theirs.
        """
        loop = self.equations.loop
        x = range(loop.n_x)
        if not line:
            return box.rows(x)
        begin = start_of_step(line[0])
        require(begin.rows(x).holds(box.rows(x)), "a line from elsewhere")
        require(is_chain(loop.steady, begin, line, [False] * len(line), int(self.precision[0])), "a line with a gap")
        below = [well.at_rest(box) < level for step in line for box in step_of(step).boxes]
        require(below, "U is not below the level on the line")
        return end_of_step(line[-1]).rows(x)

    def _require_joined(self, well: LyapunovAt, level: Ball, end: ExactBox, goal: Fact, around: Fact) -> None:
        """4: that σ(q_d) and the line's end are in P × Y, over which U is below the level.

        Raises:
            NotProvedError: They are not, or it is not.
        """
        loop, claim = self.equations.loop, around.claim
        over, among = ExactBox(claim.q, claim.q_radius), ExactBox(claim.y, claim.radius)
        q, y = loop.independent, loop.dependent
        require(over.holds(self.equations.q_d), "the set point is not in the box about it")
        require(over.holds(end.rows(q)), "the line ends elsewhere")
        require(among.holds(state_of(goal).rows(y)), "the box about the set point is on another branch of σ")
        require(among.holds(end.rows(y)), "the line ends on another branch of σ")
        require(well.at_rest(state_of(around).balls()) < level, "U is not below the level next to the set point")


@provable
@dataclass(frozen=True, eq=False)
class SetArrived(ProvableClaim):
    """All motions from a box of starts end in B₂ of a level: those of each of the tubes that hold them do.

    Premises: the fact about the set, and those about its tubes' arrivals, in order.

    Attributes:
        level: c in joules.

    Found: `time` (1,), from when on all are there, s; `lyapunov` (1,), what 𝒱 is below then.
    """

    equations: ArrivalEquations
    level: Annotated[Array, LEVEL]
    theorem = "arrival"

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The loop of the set; of arrivals all of this."""
        return tuple([self.equations.loop.digest, *[self.equations.digest] * len(premises)][: len(premises)])

    def examined(self, *premises: Fact) -> Examined:
        """That they are about the set's tubes, and about one level."""
        require(len(premises) > 0 and type(premises[0].claim) is SetEnclosed, "no set")
        covered, *arrived = premises
        require([type(part.claim) is Arrived for part in arrived], "premises that are no arrivals")
        require(tuple(part.premises[0] for part in arrived) == covered.premises, "arrivals of other tubes")
        require([part.claim.level == self.level for part in arrived], "arrivals below another level")
        found = {name: np.max([part.found[name] for part in arrived], axis=0) for name in ("time", "lyapunov")}
        return Examined(np.ones(1, dtype=np.bool_), found)


@provable
@dataclass(frozen=True, eq=False)
class NeverArrives(ProvableClaim):
    """A motion does not converge to the set point: 𝒱, which never rises, is below its value there.

    Premises: the fact about the motion, and the one about σ(q_d).

    Attributes:
        precision: In bits, of the arithmetic.

    Found: `time` (1,), when 𝒱 < 0, s; `lyapunov` (1,), what it is below then.
    """

    equations: ArrivalEquations
    precision: Annotated[Indices, PRECISION]
    theorem = "arrival"

    def subjects(self, *premises: Fact) -> tuple[str, ...]:
        """The loop."""
        return (self.equations.loop.digest,) * len(premises)

    def examined(self, *premises: Fact) -> Examined:
        """That 𝒱 is one function, and below 0 at the motion's end."""
        require(len(premises) == 2 and type(premises[0].claim) is MotionEnclosed, "no motion, or no set point")
        require(self.equations.single, "𝒱 may be another function one turn on")
        motion, goal = premises
        with flint().ctx.workprec(int(self.precision[0])):
            try:
                value = lyapunov_at(self.equations, goal).over(end_of(motion).balls())
            except NotInvertibleError as refused:
                raise NotProvedError(f"𝒱 is not proven to exist: {refused}") from None
            require(value < 0, "𝒱 is not below 0")
        found = {"time": motion.found["times"][-1:], "lyapunov": np.array([upper(value)])}
        return Examined(np.ones(1, dtype=np.bool_), found)


def _reached(well: LyapunovAt, moved: Fact) -> tuple[ExactBox, Ball]:
    """1 and 2: a box around the state that a motion, or a tube's middle, comes to; and a bound of 𝒱 on all then.

    Raises:
        NotProvedError: It is neither.
    """
    if type(moved.claim) is MotionEnclosed:
        box = end_of(moved)
        return box, well.over(box.balls())
    require(type(moved.claim) is TubeHeld, "no motion, and no tube")
    *_, slices = moved.premises
    return section_of(slices), well.on_section(slices)
