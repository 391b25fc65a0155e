"""Programs over rows of NumPy's arrays, in lanes where there is a compiler, and how arguments are told apart."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.errors import InvalidInputError
from ccpin.programs.lanes import fastest
from ccpin.programs.program import Program


def in_order(program: Program, placed: Sequence[Any], named: Mapping[str, Any]) -> list[Any]:
    """The arguments in the program's order.

    Raises:
        InvalidInputError: One is missing, unknown, or given twice.
    """
    names = [port.name for port in program.inputs]
    given = {**dict(zip(names, placed, strict=False)), **named}
    if len(placed) + len(named) != len(names) or sorted(given) != sorted(names):
        raise InvalidInputError(f"the inputs of '{program.name}' are {', '.join(names)}, one of each")
    return [given[name] for name in names]


def leading(program: Program, shapes: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """What comes before the inputs' own shapes, broadcast.

    Raises:
        InvalidInputError: A shape does not end with its port's, or they do not broadcast.
    """
    found = list[tuple[int, ...]]()
    for port, shape in zip(program.inputs, shapes, strict=True):
        cut = len(shape) - len(port.shape)
        if cut < 0 or tuple(shape[cut:]) != port.shape:
            raise InvalidInputError(f"{port.name} must end in the shape {port.shape}, not be of {tuple(shape)}")
        found.append(tuple(shape[:cut]))
    try:
        return np.broadcast_shapes(*found)
    except ValueError as error:
        raise InvalidInputError(f"inputs of different numbers of rows: {error}") from None


class RowProgram:
    """A program over arrays (…, *shape) of one batch, NaN where its status is not 0."""

    def __init__(self, program: Program) -> None:
        self.program = program
        self._fastest = cache(partial(fastest, program))

    def __call__(self, *arrays: Any) -> list[NDArray[Any]]:
        """The outputs, each of shape (…, *shape), in the inputs' precision."""
        ports, tables = self.program.inputs, [np.asarray(array) for array in arrays]
        batch, kind = leading(self.program, [table.shape for table in tables]), np.result_type(*tables)
        rows = math.prod(batch)
        wide = [
            np.broadcast_to(table, (*batch, *port.shape)).reshape(rows, *port.shape)
            for table, port in zip(tables, ports, strict=True)
        ]
        *outputs, status = self._fastest("float" if kind == np.float32 else "double")(*wide)
        for output in outputs:
            output[status != 0] = np.nan
        return [output.astype(kind, copy=False).reshape(*batch, *output.shape[1:]) for output in outputs]
