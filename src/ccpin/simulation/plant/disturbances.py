"""What pushes from outside for a while: wrenches on links with the times at which they come and go."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, number, records, vector
from ccpin.dynamics.state import State
from ccpin.dynamics.wrenches import Pushes, Wrench, Wrenches
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import LinkPoint


@dataclass(frozen=True)
class Push:
    """Wrenches on links from one time to another.

    Attributes:
        wrenches: By link, as for `State.forward_dynamics`; or a function (t, state, v) of them, smooth in between.
        start: When they come, s. end: when they go; default never.

    Raises:
        InvalidInputError: Times that are not numbers in that order.
    """

    wrenches: Wrenches | Pushes
    start: float = 0.0
    end: float = np.inf

    def __post_init__(self) -> None:
        if not callable(self.wrenches):
            instance(
                self.wrenches, "wrenches of a push", Mapping, "a mapping of link names or a function of (t, state, v)"
            )
        number(self.start, "start of a push")
        end = self.end if isinstance(self.end, float) and self.end == np.inf else number(self.end, "end of a push")
        if not self.start < end:
            raise InvalidInputError(f"a push from {self.start} s to {self.end} s: it must start before it ends")


class Disturbance:
    """Several pushes as one function (t, state, v) that knows its switching times; for `wrenches` of `simulate`.

    Args:
        pushes: What pushes; those that overlap add up.
    """

    def __init__(self, pushes: Sequence[Push]) -> None:
        self.pushes = records(pushes, "pushes", Push)
        times = {time for push in self.pushes for time in (push.start, push.end)}
        self._times = np.array(sorted(time for time in times if np.isfinite(time)))

    def next_switch(self, t: float) -> float:
        """The first time after t at which a push comes or goes, infinite where none does."""
        later = self._times[self._times > t]
        return float(later[0]) if len(later) else np.inf

    def __call__(self, t: float, state: State, v: Array) -> Wrenches | None:
        """The wrenches at a time."""
        total: dict[str, list[_WrenchArrays]] = {}
        for push in self.pushes:
            if push.start <= t < push.end:
                wrenches = push.wrenches(t, state, v) if callable(push.wrenches) else push.wrenches
                for link, value in (wrenches or {}).items():
                    total.setdefault(link, []).append(_acting(link, value))
        return {link: _sum(link, each, state) for link, each in total.items()} or None


class _WrenchArrays(NamedTuple):
    """A `Wrench` in arrays."""

    force: Array
    moment: Array
    point: Array


def _acting(link: str, value: Wrench | ArrayLike) -> _WrenchArrays:
    if isinstance(value, Wrench):
        return _WrenchArrays(*(vector(part, f"the wrench on '{link}'", 3) for part in value))
    both = vector(value, f"the wrench on '{link}'", 6)
    return _WrenchArrays(both[:3], both[3:], np.zeros(3))


def _sum(link: str, each: list[_WrenchArrays], state: State) -> Wrench:
    """Wrenches on one link as one: at their common point, else at the link's origin."""
    forces, moments, points = map(np.array, zip(*each, strict=True))
    force, moment = forces.sum(axis=0), moments.sum(axis=0)
    if (points == points[0]).all():
        return Wrench(force, moment, points[0])
    turn = LinkPoint(state.model.mechanism.tree, link).pose(state.q_free)[:3, :3]
    return Wrench(force, moment + np.cross(points @ turn.T, forces).sum(axis=0))
