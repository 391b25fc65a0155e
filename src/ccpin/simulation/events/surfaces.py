"""Watches where something is met and left: stops, planes, what motors can give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.dynamics.state import State
from ccpin.simulation.events.samples import EventRecord, Stop
from ccpin.simulation.events.watches import AcceptedStep, Instant, Watch, crossing


class Surface(NamedTuple):
    """What the zeros of a function of (t, State, v) mean, whose value is negative beyond.

    Attributes:
        met: What has happened where the value becomes negative. left: where it becomes positive again.
    """

    met: str
    left: str


class SurfaceWatch(Watch):
    """Halts the integration where surfaces are met or left: on either side the equations are smooth.

    Args:
        values: (t, State, v) → how far it is to each surface, of shape (k,).
        surfaces: What they are.
        terminal: Whether the motion ends where one is met, or begins beyond it.
        short_steps: Whether something could be met and left within one long step of the integrator.
    """

    def __init__(
        self,
        values: Callable[[float, State, Array], Array],
        surfaces: Sequence[Surface],
        *,
        terminal: bool = False,
        short_steps: bool = True,
    ) -> None:
        self._values, self._surfaces, self._terminal, self.short_steps = values, tuple(surfaces), terminal, short_steps
        self._beyond: Mask | None = None
        self._found: tuple[float, int] | None = None
        self._ended = ""

    def begin(self, instant: Instant) -> None:
        """Take the sides here, where they are not known yet."""
        if self._beyond is None:
            here = self._values(*instant) < 0
            self._beyond = np.zeros_like(here) if self._terminal else here

    def look(self, step: AcceptedStep) -> float | None:
        """The first zero of any."""
        assert self._beyond is not None
        self._found = None
        for before, after in step.intervals() if self.short_steps else step.intervals(1):
            changed = np.flatnonzero((self._values(*step.at(after)) < 0) != self._beyond).tolist()
            if changed:
                zeros = [crossing(partial(self._value, step, k), before, after) for k in changed]
                self._found = min(zip(zeros, changed, strict=True))
                return self._found[0]
        return None

    def accept(self, step: AcceptedStep, until: float) -> list[EventRecord]:
        """Change sides where the step reaches that far."""
        if self._found is None or self._found[0] > until:
            return []
        assert self._beyond is not None
        t, k = self._found
        self._beyond = self._beyond.copy()
        self._beyond[k] = not self._beyond[k]
        name = self._surfaces[k].met if self._beyond[k] else self._surfaces[k].left
        self._ended = name if self._terminal and self._beyond[k] else ""
        return [EventRecord.at(name, step.at(t))]

    def jump(self, beyond: Mask) -> list[str]:
        """Be on these sides from here on, where what it reads has jumped: what that is called."""
        before, self._beyond = self._beyond, beyond.copy()
        if before is None:
            return []
        return [
            self._surfaces[k].met if beyond[k] else self._surfaces[k].left for k in np.flatnonzero(beyond != before)
        ]

    def act(self, instant: Instant) -> Stop | None:
        """A terminal surface ends the motion where it is met."""
        return Stop("event", f"at t = {instant.t:.6g} s: {self._ended}") if self._ended else None

    def _value(self, step: AcceptedStep, k: int, t: float) -> float:
        return float(self._values(*step.at(t))[k])
