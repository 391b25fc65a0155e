"""Many configurations at once: the compiled core on as many threads as asked for, and the reference where it declines.

Each row is answered as if it were asked for alone; neither the order of the rows nor the number of threads changes it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Mask, numbers
from ccpin.errors import CcpinError, InvalidInputError

Rows = ArrayLike
"""A row for each configuration."""
Failures = dict[int, str]
"""The rows of a batch that have no answer, and why."""


def rows(value: ArrayLike, name: str, columns: int) -> Array:
    """A float64 array of shape (N, columns), whatever numbers are in it.

    Raises:
        InvalidInputError: It has another shape, or holds no numbers.
    """
    array = np.ascontiguousarray(numbers(value, name))
    if array.ndim != 2 or array.shape[1] != columns:
        raise InvalidInputError(f"{name} has shape {array.shape}; it must be (N, {columns})")
    return array


def together(*arrays: Array) -> int:
    """How many rows they all have.

    Raises:
        InvalidInputError: Their numbers differ.
    """
    if len({len(array) for array in arrays}) != 1:
        raise InvalidInputError(f"arrays of different lengths: {', '.join(str(len(a)) for a in arrays)}")
    return len(arrays[0])


def completed(
    found: tuple[Sequence[Array], Mask] | None,
    alone: Callable[[int], Sequence[Array]],
    count: int,
    shapes: Sequence[tuple[int, ...]],
    failures: Failures | None,
) -> list[Array]:
    """The core's answers, and the reference's to the rows that it left.

    Args:
        found: The core's answers field by field, and which rows they are for; ``None``: for none.
        alone: The reference's answer to one row; it explains by raising.
        count: Rows.
        shapes: Of the answer's fields for one row.
        failures: Receives the rows without an answer, which are NaN then.

    Raises:
        CcpinError: Of the first row without an answer, where nobody takes `failures`.
    """
    if found is None:
        found = [np.full((count, *shape), np.nan) for shape in shapes], np.zeros(count, dtype=bool)
    fields, answered = found
    for row in np.flatnonzero(~answered).tolist():
        try:
            answer = alone(row)
        except CcpinError as error:
            if failures is None:
                error.args = (f"row {row}: {error}",)
                raise
            failures[row] = str(error)
            for values in fields:
                values[row] = np.nan
            continue
        for values, value in zip(fields, answer, strict=True):
            values[row] = value
    return list(fields)
