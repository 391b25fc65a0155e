"""What is told of an enclosed motion: all of it from facts, in doubles rounded outwards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, numbers
from ccpin.errors import InvalidInputError
from ccpin.proof.facts import Fact, NotProvedError, is_fact, prove
from ccpin.proof.verdict import Judged, Verdict, Witness, not_known_of
from ccpin.validated.arithmetic.ball_arrays import of_balls
from ccpin.validated.arithmetic.balls import Ball, around, ball, bounds, centre_of, flint, hull
from ccpin.validated.arithmetic.exact_numbers import ExactBox
from ccpin.validated.arithmetic.series import values
from ccpin.validated.flow.crossing import witness_of
from ccpin.validated.flow.crossing_claim import SingularMet
from ccpin.validated.flow.motion_claim import MotionEnclosed
from ccpin.validated.flow.motion_task import MotionAsked
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.step import ProvenStep, start_box
from ccpin.validated.flow.step_claim import step_of
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.model.closed_loop import ClosedLoop
from ccpin.validated.model.configurations import configuration


class StateBox(NamedTuple):
    """A box of states of doubles, rounded outwards.

    Attributes:
        q_free: Centre of q′, of shape (n′,).
        q_free_radius: Half-widths, alike.
        v: Centre of q̇, of shape (n,).
        v_radius: Half-widths, alike.
    """

    q_free: Array
    q_free_radius: Array
    v: Array
    v_radius: Array


@dataclass(frozen=True, eq=False, repr=False)
class Enclosure(Judged):
    """A proven enclosure of one trajectory of K steps.

    Attributes:
        times: Ends of the steps, exact, of shape (K + 1,), in seconds.
        q_free, q_free_radius: A box around q′ at those times, of shape (K + 1, nq), rad or m.
        v, v_radius: A box around q̇ at those times, of shape (K + 1, n); of a sampled loop around q̇ and the efforts.
        q_free_lower, q_free_upper: A box around q′ during each step, of shape (K, nq).
        v_lower, v_upper: A box around q̇ during each step, of shape (K, n).
        determinant: A lower bound of |det ψ_q′| on each step's box, positive, of shape (K,).
        left_open: An upper bound of the size of φ's redundant rows during each step, m and rad, of shape (K,).
        stopped: What stopped the enclosure, and which argument to raise; nothing where nothing did.
        precision: Working precision in bits.
        loop: The programs that were integrated.
        steps: What was proven of each step, in balls.
        start: The exact closed start, in the numbers that hold q′ in `loop`'s programs, and q̇.
        asked: Which motion, and how long.
        motion: The fact that the steps enclose it (`ccpin.validated.flow.motion_claim`).
        met: The fact that it is singular somewhere then (`ccpin.validated.flow.crossing_claim`), if it is.
        assumes: What is left out of the mechanism, in words.
    """

    times: Array
    q_free: Array
    q_free_radius: Array
    v: Array
    v_radius: Array
    q_free_lower: Array
    q_free_upper: Array
    v_lower: Array
    v_upper: Array
    determinant: Array
    left_open: Array
    stopped: str
    precision: int
    loop: ClosedLoop
    steps: tuple[ProvenStep, ...]
    start: tuple[Ball, ...]
    asked: MotionAsked | None = None
    motion: Fact | None = None
    met: Fact | None = None
    assumes: str = ""

    @property
    def verdict(self) -> Verdict:
        """``"proven"``: the motion is closed and nonsingular over the whole time asked for, as a fact has it.

        ``"refuted"``: it meets a singular configuration within that time, `witness`, as a fact has it (Theorem X of
        `ccpin/proof/theorems/crossing.md`; free motions only). ``"undecided"``: it is enclosed up to ``times[-1]``, and
        what comes then is not known; so it is of one that was pickled, until it is replayed.
        """
        if self._singular is not None:
            return "refuted"
        known = self._known
        if known is None:
            return "undecided"
        assert self.asked is not None, "what is known was asked for"
        return "proven" if known.found["times"][-1] >= self.asked.duration else "undecided"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        told, steps = f"closed and nonsingular for {self.times[-1]:.9g} s", f"{len(self.steps)} steps"
        if self._singular is not None:
            after, before = self._singular.found["time"]
            reason = f"the motion is singular at a time between t = {after:.9g} s and {before:.9g} s"
        elif self.verdict == "proven":
            reason = f"{told}, in {steps}"
        else:
            stopped = self.stopped or not_known_of("this motion")
            reason = (
                f"rigour stops at t = {self.times[-1]:.9g} s after {steps}: {stopped}; more pieces=, a higher order= "
                "or precision=, or a smaller shortest_step= may lead farther"
            )
        return reason + self.assumes

    @property
    def witness(self) -> Witness | None:
        """The singular configuration met, where refuted."""
        found = self._singular
        return None if found is None else _witness_of(self.loop, found)

    @property
    def _known(self) -> Fact | None:
        """The fact about the motion, if it is about the one asked for."""
        if self.asked is None or self.motion is None or not self.asked.is_of(self.motion):
            return None
        told = (("times", self.times), ("determinant", self.determinant), ("left_open", self.left_open))
        own = self.motion.digest == self.loop.equations.digest
        own = own and tuple(step.fact for step in self.steps) == self.motion.premises[1:]
        own = own and all(np.array_equal(self.motion.found[name], numbers) for name, numbers in told)
        return self.motion if own else None

    @property
    def _singular(self) -> Fact | None:
        """The fact that this motion meets a singularity."""
        if not is_fact(self.met, SingularMet):
            return None
        return self.met if self.met.premises[0] is self._known else None

    def replay(self) -> Enclosure:
        """The same, what was found proved once more from its data alone.

        Raises:
            NotProvedError: It does not hold.
        """
        if self.motion is None:
            return self
        met = None if self.met is None else self.met.replay()
        return self.resting_on(self.motion.replay() if met is None else met.premises[0], met)

    def resting_on(self, motion: Fact, met: Fact | None = None) -> Enclosure:
        """The same, of other facts."""
        assert self.asked is not None, "what has a fact was asked for"
        return replace(told_of(self.loop, self.asked, motion, self.stopped, met), assumes=self.assumes)

    @property
    def smallest_determinant(self) -> float:
        """A lower bound of |det ψ_q′| along the whole trajectory (infinite without steps)."""
        return float(self.determinant.min(initial=np.inf))

    def box(self, t: float) -> list[Ball]:
        """The state (q′, q̇) at a time as balls, sharp: the Taylor polynomial and its proven error.

        Raises:
            InvalidInputError: The time is not covered.
        """
        with flint().ctx.workprec(self.precision):
            return _told(self.loop, self.inputs(t))

    def inputs(self, t: float) -> list[Ball]:
        """`box` in the numbers that the programs of `loop` take: of a circle in q′ the angle."""
        if not 0.0 <= t <= self.times[-1]:
            raise InvalidInputError(f"t = {t} s is not covered: the enclosure reaches from 0 to {self.times[-1]:.9g} s")
        k = min(int(np.searchsorted(self.times, t, side="right")) - 1, len(self.steps) - 1)
        if k < 0:
            return list(self.start)
        with flint().ctx.workprec(self.precision):
            return self.steps[k].box(ball(float(t)) - ball(float(self.times[k])))

    def at(self, t: float) -> StateBox:
        """The box of `box` in doubles."""
        return _bounds(self.loop, self.inputs(t))

    def contains(self, t: float, q_free: ArrayLike, v: ArrayLike, tolerance: float = 0.0) -> bool:
        """Whether (q′, q̇) is in the sharp box at a time, widened by a tolerance (an integrator's, say).

        A quaternion and its negative are one rotation.
        """
        box = self.box(t)
        state = np.concatenate([self._nearest(numbers(q_free, "q_free"), box), numbers(v, "v")])
        with flint().ctx.workprec(self.precision):
            slack = ball(tolerance)
            return all(around(x, slack).contains(ball(float(s))) for x, s in zip(box, state, strict=True))

    def _nearest(self, q_free: Array, box: Sequence[Ball]) -> Array:
        """Q′ with the signs of its quaternions as in a box."""
        signed = q_free.copy()
        for joint in self.loop.own.joints:
            if joint.kind.unit == 4:
                p = slice(joint.q.stop - 4, joint.q.stop)
                signed[p] *= np.copysign(1.0, signed[p] @ centre_of(box[p]))
        return signed

    def energy(self, t: float) -> Ball:
        """Kinetic and potential energy at a time, in joules, as a ball."""
        with flint().ctx.workprec(self.precision):
            kinetic, potential = values(self.loop.equations.energies, self.inputs(t))
            return kinetic + potential


def proved_motion(
    loop: ClosedLoopEquations, start: Fact, steps: Sequence[ProvenStep], sampled: Sequence[int], precision: int
) -> tuple[Fact, str]:
    """The fact about a motion in some steps, of which those numbered begin with a sample; and what was refused.

    What is refused leaves the start alone.
    """
    before, bits = np.isin(np.arange(len(steps)), sampled), np.array([precision])
    facts = [step.fact for step in steps if step.fact is not None]
    try:
        return prove(MotionEnclosed(loop, before, bits), start, *facts), ""
    except NotProvedError as refused:
        return prove(MotionEnclosed(loop, before[:0], bits), start), str(refused)


def told_of(loop: ClosedLoop, asked: MotionAsked, motion: Fact, stopped: str, met: Fact | None = None) -> Enclosure:
    """What facts say of a motion; `stopped`: why it ends early, if it does."""
    start, *steps = motion.premises
    precision = int(motion.claim.precision[0])
    with flint().ctx.workprec(precision):
        told = [step_of(step) for step in steps]
        found = collect(loop, state_of(start).balls(), told, motion.found["left_open"], stopped, precision)
    return replace(found, times=motion.found["times"], asked=asked, motion=motion, met=met)


def collect(
    loop: ClosedLoop,
    start: Sequence[Ball],
    steps: Sequence[ProvenStep],
    left_open: Sequence[float] | Array,
    stopped: str,
    precision: int,
) -> Enclosure:
    """What steps say, in doubles rounded outwards; of facts: `told_of`."""
    nodes = [_bounds(loop, start), *(_bounds(loop, start_box(step.end)) for step in steps)]
    columns: StateBox = StateBox(*(frozen(column) for column in zip(*nodes, strict=True)))
    during = [bounds(hull([_told(loop, box) for box in step.boxes])) for step in steps]
    split = columns.q_free.shape[1]
    size = split + columns.v.shape[1]
    below, above = np.moveaxis(np.reshape(during, (len(steps), 2, size)), 1, 0)
    return Enclosure(
        **columns._asdict(),
        times=frozen(np.concatenate([[0.0], np.cumsum([step.length for step in steps])])),
        q_free_lower=frozen(below[:, :split]),
        q_free_upper=frozen(above[:, :split]),
        v_lower=frozen(below[:, split:]),
        v_upper=frozen(above[:, split:]),
        determinant=frozen([step.quantity for step in steps]),
        left_open=frozen(left_open),
        stopped=stopped,
        precision=precision,
        loop=loop,
        steps=tuple(steps),
        start=tuple(start),
    )


def _witness_of(loop: ClosedLoop, met: Fact) -> Witness:
    state = ExactBox(met.found["state"], met.found["state_radius"])
    with flint().ctx.workprec(int(met.claim.precision[0])):
        return witness_of("singular", loop, state.balls())


def _told(loop: ClosedLoop, box: Sequence[Ball]) -> list[Ball]:
    """A box of (x, q̇, …) as one of (q′, q̇, …)."""
    return [*configuration(loop.own.joints, box), *box[loop.equations.n_x :]]


def _bounds(loop: ClosedLoop, box: Sequence[Ball]) -> StateBox:
    box, n_free = _told(loop, box), loop.own.joints[-1].q.stop
    centre, radius = of_balls([box]).at(0)
    return StateBox(centre[:n_free], radius[:n_free], centre[n_free:], radius[n_free:])
