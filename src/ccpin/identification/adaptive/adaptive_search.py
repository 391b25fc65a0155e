"""The search for a tube that an adaptive law's error cannot leave: what is found is proposed, `AdaptiveTube` proves it.

E, S and the bounds of |ṡ| start from nothing and grow to what comes out, until less comes out than goes in.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.control.stability.tracking.cell_forms import forms_of
from ccpin.control.stability.tracking.reference_tube import ReferenceTube
from ccpin.identification.adaptive.adaptive_bounds import bounds_of
from ccpin.identification.adaptive.adaptive_levels import AdaptiveLevels, levels_of
from ccpin.identification.adaptive.adaptive_states import SmoothCells, states_of
from ccpin.identification.adaptive.adaptive_tube_claim import AdaptiveTube
from ccpin.proof.facts import Fact, NotProvedError, prove
from ccpin.proof.newton import Boxes

_ROUNDS = 24  # wider tubes tried, before the bound is left undecided
_FIRST = 1e-3  # of speeds, 1/s, and of what they bring: the first tube
_MORE = 1.04  # times what was needed: the next tube
_MOST = 1e6  # of what comes out: there is no use in going on


class FoundAdaptiveTube(NamedTuple):
    """What a search ends with: the fact, ``None`` where none was found, and why, in a sentence."""

    proved: Fact | None
    reason: str


class AdaptiveSearch:
    """Looks for rooms and rates with which the theorem's hypotheses hold."""

    def __init__(self, tube: ReferenceTube, start: Array) -> None:
        own = tube.equations
        smooth = SmoothCells.of(own.motion, own.motion[2].derivative(), tube.cells.times)
        self.tube, self.jerk, self.start = tube._replace(cells=smooth.cells), smooth.jerk, start

    def found(self) -> FoundAdaptiveTube:
        """What is proved, after as many rounds as it takes."""
        tube, own = self.tube, self.tube.equations
        n, T, shortest = own.closures.system.n, own.gains.period, float(np.diff(tube.cells.times).min())
        if tube.path.verdict != "proven":
            return FoundAdaptiveTube(None, f"the reference itself leaves what is proved: {tube.path.reason}")
        if shortest < T:
            more = "fewer cells= would do" if tube.cells.times[-1] >= T else "a shorter period= is needed"
            return FoundAdaptiveTube(None, f"cells of {shortest:.3g} s are shorter than the law's period: {more}")
        room = np.tile(np.concatenate([_FIRST / own.gains.slope, np.full(n, _FIRST)]), (len(tube.centre), 1))
        rates = np.full((len(tube.centre), n), _FIRST)
        for _ in range(_ROUNDS):
            boxes, proved = tube.boxes(room[:, :n])
            if not proved.all():
                return self._stopped("σ is not proved", ~proved, room)
            levels = self._levels(boxes, room, rates)
            failed = ~np.isfinite(np.hstack([levels.needed, levels.rates])).all(axis=1)
            if np.any(failed):
                what = "φ_y, D of all constants of the box or K over a period is not proved regular"
                return self._stopped(what, np.asarray(failed), room)
            if levels.held(room, rates):
                return self._proved(boxes, room, rates)
            if max(levels.needed.max(), levels.rates.max()) > _MOST:
                break
            room, rates = np.maximum(room, _MORE * levels.needed), np.maximum(rates, _MORE * levels.rates)
        return FoundAdaptiveTube(None, self._why(room))

    def _levels(self, boxes: Boxes, room: Array, rates: Array) -> AdaptiveLevels:
        tube, own = self.tube, self.tube.equations
        states = states_of(forms_of(own.closures.system, boxes, tube.cells, room), self.jerk, own.gains.slope, rates)
        return levels_of(own, bounds_of(own, states, room), tube.cells.times, room, rates, self.start)

    def _why(self, room: Array) -> str:
        n, T = self.tube.equations.closures.system.n, self.tube.equations.gains.period
        return (
            f"the bound grows without end: for errors of {room[:, :n].max():.3g} and more let the efforts that are "
            f"held for {T:.3g} s, and constants as far apart as the box allows, push the more: a shorter period, a "
            "smaller box, other gains or more cells= would do more"
        )

    def _stopped(self, what: str, where: Mask, room: Array) -> FoundAdaptiveTube:
        """A reason: what fails first, where, and for which errors."""
        k, cells, n = int(np.argmax(where)), self.tube.cells, self.tube.equations.closures.system.n
        place = f"t = {cells.times[k]:.6g} s, q_d = {cells.place.start[k].tolist()}"
        more = "a shorter period, a smaller box, other gains or more cells= would do more"
        return FoundAdaptiveTube(None, f"{what} for errors up to {room[k, :n].max():.3g} at {place}: {more}")

    def _proved(self, boxes: Boxes, room: Array, rates: Array) -> FoundAdaptiveTube:
        """The fact, and what it says."""
        tube, n = self.tube, rates.shape[1]
        claim = AdaptiveTube(tube.equations, tube.cells.times, room, rates, self.start)
        path = tube.path.proved
        assert path is not None
        try:
            fact = prove(claim, path, *tube.proved(boxes))
        except NotProvedError as error:
            return FoundAdaptiveTube(None, f"a bound was found, and did not hold when it was to be proved: {error}")
        worst = float(fact.found["bound"][:, :n].max())
        said = f"|q − q_d| stays below {worst:.3g} ({np.degrees(worst):.3g}°, where angles) for every robot of the box"
        return FoundAdaptiveTube(fact, f"{said}, sampled every {tube.equations.gains.period:.3g} s: {len(room)} cells")
