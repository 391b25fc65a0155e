"""Pinocchio's scratch memory, lent to one caller at a time, so that threads never meet in it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.errors import UnsupportedMechanismError

_ENTRIES = 4.2  # doubles that `pin.Data` has for each of nv³ (measured: 4.1 to 4.5), its derivatives of second order


def available_memory() -> float:
    """Bytes that may be had without ending other programs; without bound where the system does not tell."""
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return 1024.0 * float(next(line for line in lines if line.startswith("MemAvailable")).split()[1])
    return math.inf


class Scratch:
    """A pool of `pin.Data` of one model: as many as were ever in use at the same time.

    Taking one and giving it back are single operations on a list and so safe among threads; results must be copied out
    before it is given back.

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

    @contextmanager
    def lent(self) -> Iterator[pin.Data]:
        """A `pin.Data` nobody else holds, for as long as the block lasts.

        Raises:
            UnsupportedMechanismError: There is no room for another; a system that lends it all the same ends processes.
        """
        try:
            data = self._free.pop()
        except IndexError:
            data = self._another()
        try:
            yield data
        finally:
            self._free.append(data)

    def _another(self) -> pin.Data:
        if (room := _ENTRIES * 8 * self._model.nv**3) > available_memory():
            message = f"{self._model.nv} velocities take {room / 1e9:.3g} GB of Pinocchio's memory, which are not there"
            raise UnsupportedMechanismError(message)
        return pin.Data(self._model)  # createData makes one, and copies it

    def __reduce__(self) -> tuple[type[Scratch], tuple[pin.Model]]:
        return Scratch, (self._model,)


def six_rows(columns: Array) -> Array:
    """A copy of Pinocchio's 6×n′ matrix, which comes flat where n′ = 1."""
    return np.array(columns).reshape(6, -1)
