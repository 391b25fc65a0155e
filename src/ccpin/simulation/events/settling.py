"""When a motion has settled: it has stayed within a band about its goal for a while."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.simulation.events.samples import EventRecord, Stop
from ccpin.simulation.events.watches import AcceptedStep, Instant, Watch, crossing

PARTS = 8  # of a step, at whose ends one looks whether the motion is inside


class Settling(NamedTuple):
    """When a motion counts as settled: |q − goal| ≤ band and |v| ≤ speed in every component, for `hold` seconds.

    The instant at which the motion enters (or leaves) the band is located in the integrator's dense output, to 1e-13 s;
    it does not depend on when output is sampled. band in radians (or metres), speed in rad/s (or m/s).
    """

    goal: Array
    band: float = 0.0017453292519943296
    speed: float = 0.01
    hold: float = 0.05


class SettlingWatch(Watch):
    """Since when the motion is within the band, and whether for long enough.

    Args:
        rule: The rule.
        coordinates: α.
    """

    def __init__(self, rule: Settling, coordinates: IndependentCoordinates) -> None:
        self._rule, self._coordinates = rule, coordinates
        self.since: float | None = None
        self._crossings: list[tuple[float, bool]] = []

    def begin(self, instant: Instant) -> None:
        """Within the band from here on, if it is and was not before."""
        if self.since is None and self._room(instant.state.q, instant.v) >= 0:
            self.since = instant.t

    def look(self, step: AcceptedStep) -> float | None:
        """Find where the band is entered and left; when the motion has settled."""
        self._crossings = []
        since = self.since
        for before, after in step.intervals(PARTS):
            inside = self._room_at(step, after) >= 0
            if inside == (since is None):
                t = crossing(lambda t: self._room_at(step, t), before, after)
                if since is not None and t - since >= self._rule.hold:
                    return since + self._rule.hold
                since = t if inside else None
                self._crossings.append((t, inside))
        due = np.inf if since is None else since + self._rule.hold
        return max(due, step.begin.t) if due <= step.end else None

    def accept(self, step: AcceptedStep, until: float) -> list[EventRecord]:
        """Since when, as of there."""
        for t, inside in self._crossings:
            if t <= until:
                self.since = t if inside else None
        return []

    def act(self, instant: Instant) -> Stop | None:
        """The motion ends."""
        return None if self.since is None else Stop.settled(self.since)

    def _room_at(self, step: AcceptedStep, t: float) -> float:
        x = step.x(t)
        return self._room(x[: self._coordinates.nq], x[self._coordinates.nq :])

    def _room(self, q: Array, v: Array) -> float:
        """Negative beyond the band: one less the larger of |q − goal|/band and |v|/speed."""
        error = self._coordinates.difference(q, self._rule.goal)
        shares = np.abs(error).max() / self._rule.band, np.abs(v).max() / self._rule.speed
        return float(1.0 - max(shares))
