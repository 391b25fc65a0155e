"""Adaptive tracking, sampled: a bound of the error for every robot of a box of constants, proved.

Theorem L of `ccpin/proof/theorems/adaptive.md`, which also says what is not covered. `_check` looks at which laws and
motors it is about, `AdaptiveSearch` looks for a tube, and `AdaptiveTube` proves it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, positive, whole
from ccpin.control.stability.tracking.reference_tube import cut_along, theta_at_start
from ccpin.control.stability.tracking.tracking_equations import ReferencePieces
from ccpin.control.stability.tracking.tracking_error import bound_at_start, require_motors_on_q, require_scalar
from ccpin.control.stability.tracking.tube_certificate import TubeCertificate
from ccpin.domain.closures.system import Reading
from ccpin.errors import UnsupportedMechanismError
from ccpin.identification.adaptive.adaptive_equations import AdaptiveEquations, AdaptiveGains
from ccpin.identification.adaptive.adaptive_reading import constants_of, frames_on
from ccpin.identification.adaptive.adaptive_search import AdaptiveSearch
from ccpin.identification.adaptive.adaptive_tracking import AdaptiveTracking
from ccpin.identification.adaptive.adaptive_tube_claim import AdaptiveTube
from ccpin.mechanism.assumptions import without_dry_friction
from ccpin.proof.equations import closures_of
from ccpin.proof.facts import Fact, is_fact
from ccpin.proof.rounding import SLACK
from ccpin.proof.verdict import Verdict, not_known_of


@dataclass(frozen=True, eq=False, repr=False)
class AdaptiveCertificate(TubeCertificate):
    """What is proved of an adaptive law along its reference, for all constants of its box at once.

    Attributes:
        law: The law.
        told: What the search came to, in a sentence.
        proved: The fact about the tube (`AdaptiveTube`), which all numbers are of; ``None`` where none is proved.
    """

    law: AdaptiveTracking

    @property
    def verdict(self) -> Verdict:
        """``"proven"``, or ``"undecided"`` where the bounds do not close or ask more than the motors have."""
        return "undecided" if self._known is None or self._beyond else "proven"

    @property
    def reason(self) -> str:
        """The verdict in a sentence."""
        if self.proved is not None and self._known is None:
            return not_known_of("this law")
        return f"{self.told}; but {self._beyond}" if self._known is not None and self._beyond else self.told

    @property
    def _known(self) -> Fact | None:
        """The fact, if it is one about the law."""
        own = is_fact(self.proved, AdaptiveTube) and self._is_of_law(equations_of)
        return self.proved if own else None

    @property
    def _beyond(self) -> str:
        """Which motor the law may ask for more than it has; empty where none."""
        mechanism = self.law.model.mechanism
        least = np.abs(mechanism.motors.limits).min(axis=1)
        for name, asked, most in zip(mechanism.actuated, self.efforts.tolist(), least.tolist(), strict=True):
            if not asked <= most:
                return f"the motor on '{name}' may be asked for {asked:.3g}, of {most:.3g} that it has"
        return ""

    @property
    def sliding(self) -> Array:
        """A bound of |s|, s = ė + Λe, over each cell, alike."""
        return self._bounds()[1]

    @property
    def efforts(self) -> Array:
        """What the law asks of each motor at most, whatever the robot and the estimate, of shape (motors,)."""
        share = np.abs(_motors_of(self.law))
        if self._known is None:
            return np.full(len(share), np.inf)
        return np.asarray(share @ self._known.found["efforts"].max(axis=0) * SLACK)

    def mean_square(self, duration: float) -> Array:
        """A bound of the mean of s_i² over the first `duration` seconds, samples whole, of shape (n,).

        (V(0)/t + p)/K_i: what is left as t → ∞ is sampling's alone, and goes with the period.

        Args:
            duration: t, s; infinity for what is left.

        Raises:
            InvalidInputError: It is not positive.
        """
        per_second = 0.0 if isinstance(duration, float) and duration == np.inf else 1.0 / positive(duration, "duration")
        if self._known is None:
            return np.full(self.law.model.n, np.inf)
        first, power = (self._known.found[name][0] for name in ("first", "power"))
        return np.asarray((first * per_second + power) / np.diag(self.law.K) * SLACK)


def certify_adaptive(
    law: AdaptiveTracking, *, initial_error: ArrayLike = 0.0, initial_sliding: ArrayLike = 0.0, cells: int = 128
) -> AdaptiveCertificate:
    """Bound the error of a sampled adaptive law for all robots whose constants lie in the law's box.

    Args:
        law: The law, along a reference of polynomials that is twice continuously differentiable.
        initial_error: A bound of |q − q_d| at t = 0, a number or (n,).
        initial_sliding: A bound of |s|, s = ė + Λe, at t = 0, alike.
        cells: Into how many cells the reference's duration is cut; none may be shorter than the law's period.

    Raises:
        InvalidInputError: A bound is negative or not finite, or the reference's polynomials begin before t = 0, jump,
            or are not the motion that its `at` tells.
        UnsupportedMechanismError: Gains that are not diagonal, coordinates or joints that are not scalar, motors
            elsewhere than on the independent joints, a reference that is no piecewise polynomial, closures that cannot
            be certified.
        SingularConfigurationError: The start is singular, or too near.
    """
    _check(law)
    given = {"initial_error": initial_error, "initial_sliding": initial_sliding}
    start = np.concatenate([bound_at_start(value, name, law.model.n) for name, value in given.items()])
    tube = cut_along(law, whole(cells, "cells"), equations_of)
    found = AdaptiveSearch(tube, start).found()
    return AdaptiveCertificate(law, found.reason + without_dry_friction(law.model.mechanism), found.proved, tube)


def equations_of(law: AdaptiveTracking, reading: Reading, reference: ReferencePieces) -> AdaptiveEquations:
    """What is claimed of a law, over closures that are read off its mechanism."""
    model, theta = law.model, theta_at_start(law, reading)
    places = constants_of(model.parameters)
    gains = AdaptiveGains(np.diag(law.slope), np.diag(law.K), law.gain, law.period)
    constants = law.known[places], law.basis[places], law.lower, law.upper
    held = frames_on(model.mechanism, reading), model.gravity_vector, *constants
    return AdaptiveEquations(closures_of(reading.problem), *held, gains, reference, theta)


def _motors_of(law: AdaptiveTracking) -> Array:
    """What one unit of each generalized force asks of the motors, of shape (motors, n)."""
    return np.array([law.near.efforts(unit) for unit in np.eye(law.model.n)]).T


def _check(law: AdaptiveTracking) -> None:
    """That the theorem is about this law and mechanism."""
    instance(law, "law", AdaptiveTracking)
    mechanism = law.model.mechanism
    plural = next((joint for joint in mechanism.tree.joints if joint.kind.nv != 1), None)
    if plural is not None:
        raise UnsupportedMechanismError(
            f"{mechanism.name}: the {plural.kind.name} joint '{plural.name}' has several freedoms, whose error has no "
            "size that does not depend on a chart; describe it as joints about one axis each"
        )
    require_motors_on_q(law.model, "efforts that are held are no constant force on q")
    require_scalar(law.model)
    for name, gains in (("slope", law.slope), ("K", law.K)):
        if not np.array_equal(gains, np.diag(np.diag(gains))):
            raise UnsupportedMechanismError(f"{name} is not diagonal, which the bound of single coordinates needs")
