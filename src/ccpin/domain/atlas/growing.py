"""Named tuples of arrays that grow at the end."""

from __future__ import annotations

from typing import Any, Generic

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Columns, rows_of


class Growing(Generic[Columns]):
    """A named tuple of arrays with a common leading axis; rows are added in amortised constant time each.

    `rows` are views into buffers with room to spare; after `add` the new `rows` are to be used.
    """

    def __init__(self, rows: Columns) -> None:
        self._buffers, self._count = rows_of(rows, slice(None)), len(rows[0])
        self.rows: Columns = self._buffers

    def add(self, rows: Columns) -> None:
        """Add rows behind the others."""
        start, self._count = self._count, self._count + len(rows[0])
        if self._count > len(self._buffers[0]):
            self._buffers = type(rows)(*(_wider(buffer, start, self._count) for buffer in self._buffers))
        for buffer, new in zip(self._buffers, rows, strict=True):
            buffer[start : self._count] = new
        self.rows = rows_of(self._buffers, slice(self._count))

    def trimmed(self) -> Columns:
        """The rows in arrays of their own, without room to spare."""
        return type(self.rows)(*(array.copy() for array in self.rows))


def _wider(buffer: NDArray[Any], used: int, needed: int) -> NDArray[Any]:
    """A buffer for at least `needed` rows, with the first `used` of another."""
    wide = np.empty((needed + needed // 2, *buffer.shape[1:]), dtype=buffer.dtype)
    wide[:used] = buffer[:used]
    return wide
