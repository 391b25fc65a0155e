"""Tubes round enclosed motions: all motions from a box of starts, in as many parts as it takes.

A box of starts is covered by one tube (`ccpin.validated.sets.tube_theorem`) where that can be proven; where it grows
too fast the box is halved, and each half gets an enclosed motion and a tube of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.proof.facts import Fact, NotProvedError, is_fact, prove
from ccpin.proof.verdict import Judged, Verdict, not_known_of
from ccpin.validated.arithmetic.balls import Ball, ball, centre_of
from ccpin.validated.flow.enclosure import Enclosure, proved_motion, told_of
from ccpin.validated.flow.marching import Stuck, march
from ccpin.validated.flow.motion_task import MotionTask, on_circles
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.step import ProvenStep, start_box
from ccpin.validated.loop_equations import ClosedLoopEquations
from ccpin.validated.sets.curvature import UnboundedError
from ccpin.validated.sets.motion_tube_claim import TimeSlice, TubeHeld, slices_of
from ccpin.validated.sets.propagation import Cut, first_section, grow, sampled_section
from ccpin.validated.sets.set_claim import SetEnclosed
from ccpin.validated.sets.slices_claim import last_section

TOO_EARLY = "the motion in the middle of the starts has not arrived itself"
_COVERING = 1.0 + 1e-12  # of a half: covers its rounding, that both cover the whole


class Starts(NamedTuple):
    """A box of starts: its centre's doubles and its half-widths.

    Attributes:
        q, v: The centre, of shape (n,) each, exact; of a circle the angle.
        spread: Half-widths in q and q̇, of shape (2n,).
    """

    q: Array
    v: Array
    spread: Array

    def halves(self, k: int) -> tuple[Starts, Starts]:
        """Two boxes that cover it, cut across a coordinate."""
        smaller = np.where(np.arange(len(self.spread)) == k, 0.5 * self.spread * _COVERING, self.spread)
        smaller = smaller + (np.arange(len(self.spread)) == k) * 4e-16 * (1.0 + np.abs(np.append(self.q, self.v)))
        moved = 0.5 * np.where(np.arange(len(self.spread)) == k, self.spread, 0.0)
        below, above = (np.append(self.q, self.v) + sign * moved for sign in (-1.0, 1.0))
        n = len(self.q)
        return Starts(below[:n], below[n:], smaller), Starts(above[:n], above[n:], smaller)


@dataclass(frozen=True, eq=False, repr=False)
class Tube(Judged):
    """All motions from one box of starts.

    Attributes:
        starts: The box.
        asked: How long they were to be followed, s: until they had arrived, where that was asked; infinite where they
            were not found to.
        enclosure: The motion from the box's centre.
        held: The fact that they are in the tube (`ccpin.validated.sets.motion_tube_claim`), if there is one.
        stopped: What stopped the search, or was refused; nothing where nothing did.
    """

    starts: Starts
    asked: float
    enclosure: Enclosure
    held: Fact | None
    stopped: str = ""

    @property
    def verdict(self) -> Verdict:
        """``"proven"``: they are all in the tube over the whole time asked for, or until they have arrived.

        ``"undecided"``: over its slices only; so it is of one that was pickled, until it is replayed.
        """
        return "proven" if self.slices and self.duration >= self.asked else "undecided"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        q, spread = self.starts.q, self.starts.spread
        widths = ", ".join(f"{x:.3g}" for x in spread)
        told = f"the motions within ±({widths}) of ({', '.join(f'{x:.6g}' for x in q)})"
        if self.verdict == "proven":
            return f"{told} are in the tube for {self.duration:.6g} s"
        stopped = self.stopped or not_known_of("these motions")
        return f"{told} are followed up to t = {self.duration:.6g} s in {len(self.slices)} slices: {stopped}"

    @property
    def known(self) -> Fact | None:
        """The fact about the tube, if it is about these starts."""
        if not is_fact(self.held, TubeHeld):
            return None
        motion, spread = self.held.premises[0], self.held.claim.spread
        own = self.enclosure.verdict == "proven" and self.enclosure.motion is motion
        start = motion.premises[0].claim
        own = own and start.q_radius.sum() == np.abs(start.q[:, 1:]).sum() == 0.0
        own = own and np.array_equal(start.q[:, 0], self.starts.q) and np.array_equal(start.v, self.starts.v)
        return self.held if own and bool(np.all(self.starts.spread <= spread)) else None

    @property
    def slices(self) -> tuple[TimeSlice, ...]:
        """What is proven of each slice of time, in order."""
        return () if self.known is None else slices_of(self.known)

    @property
    def duration(self) -> float:
        """How far the tube is proven, s."""
        return 0.0 if self.known is None else float(self.known.found["times"][-1])

    def replay(self) -> Tube:
        """The same, what was found proved once more from its data alone.

        Raises:
            NotProvedError: It does not hold.
        """
        return self if self.held is None else self.resting_on(self.held.replay())

    def resting_on(self, held: Fact) -> Tube:
        """The same, of another fact."""
        return replace(self, enclosure=self.enclosure.resting_on(held.premises[0]), held=held)

    def coordinates(self, t: float, q: ArrayLike, v: ArrayLike, effort: ArrayLike = ()) -> Array:
        """Z/u of a state at a time, of shape (N,), computed: in the tube all are within ±1.

        Args:
            t: Time, s; at a sample that from then on.
            q: Of shape (n,), of a circle the angle.
            v: Of shape (n,).
            effort: What the motors hold, of shape (motors,), where the law is sampled.

        Raises:
            InvalidInputError: The time is not covered.
        """
        piece = self._slice(t)
        state = np.concatenate([numbers(q, "q"), numbers(v, "v"), numbers(effort, "effort")])
        tau = t - piece.time
        flow = np.eye(len(state)) + tau * piece.rate + 0.5 * tau**2 * piece.curve
        return np.linalg.solve(piece.frame @ flow, state - self._centre(t)) / piece.bound

    def box(self, t: float) -> tuple[Array, Array]:
        """Centre and half-widths, of shape (N,), of a box around the tube over a time's slice: q, q̇, efforts held."""
        return self._centre(t), self._slice(t).reach

    def _centre(self, t: float) -> Array:
        loop = self.enclosure.loop.equations
        state = centre_of(self.enclosure.inputs(t))
        return np.concatenate([state[list(loop.independent)], state[loop.n_x :]])

    def _slice(self, t: float) -> TimeSlice:
        known = self.known
        if known is None or not 0.0 <= t <= self.duration:
            raise InvalidInputError(f"t = {t} s is not covered: the tube reaches from 0 to {self.duration:.9g} s")
        ends = known.found["times"][1:]
        return slices_of(known)[min(int(np.searchsorted(ends, t, side="right")), len(ends) - 1)]


Arrived = Callable[[Fact], str]
"""Whether motions need not be followed beyond the slices of a fact: an empty string, or what is missing."""


class TubeTask(NamedTuple):
    """What is asked of every part.

    Attributes:
        motion: How the motion from a box's centre is enclosed.
        cut: How finely the tube is cut.
        arrived: When to stop; ``None``: after the duration.
        period: Of a sampled loop, s, else infinite.
    """

    motion: MotionTask
    cut: Cut
    arrived: Arrived | None = None
    period: float = math.inf


class TubesFound(NamedTuple):
    """What `cover` found.

    Attributes:
        tubes: Tubes, of which the last is not proven where something is missing.
        cut: Across which coordinates the box and its parts were cut, as `SetEnclosed` has it.
        place: Where.
        missing: What could not be proven of a part; nothing where all is.
    """

    tubes: list[Tube]
    cut: list[int]
    place: list[float]
    missing: str


def cover(task: TubeTask, starts: Starts, parts: int) -> TubesFound:
    """Tubes for a box of starts, of at most so many parts."""
    waiting, found = [starts], TubesFound([], [], [], "")
    while waiting:
        tube, across = _grown(task, waiting.pop())
        done = tube.verdict == "proven"
        if not done and (across is None or len(found.tubes) + len(waiting) + 2 > parts):
            return found._replace(tubes=[*found.tubes, tube], missing=tube.reason)
        found.cut.append(-1 if done or across is None else across)
        found.place.append(float(np.append(tube.starts.q, tube.starts.v)[found.cut[-1]]))
        if done:
            found.tubes.append(tube)
        elif across is not None:
            waiting.extend(reversed(tube.starts.halves(across)))
    return found


def proved_set(
    loop: ClosedLoopEquations, starts: Starts, found: TubesFound, duration: float
) -> tuple[Fact | None, str]:
    """The fact that tubes hold all motions from a box of starts for some seconds, or what is missing."""
    if found.missing:
        return None, found.missing
    facts = [tube.known for tube in found.tubes]
    cut, place = np.array(found.cut, dtype=np.int64), np.array(found.place)
    try:
        claim = SetEnclosed(loop, *starts, np.array([duration]), cut, place)
        return prove(claim, *(fact for fact in facts if fact is not None)), ""
    except NotProvedError as refused:
        return None, str(refused)


def _grown(task: TubeTask, starts: Starts) -> tuple[Tube, int | None]:
    """The tube of one box of starts, and the coordinate across which to halve it where it is not proven."""
    motion, loop, centre = task.motion, task.motion.loop.equations, [ball(x) for x in starts.q.tolist()]
    try:
        asked = motion.asked(on_circles(motion.model, starts.q), centre, starts.v)
        start = motion.start(asked)
    except CcpinError as error:
        raise type(error)(f"at the start {starts.q.tolist()}: {error}") from None
    steps, slices, section = list[ProvenStep](), list[Fact](), None
    missing, samples = "", list[int]()

    def tube(arrived: bool = False) -> Tube:
        proved, refused = proved_motion(loop, start, steps, samples, motion.precision)
        reached = float(proved.found["times"][-1])
        enclosure = told_of(motion.loop, asked._replace(duration=reached), proved, refused)
        held, other = _held(loop, proved, slices, starts.spread, task) if not refused else (None, refused)
        end = motion.duration if task.arrived is None else math.inf
        if arrived:
            end = 0.0 if held is None else float(held.found["times"][-1])
        return Tube(starts, end, enclosure, held, missing or other)

    for step, sampled in _motion(task, state_of(start).balls()):
        if not isinstance(step, ProvenStep):
            missing = step.reason
            break
        samples += [len(steps)] if sampled else []
        steps.append(step)
        try:
            section = first_section(loop, step, starts.spread) if section is None else section
            section = sampled_section(loop, step, section, task.cut) if sampled else section
            for batch in grow(loop, step, section, task.cut, motion.precision):
                slices.append(batch)
                section = last_section(batch)
                missing = task.arrived(batch) if task.arrived else ""
                if task.arrived and not missing:
                    return tube(arrived=True), None
        except UnboundedError as error:
            missing = str(error)
            break
    across = _widest(starts, slices[-1]) if slices else int(starts.spread.argmax())
    across = None if missing == TOO_EARLY else across  # smaller parts do not help
    return tube(), across


def _held(
    loop: ClosedLoopEquations, motion: Fact, slices: Sequence[Fact], spread: Array, task: TubeTask
) -> tuple[Fact | None, str]:
    """The fact that slices make a tube, or what is refused."""
    cells, bits = np.array([task.cut.pieces]), np.array([task.motion.precision])
    try:
        return prove(TubeHeld(loop, spread, cells, bits), motion, *slices), ""
    except NotProvedError as refused:
        return None, str(refused)


def _motion(task: TubeTask, start: Sequence[Ball]) -> Iterator[tuple[ProvenStep | Stuck, bool]]:
    """The steps of the motion from a point, each with whether it begins at a sample of the law."""
    motion, since, state = task.motion, 0.0, list(start)
    loop = motion.loop.equations
    field = ProvedSteps(loop, motion.precision)
    while since < motion.duration:
        sampled, state = loop.efforts is not None, loop.at_a_sample(state)
        for step in march(field, state, min(task.period, motion.duration - since), motion.options):
            yield step, sampled
            if not isinstance(step, ProvenStep):
                return
            sampled, since, state = False, since + step.length, start_box(step.end)


def _widest(starts: Starts, slices: Fact) -> int | None:
    """The coordinate of the starts that makes most of the tube's last cross-section."""
    bound = slices.found["bound"]
    edges = np.abs(slices.claim.frame[len(bound) - 1]) * bound[-1]
    shares = (edges / edges.sum(axis=1, keepdims=True)).sum(axis=0)[: len(starts.spread)] * (starts.spread > 0.0)
    return int(shares.argmax()) if shares.max() > 0.0 else None
