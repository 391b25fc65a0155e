"""What enters and leaves a tube's cells: the numbers that Theorem T's 4 and 5 compare (`theorems/tracking.md`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import TimeCells
from ccpin.control.stability.tracking.deviation import Deviation
from ccpin.control.stability.tracking.error_equations import Feedback, StorageChoice
from ccpin.control.stability.tracking.storage import gain, storage_of, widths
from ccpin.proof.rounding import SLACK

ROOM = 1.0 + 1e-6  # what comes out must be less than what went in by more than rounding


class Disturbances(NamedTuple):
    """What drives and starts an error.

    Attributes:
        sigma_error: ε, rad and m.
        push: f̄, of shape (n,).
        start: Bounds of (e, ė) at t = 0, of shape (2n,).
    """

    sigma_error: float
    push: Array
    start: Array


class Levels(NamedTuple):
    """What one choice of E and Ė gives.

    Attributes:
        reached: The largest v on each cell, of shape (K,).
        allowed: c_k, of shape (K,).
        widths: (P_k⁻¹)_ii^½, of shape (K, 2n).
        entries: Bounds of |x| at the beginning of each cell, of shape (K, 2n): by the P of the cell before.
        sources: w_k, of shape (K,).
        start: v(0).
    """

    reached: Array
    allowed: Array
    widths: Array
    entries: Array
    sources: Array
    start: float

    @property
    def needed(self) -> Array:
        """(E, Ė) that would hold all that comes out, of shape (K, 2n)."""
        with np.errstate(all="ignore"):
            return np.maximum(np.sqrt(self.reached)[:, None] * self.widths, self.entries)

    @property
    def bound(self) -> Array:
        """Of (|e|, |ė|) over each cell, of shape (K, 2n)."""
        return np.asarray(np.sqrt(self.reached)[:, None] * self.widths * SLACK)

    def held(self, room: Array) -> bool:
        """4 and 5, where a cell's states are within `room`, (K, 2n)."""
        below = np.all(self.reached * ROOM < self.allowed) and np.all(self.entries * ROOM < room)
        return bool(below and np.isfinite(self.sources).all() and np.isfinite(self.widths).all())


def levels_of(
    law: Feedback,
    choice: StorageChoice,
    deviation: Deviation,
    given: Disturbances,
    cells: TimeCells,
    room: Array | None = None,
) -> Levels:
    """The largest v, c_k and what enters each cell, for 4 and 5, where its states are within `room`, (K, 2n)."""
    storage = storage_of(law, choice, deviation.D, deviation.C, deviation.damping)
    size = deviation.size(given.sigma_error, given.push, choice.scale)
    with np.errstate(all="ignore"):
        sources = (gain(storage, choice) * size) ** 2 * SLACK
        width = np.broadcast_to(widths(storage), (len(size), 2 * len(given.push)))
        kicks = cells.kicks
        first = given.start + kicks[0]
        start = float(first @ storage.P.magnitude[0] @ first) * SLACK
        jumps = np.sqrt(np.einsum("ki,kij,kj->k", kicks, storage.P.magnitude, kicks)) * SLACK
        jumps = np.broadcast_to(jumps, len(size)).copy()
        allowed = np.full(len(size), np.inf) if room is None else np.min((room / width) ** 2, axis=1)
        reached, ends = _reached(start, sources, jumps, choice.decay, np.diff(cells.times))
        entries = np.sqrt(ends[:-1])[:, None] * width[:-1] + kicks[1:]
    return Levels(reached, allowed, width, np.concatenate([first[None], entries * SLACK]), sources, start)


def _reached(start: float, sources: Array, kicks: Array, decay: float, durations: Array) -> tuple[Array, Array]:
    """The largest v of each cell, and that at its end: v̇ = −α(v − w_k), v^½ raised by a kick where a cell begins.

    The first kick is in v(0) already; the last cell has no end.
    """
    reached, ends, v = np.empty(len(sources)), np.empty(len(sources)), start
    for k, source in enumerate(sources):
        if k and kicks[k]:
            v = (np.sqrt(v) + kicks[k]) ** 2 * SLACK
        after = source + (v - source) * np.exp(-decay * durations[k]) if k + 1 < len(sources) else source
        reached[k] = max(v, after) * SLACK
        ends[k] = v = after * SLACK
    return reached, ends
