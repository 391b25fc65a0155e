"""Tracking with a σ that is only computed to ε: a bound of the tracking error, proved (the paper's open problem).

**Theorem.** Let u be computed torque's or PD+'s (`ccpin.control.tracking`), its terms taken at σ(q) ⊕ δ(t), δ any
measurable function of time in the dependent coordinates with ‖δ(t)‖₂ ≤ ε (rad, m), and let the motors sit on the
independent joints. Let q_d be piecewise C², at rest before its first break and after its last, and let (q_d, q̇_d) jump
by |κ_k| ≤ κ̄_k at the beginning t_k of T_k (`tube` bounds it from the polynomials). Let the plant be the reduced model
(22) with a further generalized force f(t), |f_i| ≤ f̄_i (friction that is not compensated, say). Cut time into cells
T_k, the last one [T, ∞) after the reference has come to rest, and let for each there be E, Ė > 0 (vectors) with, on all
states |e| ≤ E, |ė| ≤ Ė of T_k (`tube`),

1. σ proved, and carried on to the cells beside it; D nonsingular; φ_y nonsingular at σ(q) ⊕ δ;
2. |L⁻¹Δ| ≤ Δ_k, Δ the deviation (`deviation`);
3. P ⪰ P_k ≻ 0 and V̇ ≤ −α(V − w_k), w_k = g_k²Δ_k², V = xᵀPx (`storage`), α > 0 one number.

Let v(0) ≥ V(x(0)), v̇ = −α(v − w_k) on T_k, and v(t_k⁺)^½ = v(t_k⁻)^½ + J_k, J_k ≥ (κᵀPκ)^½ for all |κ| ≤ κ̄_k and all P
of T_k. If on each T_k, for all i,

    v(t) < c_k,        c_k = min_i (E_i²/(P_k⁻¹)_ii, Ė_i²/(P_k⁻¹)_{n+i,n+i}),

and at each t_k, k > 0, for all i, with X = (E, Ė),

    ((P_{k−1}⁻¹)_ii v(t_k⁻))^½ + κ̄_{k,i} < X_{k,i},

then every motion of the closed loop goes on for all t ≥ 0, with V ≤ v, its configuration is σ(q) on the branch of the
start, and |e_i(t)| ≤ ((P_k⁻¹)_ii v(t))^½. In input-to-state form, with γ = max_k w_k^½/ε where f̄ = 0,

    V(t)^½ ≤ e^{−αt/2} V(0)^½ + Σ_{t_k ≤ t} e^{−α(t − t_k)/2} J_k + γ ε,        and for t → ∞        V ≤ w_K.

*Proof.* In {|e| ≤ E, |ė| ≤ Ė} of T_k, |x_i|² ≤ (P_k⁻¹)_ii xᵀP_k x ≤ (P_k⁻¹)_ii V: a state of this box with V < c_k is
in its interior. Suppose the state is in it and V ≤ v up to t, inside T_k. As x, V and v are continuous and v(t) < c_k,
the state stays in the box for some time, so that 1–3 hold and d(V − v)/dt ≤ −α(V − v): V ≤ v goes on holding. At t_k
the configuration and q̇ do not jump, so that x does by κ, and by the P of T_{k−1} each |x_i| is below X_{k,i}
afterwards: the state is in T_k's box (P depends on the state, so v < c_k alone would not tell), P is one of T_k's, and
V(t_k⁺)^½ ≤ V(t_k⁻)^½ + (κᵀPκ)^½ ≤ v(t_k⁺)^½. The set of times up to which all this holds is closed, open and not empty.
The states stay in a compact set on which the right-hand side is bounded, so the motion does not end; and v(t) ≤
e^{−αt}v(0) + max w_k. ∎

δ may depend on the state, the past, on chance; nothing is supposed of how it comes about. What is not covered: that
u is held between samples (the loop sampled at 1 kHz has an error of its own, which `scripts/tracking_degradation.py`
shows), errors of e and ė themselves, limits of motors and joints. What a σ found on line needs so as to be within ε at
the samples, `TrackingCertificate.on_line` tells.

What is rigorous: every number of 1–3 is a bound, from affine forms with rounding margins over boxes of Theorem N.
Gains, masses and the reference's coefficients are taken as the floating-point numbers they are.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, numbers, positive, whole
from ccpin.control.stability.on_line import OnlineDemand, online_demand
from ccpin.control.stability.tracking_search import Search
from ccpin.control.stability.tube import Tube, tube_of
from ccpin.control.tracking import ComputedTorque, PDPlus, TrackingLaw
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.left_out import limits_left_out, without_dry_friction
from ccpin.proof.verdict import Verdict

_LEAST, _MIDDLE, _STRIDE, _NEAR = 1e-9, 1e-3, 4.0, 1.1


@dataclass(frozen=True, eq=False)
class TrackingCertificate:
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
    _tube: Tube = field(repr=False)
    _room: Array = field(repr=False)

    def __repr__(self) -> str:
        return f"TrackingCertificate({self.verdict}: {self.reason})"

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


def _certificate(law: TrackingLaw, tube: Tube, sigma_error: float, push: Array, start: Array) -> TrackingCertificate:
    found, n = Search(law, tube, sigma_error, push, start).found(), len(push)
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
    if not isinstance(law, ComputedTorque | PDPlus):
        raise UnsupportedMechanismError(
            f"a {type(law).__name__} does not cancel what it tracks against, so its error is no matter of σ alone: "
            "certify a ComputedTorque or PDPlus law"
        )
    if law.model.actuation is not None:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: the motors sit elsewhere than on the independent joints, so an error of σ changes what "
            "they exert too; load it with independent= set to the motors"
        )
    if not (coordinates.scalar and coordinates.constant):
        raise UnsupportedMechanismError(
            f"{mechanism.name}: tracking is certified for revolute and prismatic independent joints only"
        )
