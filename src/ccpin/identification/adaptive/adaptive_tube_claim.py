"""The claim that an adaptive law keeps its error in a tube, whatever the robot of its box (`theorems/adaptive.md`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import TimeCells
from ccpin.control.stability.tracking.reference_cells import OverCells
from ccpin.identification.adaptive.adaptive_bounds import bounds_of
from ccpin.identification.adaptive.adaptive_equations import AdaptiveEquations
from ccpin.identification.adaptive.adaptive_levels import levels_of
from ccpin.identification.adaptive.adaptive_states import SmoothCells, states_of
from ccpin.proof.facts import Examined, Fact, Form, provable, require


@provable
@dataclass(frozen=True, eq=False)
class AdaptiveTube(OverCells):
    """Every motion of a sampled adaptive law goes on for all t ≥ 0, its error in a tube.

    That is on the branch of its start, whatever constants of the box the robot has and the law begins with.
    `room` is (E, S) of q − q_d and s.

    Attributes:
        rates: Bounds of |ṡ| over each cell, of shape (K, n).
        start: Bounds of (q − q_d, s) at t = 0, of shape (2n,).

    Found: `bound` (K, 2n) of (|q − q_d|, |s|) over each cell; `ultimate` (n,) of |q − q_d| as t → ∞; `efforts` (K, n)
    of the generalized force that the law asks for; `power` (1,), p, and `first` (1,), V(0), with
    ∫ sᵀKs ≤ V(0) + p t over the first t = kT seconds; `level` (K,) of V_s^½.
    """

    equations: AdaptiveEquations
    rates: Annotated[Array, Form("KP", above=0.0)]
    start: Annotated[Array, Form("X", least=0.0)]
    theorem = "adaptive"

    def examined(self, *premises: Fact) -> Examined:
        """Lemma T over the cells, then 1 to 5."""
        own = self.equations
        solutions, _ = self.covered(*premises)
        require(np.diff(self.times) >= own.gains.period, "a cell that is shorter than the period")
        jerk = self._smooth().jerk
        states = states_of(self.states(solutions), jerk, own.gains.slope, self.rates)
        levels = levels_of(own, bounds_of(own, states, self.room), self.times, self.room, self.rates, self.start)
        require(levels.held(self.room, self.rates), "what comes out is not shown to be less than what goes in")
        told = ("bound", "ultimate", "efforts", "power", "first", "level")
        return Examined(np.ones(1, dtype=np.bool_), {name: getattr(levels, name) for name in told})

    def _cells(self) -> TimeCells:
        """The reference between the times, as a C² motion.

        Raises:
            NotProvedError: The times are not all of it, one lies across a knot, or it jumps.
        """
        super()._cells()
        return self._smooth().cells

    def _smooth(self) -> SmoothCells:
        motion = self.equations.motion
        with np.errstate(all="ignore"):
            return SmoothCells.of(motion, motion[2].derivative(), self.times)
