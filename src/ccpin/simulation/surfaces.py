"""Watches where something is met and left: stops, planes, what motors can give."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ccpin.arrays import Array, Mask
from ccpin.dynamics.state import State
from ccpin.simulation.happenings import Moment, Step, Watch
from ccpin.simulation.samples import Happening, Stop


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
        pacing: Whether something could be met and left within one long step of the integrator.
    """

    def __init__(
        self,
        values: Callable[[float, State, Array], Array],
        surfaces: Sequence[Surface],
        *,
        terminal: bool = False,
        pacing: bool = True,
    ) -> None:
        self._values, self._surfaces, self._terminal, self.pacing = values, tuple(surfaces), terminal, pacing
        self._beyond: Mask | None = None
        self._found: tuple[float, int] | None = None
        self._ended = ""

    def begin(self, moment: Moment) -> None:
        """Take the sides here, where they are not known yet."""
        if self._beyond is None:
            here = self._values(*moment) < 0
            self._beyond = np.zeros_like(here) if self._terminal else here

    def look(self, step: Step) -> float | None:
        """The first zero of any."""
        assert self._beyond is not None
        self._found, before = None, step.begin.t
        for after in step.times() if self.pacing else [step.end]:
            changed = np.flatnonzero((self._values(*step.at(after)) < 0) != self._beyond)
            if len(changed):
                self._found = min((self._zero(step, before, after, int(k)), int(k)) for k in changed)
                return self._found[0]
            before = after
        return None

    def accept(self, step: Step, until: float) -> list[Happening]:
        """Change sides where the step reaches that far."""
        if self._found is None or self._found[0] > until:
            return []
        assert self._beyond is not None
        t, k = self._found
        self._beyond = self._beyond.copy()
        self._beyond[k] = not self._beyond[k]
        name = self._surfaces[k].met if self._beyond[k] else self._surfaces[k].left
        self._ended = name if self._terminal and self._beyond[k] else ""
        return [Happening.at(name, step.at(t))]

    def jump(self, beyond: Mask) -> list[str]:
        """Be on these sides from here on, where what it reads has jumped: what that is called."""
        before, self._beyond = self._beyond, beyond.copy()
        if before is None:
            return []
        return [
            self._surfaces[k].met if beyond[k] else self._surfaces[k].left for k in np.flatnonzero(beyond != before)
        ]

    def act(self, moment: Moment) -> Stop | None:
        """A terminal surface ends the motion where it is met."""
        return Stop("event", f"at t = {moment.t:.6g} s: {self._ended}") if self._ended else None

    def _zero(self, step: Step, before: float, after: float, k: int) -> float:
        """The zero between two times; the first of them where the motion was beyond already (u may jump there)."""

        def value(t: float) -> float:
            return float(self._values(*step.at(t))[k])

        ahead, last = value(before), value(after)
        if (ahead < 0) == (last < 0) or not ahead:
            return before
        return float(brentq(value, before, after, xtol=1e-13)) if last else after
