"""Programs as `casadi.Function`s whose Jacobians are recorded ones.

CasADi is kept from looking inside: expanded, it would hold y still and unroll the solves. It finds which entries of a
Jacobian are 0 by propagation through the function all the same, so that values are made to depend on all inputs by
which a derivative was recorded (by min(|x|², 0), which is 0).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca

from ccpin.programs.bridges.differentiated import STEP, Differentiated, evaluated, parts_of
from ccpin.programs.c_code import identifier
from ccpin.programs.program import Port, Program, windows

_SX = SimpleNamespace(
    sin=ca.sin, cos=ca.cos, sqrt=ca.sqrt, arctan2=ca.atan2, arccos=ca.acos, minimum=ca.fmin, maximum=ca.fmax,
    where=ca.if_else, abs=ca.fabs, both=ca.logic_and, true=ca.SX(1),
)  # fmt: skip
_CLOSED = {"never_inline": True, "enable_forward": False, "enable_reverse": False}
_PLAIN = {**_CLOSED, "enable_jacobian": False}


def function_of(program: Program, outputs: str | Sequence[str] | None = None) -> Any:
    """A program as a `casadi.Function`."""
    parts, name = parts_of(program, outputs), identifier(program.name)
    inputs = [ca.SX.sym(port.name, port.size) for port in program.inputs]
    values = _evaluated(parts.values, inputs)
    for (k, j), _ in parts.blocks.items():
        values[k] = values[k] + ca.fmin(ca.sumsqr(inputs[j]), 0)
    options = _PLAIN if parts.slopes is None else {**_CLOSED, "custom_jacobian": _jacobian(parts, inputs, name)}
    return ca.Function(name, inputs, values, _names(program.inputs), _names(parts.values.outputs), options)


def _jacobian(parts: Differentiated, inputs: list[Any], name: str) -> Any:
    """∂(each output)/∂(each input) of inputs and outputs, as CasADi asks for it."""
    reads, gives, slopes = parts.values.inputs, parts.values.outputs, parts.slopes
    assert slopes is not None
    found = dict(zip(_names(slopes.outputs), _evaluated(slopes, inputs), strict=True))
    shapes = {port.name: port.shape for port in slopes.outputs}
    tables, names = list[Any](), list[str]()
    for k, output in enumerate(gives):
        for j, key in enumerate(reads):
            names.append(f"jac_{output.name}_{key.name}")
            word = parts.blocks.get((k, j))
            if word is None:
                tables.append(ca.SX(output.size, key.size))
                continue
            table = _rows(found[word], output.size, shapes[word][-1])
            moves = key.name == "q" and STEP in found
            tables.append(table @ _rows(found[STEP], *shapes[STEP]) if moves else table)
    unused = [ca.SX.sym(f"out_{port.name}", port.size) for port in gives]
    taken = [*_names(reads), *(f"out_{port.name}" for port in gives)]
    return ca.Function(f"jac_{name}", [*inputs, *unused], tables, taken, names, _PLAIN)


def _evaluated(program: Program, inputs: list[Any]) -> list[Any]:
    """Columns of the outputs, NaN where they cannot be trusted."""
    entries, trusted = evaluated(program, [column[k] for column in inputs for k in range(column.numel())], _SX)
    found, refuses = list[Any](), bool(program.pivots or program.corrections or program.region)
    for window in windows(program.outputs):
        column = ca.vertcat(*entries[window]) if entries[window] else ca.SX(0, 1)
        found.append(ca.if_else(trusted, column, math.nan) if refuses else column)
    return found


def _rows(column: Any, rows: int, columns: int) -> Any:
    """A table whose entries are given row by row."""
    return ca.reshape(column, columns, rows).T


def _names(ports: tuple[Port, ...]) -> list[str]:
    return [port.name for port in ports]
