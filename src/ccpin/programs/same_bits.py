"""What a compiled program answers, to the bit, in NumPy: C's operations in C's order, in double or float."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.programs.certified_region import OUTSIDE
from ccpin.programs.evaluation import values_of
from ccpin.programs.folding import DOUBLES, folded
from ccpin.programs.instructions import Kind
from ccpin.programs.program import SMALL_PIVOT, Program
from ccpin.programs.sine_cosine import Precision, sine_and_cosine


class Bits(NamedTuple):
    """Answers at N inputs.

    Attributes:
        outputs: Of shape (N, outputs), in the format.
        status: Of shape (N,): 0, 1, 2 or 3.
    """

    outputs: NDArray[Any]
    status: NDArray[Any]


class _Own:
    """NumPy's functions with our sine and cosine."""

    def __init__(self, precision: Precision) -> None:
        self._precision = precision

    def sin(self, x: NDArray[Any]) -> NDArray[Any]:
        return sine_and_cosine(x, self._precision)[0]

    def cos(self, x: NDArray[Any]) -> NDArray[Any]:
        return sine_and_cosine(x, self._precision)[1]

    def __getattr__(self, name: str) -> Any:
        return getattr(np, name)


def c_answers(program: Program, inputs: NDArray[Any], precision: Precision) -> Bits:
    """The outputs and status at inputs of shape (N, inputs), as C has them without fused operations.

    arccos and arctan2, which programs with whole ball joints or laws of continuous joints have, are the system's.
    """
    code, rows = folded(program.code, DOUBLES), np.ascontiguousarray(inputs, dtype=precision.type)
    with np.errstate(all="ignore"):
        values = values_of(code, list(rows.T), _Own(precision))
        divides = np.zeros(len(rows), dtype=np.bool_)
        for item in code.instructions:
            if item.kind in (Kind.SINE, Kind.COSINE):
                divides |= ~(precision.type(precision.reach**2) > values[item.a] * values[item.a])
        for pivot in program.pivots:
            low = precision.type((SMALL_PIVOT * pivot.scale) ** 2)
            divides |= ~(values[pivot.number] * values[pivot.number] > low)
        moved = sum(values[number] * values[number] for number in program.corrections)
        stays = moved < precision.type(precision.converged(program.tolerance) ** 2) if program.corrections else True
    outputs = np.empty((len(rows), len(code.outputs)), dtype=precision.type)
    for k, number in enumerate(code.outputs):
        outputs[:, k] = values[number]
    status = np.where(divides, 1, np.where(stays, 0, 2))
    if program.region is not None:
        program.region.require(precision.name)
        status = np.where(program.region.holds(rows.T, precision), status, OUTSIDE)
    return Bits(outputs, status)
