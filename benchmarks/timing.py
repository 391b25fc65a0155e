"""Timing: CPU time of calls taken in turn, so that a busy machine slows all alike, and medians of many rounds."""

from __future__ import annotations

import time
from collections.abc import Callable, Hashable, Mapping
from typing import Any, NamedTuple, TypeVar

import numpy as np

Key = TypeVar("Key", bound=Hashable)
Result = TypeVar("Result")


class Timing(NamedTuple):
    """CPU seconds of one call, a sample a round."""

    samples: np.ndarray

    @property
    def seconds(self) -> float:
        """The median."""
        return float(np.median(self.samples))

    def ratio(self, peer: Timing) -> float:
        """The median of the rounds' ratios to a peer's."""
        return float(np.median(self.samples / peer.samples))


def in_turn(calls: Mapping[Key, Callable[[], object]], rounds: int, slice_seconds: float) -> dict[Key, Timing]:
    """Every call timed once a round, each repeated within its turn for as long as `slice_seconds`.

    The first call of each is not counted: it warms caches, and says how often the others are repeated.
    """
    repeats = {key: _repeats(call, slice_seconds) for key, call in calls.items()}
    samples = {key: np.empty(rounds) for key in calls}
    for k in range(rounds):
        for key, call in calls.items():
            samples[key][k] = cpu_seconds(call, repeats[key])
    return {key: Timing(found) for key, found in samples.items()}


def cpu_seconds(call: Callable[[], object], repeats: int = 1) -> float:
    """CPU time of one call, the mean of some."""
    began = time.process_time()
    for _ in range(repeats):
        call()
    return max((time.process_time() - began) / repeats, 1e-9)


def timed(call: Callable[[], Result], clock: Callable[[], float] = time.process_time) -> tuple[Result, float]:
    """A result and the seconds it took."""
    began = clock()
    result = call()
    return result, max(clock() - began, 1e-9)


def exponent(sizes: Any, seconds: Any) -> float:
    """The slope of log(seconds) over log(sizes) by least squares: 1 is proportional."""
    return float(np.polyfit(np.log(sizes), np.log(seconds), 1)[0])


def _repeats(call: Callable[[], object], slice_seconds: float) -> int:
    call()
    once = cpu_seconds(call, 3) if cpu_seconds(call) < slice_seconds else slice_seconds
    return max(1, min(10_000, int(slice_seconds / max(once, 1e-7))))
