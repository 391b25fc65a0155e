"""The search for a tube that the tracking error cannot leave: what goes in must be larger than what comes out.

E and Ė are the unknowns of Theorem T (`ccpin/proof/theorems/tracking.md`). They start from the bound that the cells'
middles alone would give, and grow until its 4 and 5 hold on every cell, or until something is no longer proved.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.control.stability.tracking.deviation import Deviation, deviation_of
from ccpin.control.stability.tracking.error_equations import choice_for
from ccpin.control.stability.tracking.reference_tube import ReferenceTube
from ccpin.control.stability.tracking.storage import StorageChoice, gain, storage_of, widths
from ccpin.control.tracking import TrackingLaw
from ccpin.proof.rounding import SLACK
from ccpin.proof.verdict import Verdict

_ROUNDS = 10  # wider tubes tried, before the bound is left undecided
_FIRST = 2.2  # times what the cells' middles ask for: the first tube
_MORE = 1.3  # times what was needed: the next tube
_ROOM = 1.0 + 1e-6  # what comes out must be less than what went in by more than rounding
_PLANNED = 48  # cells at whose middles plans are compared, at most: a plan is a choice, its proof is over all


class TubeBounds(NamedTuple):
    """What a search ends with; `TrackingCertificate` (`tracking_error`) explains its numbers.

    Attributes:
        verdict, reason: As there.
        bound: Of (|e|, |ė|) over each cell, of shape (K, 2n).
        ultimate: Of shape (n,).
        decay, gain: α and γ.
        unit: Of shape (2n,).
        start: The bound of V at t = 0.
        room: (E, Ė) of the cells, of shape (K, 2n).
    """

    verdict: Verdict
    reason: str
    bound: Array
    ultimate: Array
    decay: float
    gain: float
    unit: Array
    start: float
    room: Array


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


class TubeSearch:
    """Looks for E and Ė with which Theorem T's hypotheses hold."""

    def __init__(self, law: TrackingLaw, tube: ReferenceTube, sigma_error: float, push: Array, start: Array) -> None:
        self.law, self.tube, self.sigma_error, self.push, self.start = law, tube, sigma_error, push, start
        self.plan: StorageChoice | None = None
        self.rounds = 0

    def found(self) -> TubeBounds:
        """What is proved, after as many rounds as it takes."""
        if self.tube.path.verdict != "proven":
            return self._undecided(f"the reference itself leaves what is proved: {self.tube.path.reason}")
        count, n = self.tube.motion[0].start.shape
        none = np.zeros((count, n))
        states, proved = self.tube.states(none, none)
        if not proved.all():
            return self._undecided(self._stopped("σ is not proved", ~proved, np.zeros((count, 2 * n))))
        middle = deviation_of(self.law, self.tube, states.middles(), 0.0)
        self.plan = self._planned(middle)
        if self.plan is None:
            return self._undecided("no storage function was found along the reference: stiffer gains would do more")
        levels = self._levels(middle)
        room = np.maximum(np.sqrt(levels.reached)[:, None] * levels.widths, levels.entries) * _FIRST
        for self.rounds in range(1, _ROUNDS + 1):
            states, proved = self.tube.states(room[:, :n], room[:, n:])
            if not proved.all():
                return self._undecided(self._stopped("σ is not proved", ~proved, room))
            levels = self._levels(deviation_of(self.law, self.tube, states, self.sigma_error), room)
            reason = self._open(levels, room)
            if reason is not None:
                return self._undecided(reason)
            if np.all(levels.reached * _ROOM < levels.allowed) and np.all(levels.entries * _ROOM < room):  # 4 and 5
                return self._proven(levels, room)
            needed = np.maximum(np.sqrt(levels.reached)[:, None] * levels.widths, levels.entries)
            room = np.maximum(room, needed) * _MORE
        return self._undecided(
            f"after {_ROUNDS} rounds the bound still grows, for a σ off by {self.sigma_error:.3g} lets the law deviate "
            "the more, the larger the error: a smaller sigma_error, more cells= or stiffer gains would do more"
        )

    def _planned(self, middle: Deviation) -> StorageChoice | None:
        rows = slice(None, None, 1 + len(middle.push) // _PLANNED)
        raw = np.linalg.norm(middle.slope.mid, axis=2) * self.sigma_error + middle.push @ self.push
        scale = raw.max(axis=0)
        scale = np.where(scale > 0.0, scale, max(float(scale.max()), 1e-300))
        return choice_for(self.law, scale, middle.D.mid[rows], middle.C.mid[rows], middle.damping.mid[rows])

    def _levels(self, deviation: Deviation, room: Array | None = None) -> Levels:
        """The largest v, c_k and what enters each cell, for 4 and 5, where its states are within `room`, (K, 2n)."""
        assert self.plan is not None
        storage = storage_of(self.law, self.plan, deviation.D, deviation.C, deviation.damping)
        size = deviation.size(self.sigma_error, self.push, self.plan.scale)
        with np.errstate(all="ignore"):
            sources = (gain(storage, self.plan) * size) ** 2 * SLACK
            width = np.broadcast_to(widths(storage), (len(size), 2 * len(self.push)))
            first = self.start + self.tube.kicks[0]
            start = float(first @ storage.P.magnitude[0] @ first) * SLACK
            kicks = np.sqrt(np.einsum("ki,kij,kj->k", self.tube.kicks, storage.P.magnitude, self.tube.kicks)) * SLACK
            kicks = np.broadcast_to(kicks, len(size)).copy()
            allowed = np.full(len(size), np.inf) if room is None else np.min((room / width) ** 2, axis=1)
            reached, ends = _reached(start, sources, kicks, self.plan.decay, np.diff(self.tube.times))
            entries = np.sqrt(ends[:-1])[:, None] * width[:-1] + self.tube.kicks[1:]
        return Levels(reached, allowed, width, np.concatenate([first[None], entries * SLACK]), sources, start)

    def _open(self, levels: Levels, room: Array) -> str | None:
        """Why no level is known, if one is not: which of 1 to 3 fails."""
        sources = levels.sources
        checks = (
            (~np.isfinite(levels.widths).all(axis=1), "D is not proved positive definite"),
            (np.isinf(sources), "V̇ is not proved negative"),
            (np.isnan(sources), f"φ_y (within {self.sigma_error:.3g} of σ) or D is not proved nonsingular"),
        )
        for failed, what in checks:
            if np.any(failed):
                return self._stopped(what, np.asarray(failed), room)
        return None

    def _stopped(self, what: str, where: Mask, room: Array) -> str:
        """A reason: what fails first, where, for which errors, and what would do more."""
        k = int(np.argmax(where))
        place = f"t = {self.tube.times[k]:.6g} s, q_d = {self.tube.motion[0].start[k].tolist()}"
        among = f"for errors up to {room[k, : len(self.push)].max():.3g}"
        return f"{what} {among} at {place}: a smaller sigma_error, more cells= or stiffer gains would do more"

    def _proven(self, levels: Levels, room: Array) -> TubeBounds:
        assert self.plan is not None
        n = len(self.push)
        bound = np.sqrt(levels.reached)[:, None] * levels.widths * SLACK
        worst = float(bound[:, :n].max())
        return TubeBounds(
            verdict="proven",
            reason=f"|q_d − q| stays below {worst:.3g} ({np.degrees(worst):.3g}°, where angles) with σ off by at most "
            f"{self.sigma_error:.3g}: {len(bound)} cells, {self.rounds} rounds",
            bound=bound,
            ultimate=np.sqrt(levels.sources[-1]) * levels.widths[-1, :n] * SLACK,
            decay=self.plan.decay,
            gain=float(np.sqrt(levels.sources.max()) / self.sigma_error),
            unit=levels.widths.max(axis=0),
            start=levels.start,
            room=room,
        )

    def _undecided(self, reason: str) -> TubeBounds:
        count, n = self.tube.motion[0].start.shape
        open_end, none = np.full((count, 2 * n), np.inf), np.zeros((count, 2 * n))
        return TubeBounds("undecided", reason, open_end, open_end[0, :n], 0.0, np.inf, open_end[0], np.inf, none)


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
