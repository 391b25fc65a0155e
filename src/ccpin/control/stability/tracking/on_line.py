"""What a σ found on line needs, so that it is within ε of the exact one at every sample: Newton steps, or a residual.

Lemma O of `ccpin/proof/theorems/online.md`, whose names e₀ and L are used here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.cell_forms import CellForms
from ccpin.control.stability.tracking.motion_bounds import Reduced
from ccpin.control.stability.tracking.tracking_equations import TrackingEquations
from ccpin.control.stability.tracking.tube_claim import TubeKept
from ccpin.proof.balls import Affine, affine, product
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
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


@provable
@dataclass(frozen=True, eq=False)
class SigmaKept(ProvableClaim):
    """In a loop of that period whose motion keeps to a tube, σ found on line is within the tube's ε at every sample.

    Premise: the fact about the tube. Found: `start`, `steps` and `tolerance` (1,) of `OnlineDemand`.

    Attributes:
        period: s, of shape (1,).
    """

    equations: TrackingEquations
    period: Annotated[Array, Form("1", above=0.0)]
    theorem = "online"

    def examined(self, *premises: Fact) -> Examined:
        """Lemma O over the tube's cells."""
        require(len(premises) == 1 and type(premises[0].claim) is TubeKept, "one tube is needed")
        kept: TubeKept = premises[0].claim
        found = online_demand(
            self.equations, kept.states(premises[0].premises[1]), float(kept.sigma_error[0]), float(self.period[0])
        )
        numbers = (np.array([found.start]), np.array([found.steps], dtype=np.int64), np.array([found.tolerance]))
        return Examined(np.ones(1, dtype=np.bool_), dict(zip(OnlineDemand._fields, numbers, strict=True)))


def online_demand(equations: TrackingEquations, states: CellForms, sigma_error: float, period: float) -> OnlineDemand:
    """The demand of a sampled loop whose motion stays in the given cells.

    Raises:
        NotProvedError: Newton's convergence from one sample to the next is not guaranteed at that period.
    """
    chunks = [states.chunk(slice(k, k + _TOGETHER)) for k in range(0, len(states.e.mid), _TOGETHER)]
    start = sigma_error + period * max(_speed(equations, chunk) for chunk in chunks)
    slopes, stretches = zip(*(_newton(equations, chunk, start) for chunk in chunks), strict=True)
    slope, stretch = max(slopes), max(stretches)
    error, steps = start, 0
    while error > sigma_error and steps < _MOST and 0.5 * slope * start < 1.0:
        error, steps = 0.5 * slope * error**2 * SLACK, steps + 1
    require(
        error <= sigma_error,
        f"at a period of {period:.3g} s σ moves by up to {start:.3g} from one sample to the next, from where "
        "Newton's convergence is not guaranteed: a shorter period or a slower reference would do",
    )
    return OnlineDemand(start, steps, sigma_error / stretch)


def _speed(equations: TrackingEquations, states: CellForms) -> float:
    """The largest ‖dy/dt‖₂, y the dependent coordinates."""
    rho = Reduced(equations.closures.system, equations.masses, states.theta).rho
    rates = product("bpn,bn->bp", rho, states.v).magnitude[:, equations.closures.system.dependent]
    return float(np.linalg.norm(rates, axis=1).max() * SLACK)


def _newton(equations: TrackingEquations, states: CellForms, radius: float) -> tuple[float, float]:
    """The lemma's L, and the largest ‖M⁻¹r‖₂ for |r| ≤ 1 (its 2); infinite where φ_y may be singular."""
    system = equations.closures.system
    at = Reduced(system, equations.masses, states.thickened(system, radius).theta)
    m, dependent = system.m, system.dependent
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
