"""Tubes round enclosed motions: all motions from a box of starts, in as many parts as it takes.

A box of starts is covered by one tube (`ccpin.validated.sets.tube_theorem`) where that can be proven; where it grows
too fast the box is halved, and each half gets an enclosed motion and a tube of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.proof.verdict import Judged, Verdict
from ccpin.validated.arithmetic.balls import Ball, ball, centre_of
from ccpin.validated.flow.enclosure import Enclosure, proved_motion, told_of
from ccpin.validated.flow.marching import Stuck, march
from ccpin.validated.flow.motion_task import MotionTask, on_circles
from ccpin.validated.flow.proved_steps import ProvedSteps
from ccpin.validated.flow.start_claim import state_of
from ccpin.validated.flow.step import ProvenStep, start_box
from ccpin.validated.sets.curvature import UnboundedError
from ccpin.validated.sets.propagation import CrossSection, Cut, first_section, grow, instants_of, sampled_section
from ccpin.validated.sets.tube_theorem import TimeSlice

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
        verdict: ``"proven"``: they are all in the tube over the whole time asked for (or until they have arrived).
            ``"undecided"``: over its slices only.
        reason: The verdict in a sentence.
        enclosure: The motion from the box's centre.
        slices: What was proven of each slice of time, in order.
    """

    starts: Starts
    verdict: Verdict
    reason: str
    enclosure: Enclosure
    slices: tuple[TimeSlice, ...]

    @property
    def duration(self) -> float:
        """How far the tube is proven, s."""
        return self.slices[-1].time + float(self.slices[-1].instant.half[0]) if self.slices else 0.0

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
        if not (self.slices and 0.0 <= t <= self.duration):
            raise InvalidInputError(f"t = {t} s is not covered: the tube reaches from 0 to {self.duration:.9g} s")
        ends = [piece.time + float(piece.instant.half[0]) for piece in self.slices]
        return self.slices[min(int(np.searchsorted(ends, t, side="right")), len(ends) - 1)]


Arrived = Callable[[TimeSlice], str]
"""Whether the motions of a slice need not be followed further: an empty string, or what is missing."""


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


def cover(task: TubeTask, starts: Starts, parts: int) -> tuple[list[Tube], str]:
    """Tubes for a box of starts, of at most so many parts, and what could not be proven of one (nothing: all is)."""
    waiting, done = [starts], list[Tube]()
    while waiting:
        tube, across = _grown(task, waiting.pop())
        if tube.verdict == "proven":
            done.append(tube)
        elif len(done) + len(waiting) + 2 <= parts and across is not None:
            waiting.extend(reversed(tube.starts.halves(across)))
        else:
            return [*done, tube], tube.reason
    return done, ""


def _grown(task: TubeTask, starts: Starts) -> tuple[Tube, int | None]:
    """The tube of one box of starts, and the coordinate across which to halve it where it is not proven."""
    motion, loop, centre = task.motion, task.motion.loop.equations, [ball(x) for x in starts.q.tolist()]
    try:
        asked = motion.asked(on_circles(motion.model, starts.q), centre, starts.v)
        start = motion.start(asked)
    except CcpinError as error:
        raise type(error)(f"at the start {starts.q.tolist()}: {error}") from None
    steps, slices, section = list[ProvenStep](), list[TimeSlice](), None
    since, missing, samples = 0.0, "", list[int]()

    def tube() -> Tube:
        proved, refused = proved_motion(loop, start, steps, samples, motion.precision)
        reached = float(proved.found["times"][-1])
        enclosure = told_of(motion.loop, asked._replace(duration=reached), proved, refused)
        return _tube(starts, enclosure, slices, missing or refused)

    for step, sampled in _motion(task, state_of(start).balls()):
        if not isinstance(step, ProvenStep):
            missing = step.reason
            break
        samples += [len(steps)] if sampled else []
        steps.append(step)
        if section is None:
            section = first_section(loop, instants_of(step, 0.0, 1), starts.spread)
        try:
            section = sampled_section(loop, step, section, task.cut) if sampled else section
            for batch in grow(loop, step, since, section, task.cut):
                slices.extend(batch)
                section = CrossSection(batch[-1].end, batch[-1].kept)
                missing = task.arrived(batch[-1]) if task.arrived else ""
                if task.arrived and not missing:
                    return tube(), None
        except UnboundedError as error:
            missing = str(error)
            break
        since += step.length
    across = _widest(starts, slices) if slices else int(starts.spread.argmax())
    across = None if missing == TOO_EARLY else across  # smaller parts do not help
    return tube(), across


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


def _tube(starts: Starts, enclosure: Enclosure, slices: list[TimeSlice], missing: str) -> Tube:
    reached = slices[-1].time + float(slices[-1].instant.half[0]) if slices else 0.0
    widths = ", ".join(f"{x:.3g}" for x in starts.spread)
    told = f"the motions within ±({widths}) of ({', '.join(f'{x:.6g}' for x in starts.q)})"
    if missing:
        reason = f"{told} are followed up to t = {reached:.6g} s in {len(slices)} slices: {missing}"
        return Tube(starts, "undecided", reason, enclosure, tuple(slices))
    return Tube(starts, "proven", f"{told} are in the tube for {reached:.6g} s", enclosure, tuple(slices))


def _widest(starts: Starts, slices: Sequence[TimeSlice]) -> int | None:
    """The coordinate of the starts that makes most of the tube's last cross-section."""
    last = slices[-1]
    edges = np.abs(last.frame) * last.bound
    shares = (edges / edges.sum(axis=1, keepdims=True)).sum(axis=0)[: len(starts.spread)] * (starts.spread > 0.0)
    return int(shares.argmax()) if shares.max() > 0.0 else None
