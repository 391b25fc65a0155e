"""Tracking with a σ that is only computed to ε: a bound of the tracking error, proved (the paper's open problem).

**Theorem.** Let u be computed torque's or PD+'s (`ccpin.control.tracking`), its terms taken at σ(q) ⊕ δ(t), δ any
measurable function of time in the dependent coordinates with ‖δ(t)‖₂ ≤ ε (rad, m), and let the motors sit on the
independent joints. Let the plant be the reduced model (22) with a further generalized force f(t), |f_i| ≤ f̄_i (friction
that is not compensated, say). Cut time into cells T_k, the last one [T, ∞) after the reference has come to rest, and
let for each there be E, Ė > 0 (vectors) with, on all states |e| ≤ E, |ė| ≤ Ė of T_k (`tube`),

1. σ proved, and carried on to the cells beside it; D nonsingular; φ_y nonsingular at σ(q) ⊕ δ;
2. |L⁻¹Δ| ≤ Δ_k, Δ the deviation (`deviation`);
3. P ⪰ P_k ≻ 0 and V̇ ≤ −α(V − w_k), w_k = g_k²Δ_k², V = xᵀPx (`storage`), α > 0 one number.

Let v(0) ≥ V(x(0)) and v̇ = −α(v − w_k) on T_k. If on each T_k, for all i,

    v(t) < c_k,        c_k = min_i (E_i²/(P_k⁻¹)_ii, Ė_i²/(P_k⁻¹)_{n+i,n+i}),

then every motion of the closed loop goes on for all t ≥ 0, with V ≤ v, its configuration is σ(q) on the branch of the
start, and |e_i(t)| ≤ ((P_k⁻¹)_ii v(t))^½. In input-to-state form, with γ = max_k w_k^½/ε where f̄ = 0,

    V(t)^½ ≤ e^{−αt/2} V(0)^½ + γ ε,        and for t → ∞        V ≤ w_K.

*Proof.* On T_k the sublevel set {V ≤ c_k} of errors lies in {|e| ≤ E, |ė| ≤ Ė}, for |x_i|² ≤ (P_k⁻¹)_ii xᵀP_k x ≤
(P_k⁻¹)_ii V. Suppose V ≤ v up to t ∈ T_k. As V and v are continuous and v(t) < c_k, V is below c_k for some time
after t (within T_k, or within T_{k+1} if t is its beginning), so that 1–3 hold and d(V − v)/dt ≤ −α(V − v): V ≤ v goes
on holding. The set of times up to which V ≤ v holds is closed, open and not empty. The states stay in a compact set on
which the right-hand side is bounded, so the motion does not end; and v(t) ≤ e^{−αt}v(0) + max w_k. ∎

δ may depend on the state, the past, on chance; nothing is supposed of how it comes about. What is not covered: that
u is held between samples (the loop sampled at 1 kHz has an error of its own, which `scripts/tracking_degradation.py`
shows), errors of e and ė themselves, limits of the motors. What a σ found on line needs so as to be within ε at the
samples, `TrackingCertificate.on_line` tells.

What is rigorous: every number of 1–3 is a bound, from affine forms with rounding margins over boxes of Theorem K.
Gains, masses and the reference's coefficients are taken as the floating-point numbers they are.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Mask, instance, numbers, positive, whole
from ccpin.control.stability.deviation import Deviation, deviation_of
from ccpin.control.stability.on_line import OnlineDemand, online_demand
from ccpin.control.stability.storage import Plan, gain, plan_for, storage_of, widths
from ccpin.control.stability.tube import Tube, tube_of
from ccpin.control.tracking import ComputedTorque, PDPlus, TrackingLaw
from ccpin.domain.boxes import SLACK
from ccpin.domain.verdict import Verdict
from ccpin.errors import InvalidInputError, UnsupportedMechanismError

_ROUNDS = 10
_FIRST, _MORE = 2.2, 1.3
_ROOM = 1.0 + 1e-6
_PLANNED = 48
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
        initial_error: A bound of |e| at t = 0, a number or (n,).
        initial_speed: A bound of |ė| at t = 0, alike.
        cells: Into how many cells the reference's duration is cut; twice as many come nearer to the best bound of this
            kind and take twice the time.

    Raises:
        InvalidInputError: ε is not positive, or a bound is negative or not finite.
        UnsupportedMechanismError: Another law, coordinates or joints that are not scalar, motors elsewhere than on the
            independent joints, a reference that is no piecewise polynomial, closures that cannot be certified.
        SingularConfigurationError: The start is singular, or too near.
    """
    _check(law)
    sigma_error, cells = positive(sigma_error, "sigma_error", "a positive number (rad, m)"), whole(cells, "cells")
    push, start = _given(law, disturbance, initial_error, initial_speed)
    return _Search(law, tube_of(law, cells), sigma_error, push, start).certificate()


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
        found = _Search(law, tube, trial, push, start).certificate()
        if found.verdict == "proven":
            low, best = trial, found
        else:
            high, best = trial, best or found
        trial = low * _STRIDE if np.isinf(high) else high / _STRIDE if low == 0.0 else float(np.sqrt(low * high))
    assert best is not None
    return best


class _Levels(NamedTuple):
    """What one choice of E and Ė gives.

    Attributes:
        reached: The largest v on each cell, of shape (K,).
        allowed: c_k, of shape (K,).
        widths: (P_k⁻¹)_ii^½, of shape (K, 2n).
        sources: w_k, of shape (K,).
        start: v(0).
    """

    reached: Array
    allowed: Array
    widths: Array
    sources: Array
    start: float


class _Search:
    """Looks for E and Ė with which the theorem's hypotheses hold."""

    def __init__(self, law: TrackingLaw, tube: Tube, sigma_error: float, push: Array, start: Array) -> None:
        self.law, self.tube, self.sigma_error, self.push, self.start = law, tube, sigma_error, push, start
        self.plan: Plan | None = None
        self.rounds = 0

    def certificate(self) -> TrackingCertificate:
        """The certificate, after as many rounds as it takes."""
        if self.tube.path.verdict != "proven":
            return self._undecided(f"the reference itself leaves what is proved: {self.tube.path.reason}")
        count, n = self.tube.motion[0].start.shape
        none = np.zeros((count, n))
        states, proved = self.tube.states(none, none)
        if not proved.all():
            return self._undecided(self._stopped("σ is not proved", ~proved, np.zeros((count, 2 * n))))
        middle = deviation_of(self.law, self.tube, states.middles(), self.sigma_error * 0.0)
        self.plan = self._planned(middle)
        if self.plan is None:
            return self._undecided("no storage function was found along the reference: stiffer gains would do more")
        levels = self._levels(middle)
        room = np.sqrt(levels.reached)[:, None] * levels.widths * _FIRST
        for self.rounds in range(1, _ROUNDS + 1):
            states, proved = self.tube.states(room[:, :n], room[:, n:])
            if not proved.all():
                return self._undecided(self._stopped("σ is not proved", ~proved, room))
            levels = self._levels(deviation_of(self.law, self.tube, states, self.sigma_error), room)
            reason = self._open(levels, room)
            if reason is not None:
                return self._undecided(reason)
            if np.all(levels.reached * _ROOM < levels.allowed):
                return self._proven(levels, room)
            room = np.maximum(room, np.sqrt(levels.reached)[:, None] * levels.widths) * _MORE
        return self._undecided(
            f"after {_ROUNDS} rounds the bound still grows, for a σ off by {self.sigma_error:.3g} lets the law deviate "
            "the more, the larger the error: a smaller sigma_error, more cells= or stiffer gains would do more"
        )

    def _planned(self, middle: Deviation) -> Plan | None:
        rows = slice(None, None, 1 + len(middle.push) // _PLANNED)
        raw = np.linalg.norm(middle.slope.mid, axis=2) * self.sigma_error + middle.push @ self.push
        scale = raw.max(axis=0)
        scale = np.where(scale > 0.0, scale, max(float(scale.max()), 1e-300))
        return plan_for(self.law, scale, middle.D.mid[rows], middle.C.mid[rows], middle.damping.mid[rows])

    def _levels(self, deviation: Deviation, room: Array | None = None) -> _Levels:
        """v and c_k where the states of each cell are within `room`, (K, 2n)."""
        assert self.plan is not None
        storage = storage_of(self.law, self.plan, deviation.D, deviation.C, deviation.damping)
        size = deviation.size(self.sigma_error, self.push, self.plan.scale)
        with np.errstate(all="ignore"):
            sources = (gain(storage, self.plan) * size) ** 2 * SLACK
            width = np.broadcast_to(widths(storage), (len(size), 2 * len(self.push)))
            start = float(self.start @ storage.P.magnitude[0] @ self.start) * SLACK
            allowed = np.full(len(size), np.inf) if room is None else np.min((room / width) ** 2, axis=1)
            reached = _reached(start, sources, self.plan.decay, np.diff(self.tube.times))
        return _Levels(reached, allowed, width, sources, start)

    def _open(self, levels: _Levels, room: Array) -> str | None:
        """Why no level is known, if one is not."""
        sources = levels.sources
        checks = (
            (~np.isfinite(levels.widths).all(axis=1), "D is not proved positive definite"),
            (np.isinf(sources), "V̇ is not proved negative"),
            (np.isnan(sources), f"φ_y is not proved nonsingular within {self.sigma_error:.3g} of σ"),
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

    def _proven(self, levels: _Levels, room: Array) -> TrackingCertificate:
        assert self.plan is not None
        n = len(self.push)
        bound = np.sqrt(levels.reached)[:, None] * levels.widths * SLACK
        ultimate = np.sqrt(levels.sources[-1]) * levels.widths[-1, :n] * SLACK
        worst = np.degrees(bound[:, :n].max())
        return self._result(
            "proven",
            f"|q_d − q| stays below {bound[:, :n].max():.3g} ({worst:.3g}°, where angles) with σ off by at most "
            f"{self.sigma_error:.3g}: {len(bound)} cells, {self.rounds} rounds",
            (bound[:, :n], bound[:, n:], ultimate),
            (self.plan.decay, float(np.sqrt(levels.sources.max()) / self.sigma_error), levels.start),
            levels.widths.max(axis=0),
            room,
        )

    def _undecided(self, reason: str) -> TrackingCertificate:
        count, n = self.tube.motion[0].start.shape
        open_end, unit = np.full((count, n), np.inf), np.full(2 * n, np.inf)
        bounds, constants = (open_end, open_end, open_end[0]), (0.0, np.inf, np.inf)
        return self._result("undecided", reason, bounds, constants, unit, np.zeros((count, 2 * n)))

    def _result(
        self,
        verdict: Verdict,
        reason: str,
        bounds: tuple[Array, Array, Array],
        constants: tuple[float, float, float],
        unit: Array,
        room: Array,
    ) -> TrackingCertificate:
        errors, speeds, ultimate = bounds
        decay, largest, start = constants
        return TrackingCertificate(
            law=self.law,
            sigma_error=self.sigma_error,
            disturbance=self.push,
            verdict=verdict,
            reason=reason,
            times=np.append(self.tube.times[:-1], np.inf),
            errors=errors,
            speeds=speeds,
            ultimate=ultimate,
            decay=decay,
            gain=largest,
            unit=unit,
            start=start,
            _tube=self.tube,
            _room=room,
        )


def _reached(start: float, sources: Array, decay: float, durations: Array) -> Array:
    """The largest v of each cell, v̇ = −α(v − w_k) from v(0), the last cell without end."""
    reached, v = np.empty(len(sources)), start
    for k, source in enumerate(sources):
        after = source + (v - source) * np.exp(-decay * durations[k]) if k + 1 < len(sources) else source
        reached[k] = max(v, after) * SLACK
        v = after * SLACK
    return reached


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
