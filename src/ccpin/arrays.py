"""Small arrays: the aliases for them, and what every room does with them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Record = TypeVar("Record", bound=tuple[Any, ...])  # a named tuple of arrays with a common leading axis


def rows_of(record: Record, rows: Indices | Mask | slice) -> Record:
    """The chosen rows of every array of a named tuple (and of the named tuples in it)."""
    return type(record)(*(rows_of(part, rows) if isinstance(part, tuple) else part[rows] for part in record))


def joined(records: Iterable[Record]) -> Record:
    """Named tuples of arrays (and of named tuples of them) one below the other."""
    first, *others = records
    columns = zip(first, *others, strict=True)
    return type(first)(*(joined(parts) if isinstance(parts[0], tuple) else np.concatenate(parts) for parts in columns))


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
