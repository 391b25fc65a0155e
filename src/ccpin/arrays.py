"""Small arrays: the one alias for them, and what every room does with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.errors import InvalidInputError

Array = NDArray[np.float64]


def vector(value: ArrayLike, name: str, size: int) -> Array:
    """Return a finite float64 vector of the given size (not a copy where it is one already).

    Raises:
        InvalidInputError: It is not that.
    """
    return _checked(value, name, (size,))


def matrix(value: ArrayLike, name: str, shape: tuple[int, int]) -> Array:
    """Return a finite float64 matrix of the given shape (not a copy where it is one already).

    Raises:
        InvalidInputError: It is not that.
    """
    return _checked(value, name, shape)


def matrix_rows(value: ArrayLike, name: str, columns: int) -> Array:
    """Return finite float64 vectors of the given size, one a row, of shape (N, columns).

    Raises:
        InvalidInputError: They are not that.
    """
    return _checked(value, name, (None, columns))


def positive(value: float, name: str, what: str = "a positive number") -> float:
    """Return a positive, finite number.

    Raises:
        InvalidInputError: It is not that; `what` says what it must be.
    """
    if not (np.isfinite(value) and value > 0):
        raise InvalidInputError(f"{name} = {value} must be {what}")
    return float(value)


def _checked(value: ArrayLike, name: str, shape: tuple[int | None, ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidInputError(f"{name} is not an array of numbers") from None
    if array.shape != shape and (shape[0] is not None or array.ndim != len(shape) or array.shape[1:] != shape[1:]):
        wanted = str(shape).replace("None", "N")
        raise InvalidInputError(f"{name} has shape {array.shape}; it must be {wanted}")
    if not np.isfinite(array).all():
        raise InvalidInputError(f"{name} has entries that are not finite")
    return array
