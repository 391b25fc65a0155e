"""What a σ found on line needs, so that it is within ε of the exact one at every sample: Newton steps, or a residual.

Lemma O of `ccpin/proof/theorems/online.md`, whose names e₀ and L are used here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.deviation import thickened
from ccpin.control.stability.tracking.motion_bounds import Reduced
from ccpin.control.stability.tracking.reference_tube import CellForms, ReferenceTube
from ccpin.errors import ConvergenceError
from ccpin.proof.balls import Affine, affine, product
from ccpin.proof.rounding import SLACK

_TOGETHER = 8  # cells at a time: bounds memory
_MOST = 60  # Newton steps a sample; a σ that needs more is refused


class OnlineDemand(NamedTuple):
    """What keeps σ within ε at every sample (`ccpin.control.OnlineSigma`).

    Attributes:
        start: e₀: how far off the last sample's σ is at most, rad and m.
        steps: Newton steps a sample that suffice, in exact arithmetic.
        tolerance: The residual |ψ̄| (m, rad) that suffices.
    """

    start: float
    steps: int
    tolerance: float


def online_demand(tube: ReferenceTube, states: CellForms, sigma_error: float, period: float) -> OnlineDemand:
    """The demand of a sampled loop whose motion stays in the given cells.

    Raises:
        ConvergenceError: Newton's convergence from one sample to the next is not guaranteed at that period.
    """
    chunks = [states.chunk(slice(k, k + _TOGETHER)) for k in range(0, len(states.e.mid), _TOGETHER)]
    start = sigma_error + period * max(_speed(tube, chunk) for chunk in chunks)
    slopes, stretches = zip(*(_newton(tube, chunk, start) for chunk in chunks), strict=True)
    slope, stretch = max(slopes), max(stretches)
    error, steps = start, 0
    while error > sigma_error and steps < _MOST and 0.5 * slope * start < 1.0:
        error, steps = 0.5 * slope * error**2 * SLACK, steps + 1
    if not error <= sigma_error:
        raise ConvergenceError(
            f"at a period of {period:.3g} s σ moves by up to {start:.3g} from one sample to the next, from where "
            "Newton's convergence is not guaranteed: a shorter period or a slower reference would do"
        )
    return OnlineDemand(start, steps, sigma_error / stretch)


def _speed(tube: ReferenceTube, states: CellForms) -> float:
    """The largest ‖dy/dt‖₂, y the dependent coordinates."""
    rho = Reduced(tube.problem, tube.masses, states.theta).rho
    rates = product("bpn,bn->bp", rho, states.v).magnitude[:, tube.problem.system.dependent]
    return float(np.linalg.norm(rates, axis=1).max() * SLACK)


def _newton(tube: ReferenceTube, states: CellForms, radius: float) -> tuple[float, float]:
    """The lemma's L, and the largest ‖M⁻¹r‖₂ for |r| ≤ 1 (its 2); infinite where φ_y may be singular."""
    at = Reduced(tube.problem, tube.masses, thickened(tube, states, radius).theta)
    m, dependent = tube.problem.system.m, tube.problem.system.dependent
    bend = at.bend[:, :, dependent][:, :, :, dependent]
    count = len(bend.mid)
    apart = Affine(bend.mid, bend.lin[:0], bend.spread).reshape(count, m, m * m)  # z is not y
    curved = _norms(at.grip.solve(apart))
    unit = np.broadcast_to(np.eye(m), (count, m, m))
    inverse = at.grip.solve(affine(unit)).magnitude
    stretch = np.linalg.norm(inverse.sum(axis=2), axis=1) * SLACK
    return _worst(curved), _worst(stretch)


def _norms(form: Affine) -> Array:
    """Frobenius norms, of shape (B,)."""
    return np.asarray(np.linalg.norm(form.magnitude, axis=(1, 2)) * SLACK)


def _worst(values: Array) -> float:
    """The largest of them; infinite where one is not known."""
    return float(np.nan_to_num(values, nan=np.inf).max())
