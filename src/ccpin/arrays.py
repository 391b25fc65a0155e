"""Small arrays: the aliases for them, and what every room does with them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Mask = NDArray[np.bool_]
Record = TypeVar("Record", bound=tuple[Any, ...])  # a named tuple of arrays with a common leading axis
Key = TypeVar("Key")
Value = TypeVar("Value", covariant=True)


class FrozenMapping(Mapping[Key, Value]):
    """A mapping that cannot be written to, in the order it was given; unlike `types.MappingProxyType` it pickles."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[Key, Value]) -> None:
        self._items = dict(items)

    def __getitem__(self, key: Key) -> Value:
        return self._items[key]

    def __iter__(self) -> Iterator[Key]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __repr__(self) -> str:
        return f"FrozenMapping({self._items!r})"


_YZX, _ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])
_FEW = 1500


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


def cross(a: Array, b: Array) -> Array:
    """a × b over the last axis of arrays (…, 3), with broadcasting."""
    if a.size < _FEW and b.size < _FEW:  # four calls where the views below take fifteen
        return np.asarray(a.take(_YZX, -1) * b.take(_ZXY, -1) - a.take(_ZXY, -1) * b.take(_YZX, -1))
    product = np.empty(np.broadcast_shapes(a.shape, b.shape))
    (ax, ay, az), (bx, by, bz) = np.moveaxis(a, -1, 0), np.moveaxis(b, -1, 0)
    product[..., 0], product[..., 1], product[..., 2] = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return product


def skew(vectors: Array) -> Array:
    """The matrices [v]× of vectors (…, 3), of shape (…, 3, 3): [v]× x = v × x."""
    matrix = np.zeros((*vectors.shape, 3))
    x, y, z = np.moveaxis(vectors, -1, 0)
    matrix[..., 0, 1], matrix[..., 0, 2], matrix[..., 1, 2] = -z, y, -x
    matrix[..., 1, 0], matrix[..., 2, 0], matrix[..., 2, 1] = z, -y, x
    return matrix
