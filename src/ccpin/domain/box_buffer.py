"""Certified boxes as they come in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.krawczyk import Boxes

Index = NDArray[np.intp]


class BoxBuffer:
    """Boxes in the order they were certified."""

    def __init__(self, empty: Boxes) -> None:
        self._arrays = [array[:0].copy() for array in empty]
        self.count = 0

    def append(self, boxes: Boxes) -> Index:
        """Add boxes; their numbers."""
        numbers = np.arange(self.count, self.count + len(boxes.kappa))
        for k, array in enumerate(boxes):
            if self.count + len(array) > len(self._arrays[k]):
                room = max(64, self.count + len(array))
                spare = np.zeros((room, *array.shape[1:]))
                self._arrays[k] = np.concatenate([self._arrays[k][: self.count], spare])
            self._arrays[k][numbers] = array
        self.count += len(numbers)
        return numbers

    def take(self, numbers: Index) -> Boxes:
        """Boxes by number."""
        return Boxes(*(array[numbers] for array in self._arrays))

    def all(self) -> Boxes:
        """All boxes."""
        return Boxes(*(array[: self.count].copy() for array in self._arrays))
