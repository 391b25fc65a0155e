"""What a run may cost."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from ccpin.simulation.events.samples import Stop


class Budget(NamedTuple):
    """What a run may cost before it ends with status ``exhausted``.

    Attributes:
        evaluations: Of the equations of motion. seconds: of wall time. ``None``: no bound.
    """

    evaluations: int | None = None
    seconds: float | None = None

    def numbers(self) -> dict[str, float]:
        """The same as the compiled core takes it: infinite where there is no bound."""
        return {name: np.inf if value is None else value for name, value in self._asdict().items()}


class Allowance(NamedTuple):
    """A budget from an instant on.

    Attributes:
        evaluations: The count of evaluations at which it is spent. clock: the reading of `time.perf_counter`.
    """

    evaluations: int | None
    clock: float | None

    @classmethod
    def of(cls, budget: Budget, evaluations: int) -> Allowance:
        """What a budget allows from now on."""
        most, seconds = budget
        return cls(
            None if most is None else evaluations + most, None if seconds is None else time.perf_counter() + seconds
        )

    def left(self, evaluations: int) -> Budget:
        """What is left of it."""
        return Budget(
            None if self.evaluations is None else max(0, self.evaluations - evaluations),
            None if self.clock is None else max(0.0, self.clock - time.perf_counter()),
        )

    def exceeded(self, evaluations: int, t: float) -> Stop | None:
        """The end of a motion at time t, where it is spent."""
        if self.evaluations is not None and evaluations >= self.evaluations:
            return Stop.exhausted(t, "evaluations")
        if self.clock is not None and time.perf_counter() >= self.clock:
            return Stop.exhausted(t, "seconds")
        return None
