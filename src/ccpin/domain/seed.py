"""From a mechanism and a configuration to the scalar coordinates that certificates are about."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.chains import ClosureSystem, closure_system
from ccpin.errors import InvalidInputError
from ccpin.mechanism import Mechanism

Array = NDArray[np.float64]


class Seed(NamedTuple):
    """A closed configuration θ (n′,) in a chart centred at it, and the closures in that chart."""

    system: ClosureSystem
    theta: Array


def seed_at(mechanism: Mechanism, q_free: Array) -> Seed:
    """Close a configuration of shape (nq,) at its own independent coordinates, and centre the chart there.

    Raises:
        InvalidInputError: Its shape is wrong, or it cannot be closed.
        SingularConfigurationError: It is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    q_free = np.asarray(q_free, dtype=np.float64)
    if q_free.shape != (mechanism.nq,) or not np.all(np.isfinite(q_free)):
        raise InvalidInputError(
            f"q_free must be {mechanism.nq} finite numbers, a configuration of {mechanism.name}; "
            f"it has shape {q_free.shape}"
        )
    parametrization = mechanism.parametrization()
    closed = parametrization.sigma(parametrization.coordinates.alpha(q_free), guess=q_free).q_free
    system = closure_system(mechanism, closed)
    return Seed(system, system.chart.theta(closed))


def scalar_coordinates_at(mechanism: Mechanism, q_free: Array) -> Array:
    """q in the scalar coordinates of certificates, of shape (n,): a continuous joint's is its angle.

    Raises:
        InvalidInputError, SingularConfigurationError, UnsupportedMechanismError: As for `seed_at`.
    """
    seed = seed_at(mechanism, q_free)
    return np.array(seed.theta[seed.system.independent])


def seed_of(mechanism: Mechanism, q0: Array, guess: Array | None = None) -> Seed:
    """σ(q₀) on the branch of `guess` (default the reference), q₀ (n,) in scalar coordinates.

    A continuous joint's coordinate is its angle here, a planar joint's are x, y and the angle.

    Raises:
        InvalidInputError: q₀ has the wrong shape.
        UnreachableError, SingularConfigurationError: σ(q₀) does not exist on that branch, or is singular.
        UnsupportedMechanismError: The closures are of a kind that cannot be certified.
    """
    start = mechanism.q_reference if guess is None else np.asarray(guess, dtype=np.float64)
    system = closure_system(mechanism, start)
    q0 = scalar_coordinates(system, q0, mechanism)
    theta = system.chart.theta(start)
    theta[system.independent] = q0
    parametrization = mechanism.parametrization()
    q = parametrization.coordinates.alpha(system.chart.configuration(theta))
    closed = parametrization.sigma(q, guess=start).q_free
    system = closure_system(mechanism, closed)
    theta = system.chart.theta(closed)
    theta[system.independent] = q0
    return Seed(system, theta)


def scalar_coordinates(system: ClosureSystem, q: object, mechanism: Mechanism) -> Array:
    """Check that q is n finite numbers.

    Raises:
        InvalidInputError: It is not.
    """
    vector = np.asarray(q, dtype=np.float64)
    if vector.shape != (system.n,) or not np.all(np.isfinite(vector)):
        names = ", ".join(mechanism.independent)
        raise InvalidInputError(
            f"q must be {system.n} finite numbers, the scalar coordinates of {names}; it has shape {vector.shape}"
        )
    return vector
