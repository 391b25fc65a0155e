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


class Allowance(NamedTuple):
    """A budget from an instant on.

    Attributes:
        evaluations: The count of evaluations at which it is spent. clock: the reading of `time.perf_counter`.
    """

    evaluations: float
    clock: float

    @classmethod
    def of(cls, budget: Budget, evaluations: int) -> Allowance:
        """What a budget allows from now on."""
        most = np.inf if budget.evaluations is None else evaluations + budget.evaluations
        return cls(most, np.inf if budget.seconds is None else time.perf_counter() + budget.seconds)

    def left(self, evaluations: int) -> dict[str, float]:
        """What is left of it, as the compiled core takes it."""
        return {"evaluations": self.evaluations - evaluations, "seconds": self.clock - time.perf_counter()}

    def exceeded(self, evaluations: int, t: float) -> Stop | None:
        """The end of a motion at time t, where it is spent."""
        if evaluations >= self.evaluations:
            return Stop.exhausted(t, "evaluations")
        if time.perf_counter() >= self.clock:
            return Stop.exhausted(t, "seconds")
        return None
