"""What is watched for while a motion is integrated: the user's events, settling, a region left, joints with friction.

A `Watch` looks at each accepted step through the integrator's dense output, at fixed parts of the step and at its end,
and finds the moment by bisection or Brent's method; so what it finds does not depend on when output is sampled.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ccpin.arrays import Array
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.simulation.samples import Happening, Stop

WIDTH = 1e-10
_PARTS = (0.25, 0.5, 0.75, 1.0)
_FINE_PARTS = tuple((np.arange(8) + 1) / 8)


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


class Moment(NamedTuple):
    """A time, the State and q̇ there."""

    t: float
    state: State
    v: Array


class Step:
    """One accepted step of the integrator.

    Args:
        begin: Where it begins.
        end: Time at which it ends, s.
        dense: (q, q̇) at a time within it; ``None`` where nobody will ask.
        closed: The State and q̇ at (q, q̇).
    """

    def __init__(
        self,
        begin: Moment,
        end: float,
        dense: Callable[[float], Array] | None,
        closed: Callable[[Array], tuple[State, Array]],
    ) -> None:
        self.begin, self.end = begin, end
        self._dense, self._closed = dense, closed
        self._moments: dict[float, Moment] = {begin.t: begin}

    def x(self, t: float) -> Array:
        """(q, q̇) at a time of the step."""
        assert self._dense is not None
        return self._dense(t)

    def at(self, t: float) -> Moment:
        """The moment at a time of the step; each is closed once."""
        if t not in self._moments:
            self._moments[t] = Moment(t, *self._closed(self.x(t)))
        return self._moments[t]

    def times(self, parts: tuple[float, ...] = _PARTS) -> list[float]:
        """The times that are looked at, the step's end last."""
        length = self.end - self.begin.t
        return [self.begin.t + part * length for part in parts[:-1]] + [self.end]

    def first(self, happened: Callable[[Moment], bool]) -> float | None:
        """The first time looked at where something has happened, to 1e-10 s."""
        before = self.begin.t
        for after in self.times():
            if not happened(self.at(after)):
                before = after
                continue
            while after - before > max(WIDTH, 4 * np.spacing(after)):
                middle = 0.5 * (before + after)
                before, after = (before, middle) if happened(self.at(middle)) else (middle, after)
            return after
        return None


class Watch:
    """Looks for one kind of thing; this one never sees any.

    Attributes:
        pacing: Whether it could miss something in a long step of the integrator.
    """

    pacing = True

    def begin(self, moment: Moment) -> None:
        """The motion begins (or goes on after what changed it) here."""

    def look(self, step: Step) -> float | None:
        """When within the step the integration has to halt, or ``None``."""
        return None

    def accept(self, step: Step, until: float) -> list[Happening]:
        """The step counts up to a time: what has happened in it."""
        return []

    def act(self, moment: Moment) -> Stop | None:
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

    def begin(self, moment: Moment) -> None:
        """Take the side here, where it is not known yet."""
        if not self._side:
            self._side = np.sign(self._value(moment))

    def look(self, step: Step) -> float | None:
        """Find the zeros in the step; a terminal one halts."""
        self._found = []
        side, before = self._side, step.begin.t
        for after in step.times():
            there = np.sign(self._value(step.at(after)))
            if side and there == -side:
                t = self._zero(step, before, after, side)
                self._found.append((t, there))
                if self._event.terminal and self._counts(there):
                    return t
            side, before = there or side, after
        return None

    def accept(self, step: Step, until: float) -> list[Happening]:
        """Record the zeros up to there, and change sides."""
        happened = []
        for t, side in self._found:
            if t <= until:
                self._side = side
                if self._counts(side):
                    happened.append(Happening.at(self._event.name, step.at(t)))
        if not self._side:
            self._side = np.sign(self._value(step.at(until)))
        return happened

    def act(self, moment: Moment) -> Stop | None:
        """A terminal event ends the motion."""
        return Stop("event", f"at t = {moment.t:.6g} s: {self._event.name}")

    def _counts(self, side: float) -> bool:
        return self._event.direction in (0, side)

    def _value(self, moment: Moment) -> float:
        value = float(self._event.function(*moment))
        if not np.isfinite(value):
            raise InvalidInputError(f"event '{self._event.name}' returned {value} at t = {moment.t:.6g} s")
        return value

    def _zero(self, step: Step, before: float, after: float, side: float) -> float:
        """The zero between two times; the first of them where the motion was over it already by a rounding error."""
        if self._value(step.at(before)) * side <= 0:
            return before
        return float(brentq(lambda t: self._value(step.at(t)), before, after, xtol=1e-13))


class RegionWatch(Watch):
    """A region that must not be left."""

    def __init__(self, region: Callable[[Array], bool]) -> None:
        self._region = region

    def look(self, step: Step) -> float | None:
        """The first moment outside."""
        return step.first(lambda moment: not self._region(moment.state.q))

    def act(self, moment: Moment) -> Stop | None:
        """The motion ends."""
        return Stop("outside", f"at t = {moment.t:.6g} s q left the region given")
