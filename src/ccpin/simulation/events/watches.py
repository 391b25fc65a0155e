"""What is watched for while a motion is integrated: the user's events, settling, a region left, joints with friction.

A `Watch` looks at each accepted step through the integrator's dense output, at fixed parts of the step and at its end,
and finds the instant by bisection or Brent's method; so what it finds does not depend on when output is sampled.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ccpin.arrays import Array
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.simulation.events.samples import EventRecord, Stop

WIDTH = 1e-10  # s, to which the time of an event is found
_PARTS = 4  # of a step, at whose ends one looks: what comes and goes within one is missed


class Event(NamedTuple):
    """Something to look for: a zero of a function along the motion.

    Attributes:
        function: (t, State, v) → a number whose sign changes; continuous along the motion.
        name: What it is called in the trajectory.
        direction: 1: zeros from below alone; −1: from above alone; 0: both.
        terminal: Whether the motion ends there, with status ``event``.
    """

    function: Callable[[float, State, Array], float]
    name: str = "event"
    direction: int = 0
    terminal: bool = False


class Instant(NamedTuple):
    """A time, the State and q̇ there."""

    t: float
    state: State
    v: Array


class AcceptedStep:
    """One accepted step of the integrator.

    Args:
        begin: Where it begins.
        end: Time at which it ends, s.
        dense: (q, q̇) at a time within it; ``None`` where nobody will ask.
        closed: The State and q̇ at (q, q̇).
    """

    def __init__(
        self,
        begin: Instant,
        end: float,
        dense: Callable[[float], Array] | None,
        closed: Callable[[Array], tuple[State, Array]],
    ) -> None:
        self.begin, self.end = begin, end
        self._dense, self._closed = dense, closed
        self._instants: dict[float, Instant] = {begin.t: begin}

    def x(self, t: float) -> Array:
        """(q, q̇) at a time of the step."""
        assert self._dense is not None
        return self._dense(t)

    def at(self, t: float) -> Instant:
        """The instant at a time of the step; each is closed once."""
        if t not in self._instants:
            self._instants[t] = Instant(t, *self._closed(self.x(t)))
        return self._instants[t]

    def intervals(self, parts: int = _PARTS) -> Iterator[tuple[float, float]]:
        """The intervals, of equal length, at whose ends one looks; the last ends with the step."""
        begin, length = self.begin.t, self.end - self.begin.t
        times = [begin, *(begin + part / parts * length for part in range(1, parts)), self.end]
        return pairwise(times)

    def first(self, happened: Callable[[Instant], bool]) -> float | None:
        """The first time looked at where something has happened, to 1e-10 s."""
        for before, after in self.intervals():
            if happened(self.at(after)):
                while after - before > max(WIDTH, 4 * np.spacing(after)):
                    middle = 0.5 * (before + after)
                    before, after = (before, middle) if happened(self.at(middle)) else (middle, after)
                return after
        return None


def crossing(value: Callable[[float], float], before: float, after: float) -> float:
    """When a function becomes negative, or ceases to be so, between two times, to 1e-13 s.

    The first of them where it has changed there already: by a rounding error, or where something has jumped.
    """
    if (value(before) < 0) == (value(after) < 0):
        return before
    return float(brentq(value, before, after, xtol=1e-13))


class Watch:
    """Looks for one kind of thing; this one never sees any.

    Attributes:
        short_steps: Whether it could miss something in a long step of the integrator.
    """

    short_steps = True

    def begin(self, instant: Instant) -> None:
        """The motion begins (or goes on after what changed it) here."""

    def look(self, step: AcceptedStep) -> float | None:
        """When within the step the integration has to halt, or ``None``."""
        return None

    def accept(self, step: AcceptedStep, until: float) -> list[EventRecord]:
        """The step counts up to a time: what has happened in it."""
        return []

    def act(self, instant: Instant) -> Stop | None:
        """The integration has halted for this watch: the end of the motion, or ``None`` to go on from there."""
        return None


class EventWatch(Watch):
    """One event of the user's.

    A side is a sign of the function; zero belongs to the side the motion was on. A zero found is one once: the motion
    is on the other side from there on.

    Raises:
        InvalidInputError: The event's function or direction is none, or the function does not return a finite number.
    """

    def __init__(self, event: Event) -> None:
        if not callable(event.function) or event.direction not in (-1, 0, 1):
            raise InvalidInputError(
                f"event '{event.name}': it needs a function (t, State, v) → number and a direction of −1, 0 or 1"
            )
        self._event = event
        self._side = 0.0
        self._found: list[tuple[float, float]] = []

    def begin(self, instant: Instant) -> None:
        """Take the side here, where it is not known yet."""
        if not self._side:
            self._side = np.sign(self._value(instant))

    def look(self, step: AcceptedStep) -> float | None:
        """Find the zeros in the step; a terminal one halts."""
        self._found = []
        side = self._side
        for before, after in step.intervals():
            there = np.sign(self._value(step.at(after)))
            if side and there == -side:
                t = crossing(lambda t: self._value(step.at(t)), before, after)
                self._found.append((t, there))
                if self._event.terminal and self._counts(there):
                    return t
            side = there or side
        return None

    def accept(self, step: AcceptedStep, until: float) -> list[EventRecord]:
        """Record the zeros up to there, and change sides."""
        happened = []
        for t, side in self._found:
            if t <= until:
                self._side = side
                if self._counts(side):
                    happened.append(EventRecord.at(self._event.name, step.at(t)))
        if not self._side:
            self._side = np.sign(self._value(step.at(until)))
        return happened

    def act(self, instant: Instant) -> Stop | None:
        """A terminal event ends the motion."""
        return Stop("event", f"at t = {instant.t:.6g} s: {self._event.name}")

    def _counts(self, side: float) -> bool:
        return self._event.direction in (0, side)

    def _value(self, instant: Instant) -> float:
        value = float(self._event.function(*instant))
        if not np.isfinite(value):
            raise InvalidInputError(f"event '{self._event.name}' returned {value} at t = {instant.t:.6g} s")
        return value


class RegionWatch(Watch):
    """A region that must not be left."""

    def __init__(self, region: Callable[[Array], bool]) -> None:
        self._region = region

    def look(self, step: AcceptedStep) -> float | None:
        """The first instant outside."""
        return step.first(lambda instant: not self._region(instant.state.q))

    def act(self, instant: Instant) -> Stop | None:
        """The motion ends."""
        return Stop("outside", f"at t = {instant.t:.6g} s q left the region given")
