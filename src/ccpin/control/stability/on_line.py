"""What a σ found on line needs, so that it is within ε of the exact one at every sample: Newton steps, or a residual.

At a sample the last one's y is off by at most e₀ = ε + period · sup‖dy/dt‖₂, as long as the motion is within its
bounds. Let φ_y be nonsingular wherever ‖y − σ(q)‖₂ ≤ e₀, and L ≥ ‖φ_y(y)⁻¹φ_yy(z)‖ for all such y and z. A Newton step
(in exact arithmetic) leaves

    y₁ − σ = φ_y(y)⁻¹ ∫₀¹ (φ_y(y) − φ_y(σ + h(y − σ))) dh (y − σ),        ‖y₁ − σ‖ ≤ ½L‖y − σ‖²,

so the errors fall below ε after finitely many steps if ½Le₀ < 1, and never leave the ball. And for a y in the ball
y − σ = M⁻¹φ(q, y) with M a mean of φ_y over a segment in it, so |φ| ≤ tolerance makes ‖y − σ‖₂ ≤ ε.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.deviation import thickened
from ccpin.control.stability.tube import States, Tube
from ccpin.domain.motion_bounds import Reduced
from ccpin.errors import ConvergenceError
from ccpin.proof.balls import Affine, affine, product
from ccpin.proof.rounding import SLACK

_TOGETHER = 8
_MOST = 60


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


def online_demand(tube: Tube, states: States, sigma_error: float, period: float) -> OnlineDemand:
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


def _speed(tube: Tube, states: States) -> float:
    """The largest ‖dy/dt‖₂, y the dependent coordinates."""
    rho = Reduced(tube.problem, tube.masses, states.theta).rho
    rates = product("bpn,bn->bp", rho, states.v).magnitude[:, tube.problem.system.dependent]
    return float(np.linalg.norm(rates, axis=1).max() * SLACK)


def _newton(tube: Tube, states: States, radius: float) -> tuple[float, float]:
    """L, and the largest ‖M⁻¹r‖₂ for |r| ≤ 1; infinite where φ_y may be singular."""
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
