"""Tracking with a σ that is only computed to ε: a bound of the tracking error, proved (the paper's open problem).

Theorem T of `ccpin/proof/theorems/tracking.md`, which also says what is not covered. `_check` looks at which laws and
motors it is about, `TubeSearch` looks for a tube, and `TubeKept` proves it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, numbers, positive, whole
from ccpin.control.stability.tracking.on_line import OnlineDemand, SigmaKept
from ccpin.control.stability.tracking.reference_tube import ReferenceTube, equations_of, feedback_of, tube_of
from ccpin.control.stability.tracking.tube_certificate import TubeCertificate
from ccpin.control.stability.tracking.tube_claim import TubeKept
from ccpin.control.stability.tracking.tube_levels import Disturbances
from ccpin.control.stability.tracking.tube_search import TubeSearch
from ccpin.control.tracking import TrackingLaw
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import ConvergenceError, InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.assumptions import limits_left_out, without_dry_friction
from ccpin.proof.facts import Fact, NotProvedError, is_fact, prove
from ccpin.proof.verdict import Verdict, not_known_of

_LEAST = 1e-9  # ε, the smallest tried
_MIDDLE = 1e-3  # ε, the one tried first
_STRIDE = 4.0  # from one ε to the next, until one is proved and one is not
_NEAR = 1.1  # of the largest ε proved: one not proved that ends the search


@dataclass(frozen=True, eq=False, repr=False)
class TrackingCertificate(TubeCertificate):
    """What is proved of a law that follows its reference with a σ that is off by at most ε.

    Attributes:
        law: The law.
        sigma_error: ε.
        disturbance: f̄, of shape (n,).
        told: What the search came to, in a sentence.
        proved: The fact about the tube (`TubeKept`), which all numbers are of; ``None`` where none is proved.
    """

    law: TrackingLaw
    sigma_error: float
    disturbance: Array

    @property
    def verdict(self) -> Verdict:
        """``"proven"``, or ``"undecided"`` where the bounds do not close."""
        return "undecided" if self._known is None else "proven"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        return (
            self.told if self.proved is None or self._known is not None else not_known_of("this law and these errors")
        )

    @property
    def _known(self) -> Fact | None:
        """The fact, if it is one about the law, ε and f̄."""
        if not is_fact(self.proved, TubeKept):
            return None
        claim = self.proved.claim
        told = claim.sigma_error[0] == self.sigma_error and np.array_equal(claim.disturbance, self.disturbance)
        return self.proved if told and self._is_of_law(equations_of) else None

    @property
    def speeds(self) -> Array:
        """A bound of |ė|, alike."""
        return self._bounds()[1]

    @property
    def decay(self) -> float:
        """α, 1/s; 0 where nothing is proved."""
        return 0.0 if self._known is None else float(self._known.claim.decay[0])

    @property
    def gain(self) -> float:
        """γ, by which ε (1 rad or m) enters V^½, where there is no disturbance."""
        return float(self._found("gain", 1)[0])

    @property
    def unit(self) -> Array:
        """|x_i| ≤ unit_i V^½ anywhere, x = (e, ė), of shape (2n,)."""
        return self._found("unit", 2 * len(self.disturbance))

    @property
    def start(self) -> float:
        """The bound of V at t = 0."""
        return float(self._found("level", 1)[0])

    @property
    def assumes(self) -> tuple[str, ...]:
        """The limits that the mechanism states and the theorem takes not to be met."""
        return limits_left_out(self.law.model.mechanism)

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
        if self._known is None:
            raise InvalidInputError(f"there is no proved motion to sample: {self.reason}")
        try:
            found = prove(SigmaKept(self._known.claim.equations, np.array([period])), self._known).found
        except NotProvedError as error:
            raise ConvergenceError(str(error)) from None
        return OnlineDemand(float(found["start"][0]), int(found["steps"][0]), float(found["tolerance"][0]))


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
    return _certificate(law, tube_of(law, cells), Disturbances(sigma_error, push, start))


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
        found = _certificate(law, tube, Disturbances(trial, push, start))
        if found.verdict == "proven":
            low, best = trial, found
        else:
            high, best = trial, best or found
        trial = low * _STRIDE if np.isinf(high) else high / _STRIDE if low == 0.0 else float(np.sqrt(low * high))
    assert best is not None
    return best


def _certificate(law: TrackingLaw, tube: ReferenceTube, given: Disturbances) -> TrackingCertificate:
    found = TubeSearch(tube, given).found()
    reason = found.reason + without_dry_friction(law.model.mechanism)
    return TrackingCertificate(law, reason, found.proved, tube, given.sigma_error, given.push)


def _given(law: TrackingLaw, push: ArrayLike, error: ArrayLike, speed: ArrayLike) -> tuple[Array, Array]:
    """f̄ (n,) and the bounds of (e, ė) at the start (2n,)."""
    given = {"disturbance": push, "initial_error": error, "initial_speed": speed}
    bounds = [bound_at_start(value, name, law.model.n) for name, value in given.items()]
    return bounds[0], np.concatenate(bounds[1:])


def bound_at_start(value: ArrayLike, name: str, n: int) -> Array:
    """A bound of each of n errors, given as such or as one number.

    Raises:
        InvalidInputError: It is negative or not finite, or of another shape.
    """
    array = numbers(value, name)
    if array.shape not in ((), (n,)) or not np.all(np.isfinite(array) & (array >= 0.0)):
        raise InvalidInputError(f"{name} must be a nonnegative number or {n} of them; it is {value!r}")
    return np.broadcast_to(array, (n,)).copy()


def _check(law: TrackingLaw) -> None:
    """That the theorem is about this law and mechanism."""
    instance(law, "law", TrackingLaw)
    feedback_of(law)
    require_motors_on_q(law.model, "an error of σ changes what they exert too")
    require_scalar(law.model)


def require_motors_on_q(model: ReducedModel, otherwise: str) -> None:
    """That u is a force on q that depends on no configuration: motors on the independent joints, geared or not.

    Raises:
        UnsupportedMechanismError: One sits elsewhere, or an independent joint has none.
    """
    if set(model.mechanism.actuated) != set(model.mechanism.independent):
        raise UnsupportedMechanismError(
            f"{model.mechanism.name}: the motors sit elsewhere than on the independent joints, so {otherwise}; load it "
            "with independent= set to the motors"
        )


def require_scalar(model: ReducedModel) -> None:
    """That each independent coordinate is a number whose error has a size.

    Raises:
        UnsupportedMechanismError: One is a ball's, a circle's or another's.
    """
    if not (model.coordinates.scalar and model.coordinates.constant):
        raise UnsupportedMechanismError(
            f"{model.mechanism.name}: tracking is certified for revolute and prismatic independent joints only"
        )
