"""Takes the samples of a motion that fall due, and notes what happens in it."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from ccpin.arrays import Array
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.simulation.events.samples import SAMPLED, EventRecord, StateSample
from ccpin.simulation.events.watches import AcceptedStep, Instant

_ROOM = 2e9  # bytes that a motion's samples may take


class Sampled(Protocol):
    """What samples are taken of: a `Run`."""

    def sample(self, instant: Instant) -> StateSample:
        """The motion at an instant."""

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
        self._near: Instant | None = None
        self.samples: list[StateSample] = []
        self.events: list[EventRecord] = []

    def up_to(self, here: Instant, run: Sampled, slack: float) -> None:
        """Take the sample due at the present instant, if one is."""
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

    def within(self, step: AcceptedStep, until: float, run: Sampled) -> None:
        """Take the samples due in a step, up to a time."""
        while self.due_before(until):
            t = float(self._times[len(self.samples)])
            near = step.begin if self._near is None or self._near.t < step.begin.t else self._near
            self._near = Instant(t, *run.closed(step.x(t), near.state))
            self.samples.append(run.sample(self._near))

    def happened(self, events: list[EventRecord]) -> None:
        """Note what happened."""
        self.events += events

    def last(self, here: Instant, run: Sampled) -> None:
        """Take the last sample where the motion ended, if none was taken there."""
        if not self.samples or self.samples[-1].t < here.t - 16 * np.spacing(abs(here.t)):
            self.samples.append(run.sample(here))

    def columns(self) -> dict[str, Any]:
        """The samples, column by column."""
        columns = [np.array(column) for column in zip(*self.samples, strict=True)]
        return dict(zip(SAMPLED, columns, strict=True))


def sample_times(start: float, until: float, period: float, size: int) -> Array:
    """The times of samples: from the start in steps of a period, and the end.

    Raises:
        InvalidInputError: Samples of so many bytes would fill the memory.
    """
    duration = until - start
    room = duration / period * size
    if room > _ROOM:
        raise InvalidInputError(
            f"{duration:.3g} s in samples of {period:.3g} s would take {room / 1e9:.3g} GB: ask for a longer "
            f"sample_period, {1.1 * duration * size / _ROOM:.2g} s, or for a part of the motion at a time"
        )
    times = start + np.arange(np.floor(duration / period * (1 + 1e-12)) + 1) * period
    if times[-1] < until - 1e-9 * duration:
        return np.append(times, until)
    times[-1] = until
    return times
