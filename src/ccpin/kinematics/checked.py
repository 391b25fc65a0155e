"""Coordinates given by a user, as float64 vectors on their manifolds."""

from __future__ import annotations

import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, vector
from ccpin.errors import InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates

_OFF = 1e-6


def checked_q(coordinates: IndependentCoordinates, q: ArrayLike, name: str = "q") -> Array:
    """Return q as a float64 vector on its manifold, of shape (coordinates.nq,).

    Raises:
        InvalidInputError: Wrong shape, not finite, or a circle or quaternion that is not of unit length.
    """
    array = vector(q, name, coordinates.nq)
    if coordinates.scalar:
        return array
    if coordinates.off_manifold(array) > _OFF:
        raise InvalidInputError(f"{name} holds a quaternion or (cosine, sine) pair that is not of unit length")
    return coordinates.normalize(array)


def checked_configuration(model: pin.Model, q_free: ArrayLike, name: str = "q_free") -> Array:
    """Return a configuration q′ as a float64 vector, of shape (nq,).

    Raises:
        InvalidInputError: Wrong shape, not finite, or a circle or quaternion that is not of unit length.
    """
    array = vector(q_free, name, model.nq)
    if model.nq != model.nv and not pin.isNormalized(model, array, _OFF):
        raise InvalidInputError(f"{name} holds a quaternion or (cosine, sine) pair that is not of unit length")
    return array
