"""Small arrays: the aliases for them, and what every room does with them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]


def apply(matrices: Array, vectors: Array) -> Array:
    """Matrices (…, m, n) times vectors (…, n), of shape (…, m)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def cross(u: Array, v: Array) -> Array:
    """The vector product over the last axis, with broadcasting (several times faster than NumPy's)."""
    x = u[..., 1] * v[..., 2] - u[..., 2] * v[..., 1]
    y = u[..., 2] * v[..., 0] - u[..., 0] * v[..., 2]
    z = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    return np.stack([x, y, z], axis=-1)


def skew(vectors: Array) -> Array:
    """The matrices [v]× of vectors (…, 3), of shape (…, 3, 3)."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = [np.stack(row, axis=-1) for row in ((zero, -z, y), (z, zero, -x), (-y, x, zero))]
    return np.stack(rows, axis=-2)
