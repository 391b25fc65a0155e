"""The claim that a tracking error stays in a tube: Theorem T over cells that are facts (`theorems/tracking.md`)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import TimeCells, forms_of
from ccpin.control.stability.tracking.deviation import deviation_of
from ccpin.control.stability.tracking.error_equations import StorageChoice
from ccpin.control.stability.tracking.reference_cells import OverCells
from ccpin.control.stability.tracking.tracking_equations import TrackingEquations
from ccpin.control.stability.tracking.tube_levels import Disturbances, Levels, levels_of
from ccpin.proof.facts import Examined, Fact, Form, provable, require
from ccpin.proof.rounding import SLACK


@provable
@dataclass(frozen=True, eq=False)
class TubeKept(OverCells):
    """Every motion of a tracking law goes on for all t ≥ 0 on the branch of its start, with its error in a tube.

    That is whatever δ, ‖δ‖₂ ≤ ε, σ is off by, and whatever force |f| ≤ f̄ acts besides. `room` is (E, Ė).

    Attributes:
        scale: L's diagonal, of shape (n,).
        decay, cross: α and c, 1/s, of shape (1,) each.
        storage: P of computed torque, of shape (2n, 2n); none, (0, 0), for laws whose P is of D.
        sigma_error: ε, of shape (1,).
        disturbance: f̄, of shape (n,).
        start: Bounds of (e, ė) at t = 0, of shape (2n,).

    Found: `bound` (K, 2n) of (|e|, |ė|) over each cell; `ultimate` (n,) of |e| as t → ∞; `gain` (1,), γ, where there is
    no disturbance; `unit` (2n,), |x_i| ≤ unit_i V^½ anywhere; `level` (1,), v(0).
    """

    equations: TrackingEquations
    scale: Annotated[Array, Form("P", above=0.0)]
    decay: Annotated[Array, Form("1", above=0.0)]
    cross: Annotated[Array, Form("1", least=0.0)]
    storage: Annotated[Array, Form("SS")]
    sigma_error: Annotated[Array, Form("1", above=0.0)]
    disturbance: Annotated[Array, Form("P", least=0.0)]
    start: Annotated[Array, Form("X", least=0.0)]
    theorem = "tracking"

    def examined(self, *premises: Fact) -> Examined:
        """Lemma T over the cells, then 1 to 5."""
        solutions, cells = self.covered(*premises)
        levels = self._levels(solutions, cells)
        require(levels.held(self.room), "what comes out is not shown to be less than what goes in")
        n, sources = self.equations.closures.system.n, levels.sources
        return Examined(
            np.ones(1, dtype=np.bool_),
            {
                "bound": levels.bound,
                "ultimate": np.sqrt(sources[-1]) * levels.widths[-1, :n] * SLACK,
                "gain": np.sqrt(sources.max(keepdims=True)) / self.sigma_error,
                "unit": levels.widths.max(axis=0),
                "level": np.array([levels.start]),
            },
        )

    def _levels(self, solutions: Fact, cells: TimeCells) -> Levels:
        """What the cells' states give."""
        own, n = self.equations, self.equations.closures.system.n
        due = (2 * n, 2 * n) if own.error.by_mass else (0, 0)
        P, epsilon = self.storage, float(self.sigma_error[0])
        require(P.shape == due and np.array_equal(P, P.T), "another storage function")
        choice = StorageChoice(float(self.decay[0]), float(self.cross[0]), self.scale, P if P.size else None)
        states = forms_of(own.closures.system, solutions.claim.boxes, cells, self.room)
        given = Disturbances(epsilon, self.disturbance, self.start)
        return levels_of(own.feedback, choice, deviation_of(own, states, epsilon), given, cells, self.room)
