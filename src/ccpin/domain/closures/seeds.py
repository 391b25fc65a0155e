"""From a mechanism and a configuration to the scalar coordinates that certificates are about."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers
from ccpin.domain.closures.system import Reading, reading_of
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of


class Seed(NamedTuple):
    """A closed configuration θ (n′,) in a chart centred at it, and the closures in that chart."""

    reading: Reading
    theta: Array

    @property
    def q(self) -> Array:
        """The independent ones among θ, of shape (n,)."""
        return np.asarray(self.theta[self.reading.system.independent])


def checked_configuration(mechanism: Mechanism, q_free: ArrayLike) -> Array:
    """A copy of q′ as a vector of shape (nq,).

    Raises:
        InvalidInputError: It is not that many finite numbers.
    """
    vector = numbers(q_free, "q_free").copy()
    if vector.shape != (mechanism.nq,) or not np.all(np.isfinite(vector)):
        raise InvalidInputError(
            f"q_free must be {mechanism.nq} finite numbers, a configuration of {mechanism.name}; "
            f"it has shape {vector.shape}"
        )
    return vector


def seed_at_configuration(mechanism: Mechanism | HasMechanism, q_free: Array) -> Seed:
    """Close a configuration of shape (nq,) at its own independent coordinates, and centre the chart there.

    Raises:
        InvalidInputError: Its shape is wrong, or it cannot be closed.
        SingularConfigurationError: It is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    mechanism = mechanism_of(mechanism)
    q_free = checked_configuration(mechanism, q_free)
    parametrization = mechanism.parametrization()
    closed = parametrization.sigma(parametrization.coordinates.alpha(q_free), near=q_free).q_free
    reading = reading_of(mechanism, closed)
    return Seed(reading, reading.theta(closed))


def scalar_coordinates_at(mechanism: Mechanism | HasMechanism, q_free: Array) -> Array:
    """q in the scalar coordinates of certificates, of shape (n,): a continuous joint's is its angle.

    Raises:
        InvalidInputError, SingularConfigurationError, UnsupportedMechanismError: As for `seed_at_configuration`.
    """
    return seed_at_configuration(mechanism, q_free).q


def seed_at_coordinates(mechanism: Mechanism, q0: ArrayLike, near: ArrayLike | None = None) -> Seed:
    """σ(q₀) on the branch of `near` (default the reference), q₀ (n,) in scalar coordinates.

    A continuous joint's coordinate is its angle here, a planar joint's are x, y and the angle.

    Raises:
        InvalidInputError: q₀ has the wrong shape.
        UnreachableError, SingularConfigurationError: σ(q₀) does not exist on that branch, or is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    if not mechanism.n:
        raise UnsupportedMechanismError(f"{mechanism.name} has mobility 0: there are no coordinates to certify")
    start = mechanism.q_reference if near is None else checked_configuration(mechanism, near)
    reading = reading_of(mechanism, start)
    q0 = numbers(q0, "q")
    if q0.shape != (reading.system.n,) or not np.all(np.isfinite(q0)):
        names = ", ".join(mechanism.independent)
        raise InvalidInputError(
            f"q must be {reading.system.n} finite numbers, the scalar coordinates of {names}; it has shape {q0.shape}"
        )
    theta = reading.chart.theta(start)
    theta[reading.system.independent] = q0
    parametrization = mechanism.parametrization()
    q = parametrization.coordinates.alpha(reading.configuration(theta))
    closed = parametrization.sigma(q, near=start).q_free
    reading = reading_of(mechanism, closed)
    theta = reading.theta(closed)
    theta[reading.system.independent] = q0
    return Seed(reading, theta)
