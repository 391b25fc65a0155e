"""Takes the samples of a motion that fall due, and notes what happens in it."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.state import State
from ccpin.simulation.happenings import Moment, Step
from ccpin.simulation.samples import SAMPLED, Happening, StateSample


class Sampled(Protocol):
    """What samples are taken of: a `Run`."""

    def sample(self, moment: Moment) -> StateSample:
        """The motion at a moment."""

    def closed(self, x: Array, near: State | None = None) -> tuple[State, Array]:
        """The State and q̇ at (q, q̇)."""


class Recorder:
    """The samples of a motion at given times.

    σ at a sample starts from the sample before, and the motion itself never from a sample's: the motion does not
    depend on what is recorded of it.

    Args:
        times: When, increasing, s; none for a motion that is not recorded.

    Attributes:
        samples: Those taken. events: what happened.
    """

    def __init__(self, times: Array) -> None:
        self._times = times
        self._near: Moment | None = None
        self.samples: list[StateSample] = []
        self.events: list[Happening] = []

    def up_to(self, here: Moment, run: Sampled, slack: float) -> None:
        """Take the sample due at the present moment, if one is."""
        if self.due_before(here.t + slack):
            self.samples.append(run.sample(here._replace(t=self._times[len(self.samples)])))

    def due_before(self, t: float) -> bool:
        """Whether a sample is due up to a time."""
        return len(self.samples) < len(self._times) and bool(self._times[len(self.samples)] <= t)

    def due(self, until: float) -> Array:
        """The times of the samples due up to a time."""
        return self._times[len(self.samples) : np.searchsorted(self._times, until, side="right")]

    def take(self, samples: list[StateSample]) -> None:
        """Take samples that fell due and were made elsewhere."""
        self.samples += samples

    def within(self, step: Step, until: float, run: Sampled) -> None:
        """Take the samples due in a step, up to a time."""
        while self.due_before(until):
            t = float(self._times[len(self.samples)])
            near = step.begin if self._near is None or self._near.t < step.begin.t else self._near
            self._near = Moment(t, *run.closed(step.x(t), near.state))
            self.samples.append(run.sample(self._near))

    def happened(self, events: list[Happening]) -> None:
        """Note what happened."""
        self.events += events

    def last(self, here: Moment, run: Sampled) -> None:
        """Take the last sample where the motion ended, if none was taken there."""
        if not self.samples or self.samples[-1].t < here.t - 16 * np.spacing(abs(here.t)):
            self.samples.append(run.sample(here))

    def columns(self) -> dict[str, Any]:
        """The samples, column by column."""
        columns = [np.array(column) for column in zip(*self.samples, strict=True)]
        return dict(zip(SAMPLED, columns, strict=True))
