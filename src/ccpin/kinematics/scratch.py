"""Pinocchio's scratch memory, lent to one caller at a time, so that threads never meet in it."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array


class Scratch:
    """A pool of `pin.Data` of one model: as many as were ever in use at the same time.

    `take` one, read what Pinocchio wrote into it, and `give` it back; one lost to an error is replaced. Both are single
    operations on a list and so safe among threads; results must be copied out before giving back.

    Args:
        model: The Pinocchio model; not to be changed afterwards.
    """

    __slots__ = ("_free", "_model")

    def __init__(self, model: pin.Model) -> None:
        self._model = model
        self._free: list[pin.Data] = []

    @property
    def model(self) -> pin.Model:
        """The Pinocchio model."""
        return self._model

    def take(self) -> pin.Data:
        """A `pin.Data` nobody else holds."""
        try:
            return self._free.pop()
        except IndexError:
            return pin.Data(self._model)  # createData makes one, and copies it

    def give(self, data: pin.Data) -> None:
        """Return what `take` gave."""
        self._free.append(data)

    def __reduce__(self) -> tuple[type[Scratch], tuple[pin.Model]]:
        return Scratch, (self._model,)


def six_rows(columns: Array) -> Array:
    """A copy of Pinocchio's 6×n′ matrix, which comes flat where n′ = 1."""
    return np.array(columns).reshape(6, -1)
