"""When a motion has settled: it has stayed within a band about its goal for a while."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from ccpin.arrays import Array
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.simulation.happenings import Moment, Step, Watch
from ccpin.simulation.samples import Happening, Stop

PARTS = 8


class Settling(NamedTuple):
    """When a motion counts as settled: |q − goal| ≤ band and |v| ≤ speed in every component, for `hold` seconds.

    The moment at which the motion enters (or leaves) the band is located in the integrator's dense output, to 1e-13 s;
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

    def begin(self, moment: Moment) -> None:
        """Within the band from here on, if it is and was not before."""
        if self.since is None and self._excess(moment.state.q, moment.v) <= 0:
            self.since = moment.t

    def look(self, step: Step) -> float | None:
        """Find where the band is entered and left; when the motion has settled."""
        self._crossings = []
        since, before = self.since, step.begin.t
        for after in step.times(tuple((np.arange(PARTS) + 1) / PARTS)):
            inside = self._at(step, after) <= 0
            if inside == (since is None):
                crossing = self._crossing(step, before, after, inside)
                if since is not None and crossing - since >= self._rule.hold:
                    return since + self._rule.hold
                since = crossing if inside else None
                self._crossings.append((crossing, inside))
            before = after
        due = np.inf if since is None else since + self._rule.hold
        return max(due, step.begin.t) if due <= step.end else None

    def accept(self, step: Step, until: float) -> list[Happening]:
        """Since when, as of there."""
        for t, inside in self._crossings:
            if t <= until:
                self.since = t if inside else None
        return []

    def act(self, moment: Moment) -> Stop | None:
        """The motion ends."""
        return None if self.since is None else Stop.settled(self.since)

    def _at(self, step: Step, t: float) -> float:
        x = step.x(t)
        return self._excess(x[: self._coordinates.nq], x[self._coordinates.nq :])

    def _excess(self, q: Array, v: Array) -> float:
        """Not positive within the band: the larger of |q − goal|/band and |v|/speed, less one."""
        error = self._coordinates.difference(q, self._rule.goal)
        shares = np.abs(error).max() / self._rule.band, np.abs(v).max() / self._rule.speed
        return float(max(shares) - 1.0)

    def _crossing(self, step: Step, before: float, after: float, inside: bool) -> float:
        """When the band is entered or left between two times; the first of them where it was at once, by an impact."""
        if (self._at(step, before) <= 0) == inside:
            return before
        return float(brentq(lambda t: self._at(step, t), before, after, xtol=1e-13))
