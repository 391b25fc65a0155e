"""Tracking with a σ that is only computed to ε: a bound of the tracking error, proved (the paper's open problem).

Theorem T of `ccpin/proof/theorems/tracking.md`, which also says what is not covered. Its hypotheses are looked at in

- `_check`: which laws and motors it is about;
- 1: `ReferenceTube.states`, and `Reduced.grip` and `inverse` on the way of a deviation;
- 2: `Deviation.size`; 3: `storage_of`, `gain` and `widths`; 4 and 5: `TubeSearch.found`.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, numbers, positive, whole
from ccpin.control.stability.tracking.error_equations import equation_of
from ccpin.control.stability.tracking.on_line import OnlineDemand, online_demand
from ccpin.control.stability.tracking.reference_tube import ReferenceTube, tube_of
from ccpin.control.stability.tracking.tube_search import TubeSearch
from ccpin.control.tracking import TrackingLaw
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.assumptions import limits_left_out, without_dry_friction
from ccpin.proof.verdict import Judged, Verdict

_LEAST = 1e-9  # ε, the smallest tried
_MIDDLE = 1e-3  # ε, the one tried first
_STRIDE = 4.0  # from one ε to the next, until one is proved and one is not
_NEAR = 1.1  # of the largest ε proved: one not proved that ends the search


@dataclass(frozen=True, eq=False, repr=False)
class TrackingCertificate(Judged):
    """What is proved of a law that follows its reference with a σ that is off by at most ε.

    Attributes:
        law: The law.
        sigma_error: ε.
        disturbance: f̄, of shape (n,).
        verdict: ``"proven"``, or ``"undecided"`` where the bounds do not close.
        reason: The verdict in a sentence.
        times: The cells' ends, s, of shape (K + 1,); the last is infinite.
        errors: A bound of |e| over each cell, of shape (K, n); infinite where nothing is proved.
        speeds: A bound of |ė|, alike.
        ultimate: A bound of |e| as t → ∞, of shape (n,).
        decay: α, 1/s.
        gain: γ, by which ε (1 rad or m) enters V^½, where there is no disturbance.
        unit: |x_i| ≤ unit_i V^½ anywhere, x = (e, ė), of shape (2n,).
        start: The bound of V at t = 0.
    """

    law: TrackingLaw
    sigma_error: float
    disturbance: Array
    verdict: Verdict
    reason: str
    times: Array
    errors: Array
    speeds: Array
    ultimate: Array
    decay: float
    gain: float
    unit: Array
    start: float
    _tube: ReferenceTube = field(repr=False)
    _room: Array = field(repr=False)

    @property
    def assumes(self) -> tuple[str, ...]:
        """The limits that the mechanism states and the theorem takes not to be met."""
        return limits_left_out(self.law.model.mechanism)

    @property
    def error(self) -> Array:
        """A bound of |e_i(t)| for all t ≥ 0, of shape (n,); infinite where nothing is proved."""
        return np.asarray(self.errors.max(axis=0))

    def on_line(self, period: float) -> OnlineDemand:
        """The Newton steps, or the residual, that keep σ within ε at every sample of a loop of that period.

        It holds as long as the motion keeps to the certificate's bounds, which sampling itself may break.

        Args:
            period: s.

        Raises:
            InvalidInputError: Nothing is proved, or the period is not positive.
            ConvergenceError: Newton's convergence from one sample to the next is not guaranteed.
        """
        period = positive(period, "period", "a positive number of seconds")
        if self.verdict != "proven":
            raise InvalidInputError(f"there is no proved motion to sample: {self.reason}")
        n = len(self.disturbance)
        states, _ = self._tube.states(self._room[:, :n], self._room[:, n:])
        return online_demand(self._tube, states, self.sigma_error, period)


def certify_tracking(
    law: TrackingLaw,
    sigma_error: float,
    *,
    disturbance: ArrayLike = 0.0,
    initial_error: ArrayLike = 0.0,
    initial_speed: ArrayLike = 0.0,
    cells: int = 128,
) -> TrackingCertificate:
    """Bound the tracking error of computed torque or PD+ with σ off by at most ε.

    Args:
        law: Computed torque or PD+ along a piecewise polynomial reference.
        sigma_error: ε: the largest ‖δ‖₂ of the dependent coordinates' error, rad and m.
        disturbance: f̄: how large a generalized force may be that the model does not have, N m or N: a number or (n,).
            Dry friction that the mechanism states is one (ρᵀ times the joints' levels): it is not added here.
        initial_error: A bound of |e| at t = 0, a number or (n,).
        initial_speed: A bound of |ė| at t = 0, alike. A reference that begins with a speed at t = 0 jumps to it from
            rest: what is proved holds for ė measured before the jump, and for ė measured after it.
        cells: Into how many cells the reference's duration is cut; twice as many come nearer to the best bound of this
            kind and take twice the time.

    Raises:
        InvalidInputError: ε is not positive, a bound is negative or not finite, or the reference's polynomials begin
            before t = 0, jump by more than 1e-9 in q_d, or are not the motion that its `at` tells.
        UnsupportedMechanismError: Another law, coordinates or joints that are not scalar, motors elsewhere than on the
            independent joints, a reference that is no piecewise polynomial, closures that cannot be certified.
        SingularConfigurationError: The start is singular, or too near.
    """
    _check(law)
    sigma_error, cells = positive(sigma_error, "sigma_error", "a positive number (rad, m)"), whole(cells, "cells")
    push, start = _given(law, disturbance, initial_error, initial_speed)
    return _certificate(law, tube_of(law, cells), sigma_error, push, start)


def largest_sigma_error(
    law: TrackingLaw,
    *,
    disturbance: ArrayLike = 0.0,
    initial_error: ArrayLike = 0.0,
    initial_speed: ArrayLike = 0.0,
    cells: int = 128,
) -> TrackingCertificate:
    """The certificate of the largest ε that is proved, to a tenth of it, between 1e-9 and 1.

    Args and errors as for `certify_tracking`. Where none is proved, the undecided certificate of the smallest tried.
    """
    _check(law)
    push, start = _given(law, disturbance, initial_error, initial_speed)
    tube = tube_of(law, whole(cells, "cells"))
    low, high, best = 0.0, np.inf, None
    trial = _MIDDLE
    while high > _NEAR * low and _LEAST <= trial <= 1.0:
        found = _certificate(law, tube, trial, push, start)
        if found.verdict == "proven":
            low, best = trial, found
        else:
            high, best = trial, best or found
        trial = low * _STRIDE if np.isinf(high) else high / _STRIDE if low == 0.0 else float(np.sqrt(low * high))
    assert best is not None
    return best


def _certificate(
    law: TrackingLaw, tube: ReferenceTube, sigma_error: float, push: Array, start: Array
) -> TrackingCertificate:
    found, n = TubeSearch(law, tube, sigma_error, push, start).found(), len(push)
    return TrackingCertificate(
        law=law,
        sigma_error=sigma_error,
        disturbance=push,
        verdict=found.verdict,
        reason=found.reason + without_dry_friction(law.model.mechanism),
        times=np.append(tube.times[:-1], np.inf),
        errors=found.bound[:, :n],
        speeds=found.bound[:, n:],
        ultimate=found.ultimate,
        decay=found.decay,
        gain=found.gain,
        unit=found.unit,
        start=found.start,
        _tube=tube,
        _room=found.room,
    )


def _given(law: TrackingLaw, push: ArrayLike, error: ArrayLike, speed: ArrayLike) -> tuple[Array, Array]:
    """f̄ (n,) and the bounds of (e, ė) at the start (2n,)."""
    given = {"disturbance": push, "initial_error": error, "initial_speed": speed}
    bounds = [_bound(value, name, law.model.n) for name, value in given.items()]
    return bounds[0], np.concatenate(bounds[1:])


def _bound(value: ArrayLike, name: str, n: int) -> Array:
    array = numbers(value, name)
    if array.shape not in ((), (n,)) or not np.all(np.isfinite(array) & (array >= 0.0)):
        raise InvalidInputError(f"{name} must be a nonnegative number or {n} of them; it is {value!r}")
    return np.broadcast_to(array, (n,)).copy()


def _check(law: TrackingLaw) -> None:
    """That the theorem is about this law and mechanism."""
    instance(law, "law", TrackingLaw)
    mechanism, coordinates = law.model.mechanism, law.model.coordinates
    equation_of(law)
    if law.model.actuation is not None:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: the motors sit elsewhere than on the independent joints, so an error of σ changes what "
            "they exert too; load it with independent= set to the motors"
        )
    if not (coordinates.scalar and coordinates.constant):
        raise UnsupportedMechanismError(
            f"{mechanism.name}: tracking is certified for revolute and prismatic independent joints only"
        )
