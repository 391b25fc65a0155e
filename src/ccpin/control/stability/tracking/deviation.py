"""How far a law's efforts are off where it computes them at σ(q) + δ: bounds of the deviation over a tube's cells.

The deviation Δ = D⁻¹(Gδ + f) or Gδ + f of `ccpin/proof/theorems/tracking.md` (`motion_bounds` has τ and its
slopes): as an affine form of δ, G is the slope with half of δ's part.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import CellForms
from ccpin.control.stability.tracking.motion_bounds import Reduced
from ccpin.control.stability.tracking.tracking_equations import TrackingEquations
from ccpin.proof.balls import Affine, affine, inverse, joined
from ccpin.proof.rounding import SLACK

_NUMBERS = 4e6  # in the largest array of one chunk


class Deviation(NamedTuple):
    """What bounds Δ over K cells; NaN where the law's φ_y, or D, may be singular.

    Attributes:
        slope: Δ = slope · δ + …, of shape (K, n, m).
        push: |…| for a disturbance of one in each force, of shape (K, n, n).
        D, C, damping: At σ(q) and q̇, of shape (K, n, n).
    """

    slope: Affine
    push: Array
    D: Affine
    C: Affine
    damping: Affine

    def size(self, sigma_error: float, disturbance: Array, scale: Array) -> Array:
        """Theorem T's Δ_k (its 2), of shape (K,): |L⁻¹Δ| at most, ‖δ‖₂ ≤ `sigma_error` and |f| ≤ `disturbance` (n,)."""
        scaled = self.slope * (1.0 / scale)[:, None]
        stretch = np.full(len(self.push), np.nan)
        usable = np.isfinite(scaled.magnitude).all(axis=(1, 2))
        lengths = np.linalg.norm(scaled.lin[:, usable], ord=2, axis=(2, 3))
        stretch[usable] = np.linalg.norm(scaled.mid[usable], ord=2, axis=(1, 2))
        stretch[usable] += lengths[: scaled.boxed].sum(axis=0)
        stretch[usable] += 0.5 * np.linalg.norm(lengths[scaled.boxed :], axis=0)
        stretch += np.linalg.norm(scaled.rad, axis=(1, 2))
        return np.asarray((sigma_error * stretch + np.linalg.norm(self.push @ disturbance / scale, axis=1)) * SLACK)


def deviation_of(equations: TrackingEquations, states: CellForms, sigma_error: float) -> Deviation:
    """The deviation over cells, chunk by chunk."""
    largest = max((stack.joints.size * stack.joints.shape[1] for stack in equations.masses.loops), default=1)
    numbers = 18 * largest * (1 + len(states.theta.lin) + equations.closures.system.m)
    step = max(1, int(_NUMBERS // max(1, numbers)))
    count = len(states.theta.mid)
    parts = [_part(equations, states.chunk(slice(k, k + step)), sigma_error) for k in range(0, count, step)]
    slope = joined([part.slope for part in parts], -3)
    D, C, damping = (joined(forms, -3) for forms in zip(*((p.D, p.C, p.damping) for p in parts), strict=True))
    return Deviation(slope, np.concatenate([part.push for part in parts]), D, C, damping)


def _part(equations: TrackingEquations, states: CellForms, sigma_error: float) -> Deviation:
    system, masses, error = equations.closures.system, equations.masses, equations.error
    closed, around = Reduced(system, masses, states.theta), states.thickened(system, sigma_error)
    slope = Reduced(system, masses, around.theta).force_slope(error.motion(equations.feedback, around))
    count, n = states.e.mid.shape
    unit = np.broadcast_to(np.eye(n), (count, n, n))
    if not error.by_mass:
        return Deviation(slope, unit, closed.inertia, closed.coriolis(states.v), closed.damping)
    grip = inverse(closed.inertia)
    push = grip.solve(affine(unit)).magnitude
    return Deviation(grip.solve(slope), push, closed.inertia, closed.coriolis(states.v), closed.damping)
