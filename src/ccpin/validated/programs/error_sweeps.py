"""A program forwards over boxes, each operation widened by what is lost in it; then backwards: what that does at last.

See `ccpin/proof/theorems/program_rounding.md`: an error π made at a value arrives at an output times ∂output/∂value,
taken at some values between the exact and the computed ones. Errors that cancel in a solve thus do so here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.programs.instructions import (
    ADD,
    CONSTANT,
    COSINE,
    MULTIPLY,
    RECIPROCAL,
    ROOT,
    SCALE,
    SINE,
    SUBTRACT,
    Instruction,
)
from ccpin.programs.sine_cosine import DOUBLE, FLOAT
from ccpin.validated.arithmetic.first_order import (
    FirstOrder,
    constant,
    linear,
    reciprocal,
    root,
    sine_and_cosine,
)
from ccpin.validated.programs.program_equations import Runnable

_UP = 1.0 + 2.0**-40  # on a bound made of some thousand sums and products of doubles that are not negative
_ADDED = 1.0 + 2.0**-50  # on a sum at each number added: covers its rounding and a product's
_LEAST = 1e-290  # above what thousands of underflows add


class Numbers(NamedTuple):
    """A floating-point format.

    Attributes:
        name: Its name.
        unit: Its roundoff.
        least: Its least normal number: results below are taken for lost.
        largest: A number below its largest.
        sine: What a sine or cosine is off by at most.
        reach: Up to which angle.
    """

    name: str
    unit: float
    least: float
    largest: float
    sine: float
    reach: float


FORMATS = (
    Numbers("double", 2.0**-53, 2.0**-1022, 2.0**1000, DOUBLE.error, DOUBLE.reach),
    Numbers("float", 2.0**-24, 2.0**-126, 2.0**120, FLOAT.error, FLOAT.reach),
)


class Swept(NamedTuple):
    """A program over boxes, forwards.

    Attributes:
        values: What every value is in, exact, computed, or in between.
        lost: Bounds of what is lost in each operation, by the number of its value, of shape (B,).
        reached: Whether every sine is of an angle within reach, of shape (B,).
    """

    values: list[FirstOrder]
    lost: dict[int, Array]
    reached: Array


def evaluated(program: Runnable, inputs: Sequence[FirstOrder]) -> list[FirstOrder]:
    """The outputs over boxes, without roundings."""
    values = _swept(program, inputs, None, {}).values
    return [values[number] for number in program.code.outputs]


def swept(program: Runnable, inputs: Sequence[FirstOrder], numbers: Numbers, jumps: Mapping[int, Array]) -> Swept:
    """All values over boxes; `jumps`, by number: how far a value may be from what it is to stand for, besides."""
    return _swept(program, inputs, numbers, jumps)


def _swept(
    program: Runnable, inputs: Sequence[FirstOrder], numbers: Numbers | None, jumps: Mapping[int, Array]
) -> Swept:
    code, axes = program.code, inputs[0].slopes.shape[-1]
    values: list[FirstOrder] = [*inputs, *[None] * (code.size - len(inputs))]  # type: ignore[list-item]
    lost, waves = dict[int, Array](), dict[int, tuple[FirstOrder, FirstOrder]]()
    reached = np.ones(len(inputs[0].mid), dtype=np.bool_)
    with np.errstate(all="ignore"):
        for item in code.instructions:
            value = _value(item, values, program, waves, axes)
            if numbers is not None:
                loss = _loss(item, value, values, program, numbers)
                if item.kind in (SINE, COSINE):
                    reached &= values[item.a].size <= numbers.reach
                loss = loss + jumps.get(item.target, 0.0)
                lost[item.target] = loss
                value = value.widened(loss)
            values[item.target] = value
    return Swept(values, lost, reached)


def _value(
    item: Instruction,
    values: list[FirstOrder],
    program: Runnable,
    waves: dict[int, tuple[FirstOrder, FirstOrder]],
    axes: int,
) -> FirstOrder:
    kind, a, b = item.kind, item.a, item.b
    if kind == MULTIPLY:
        return values[a] * values[b]
    if kind == ADD:
        return values[a] + values[b]
    if kind == SUBTRACT:
        return values[a] - values[b]
    if kind in (SCALE, CONSTANT):
        factor = program.factors[item.target]
        if kind == CONSTANT:
            return constant(factor.value, factor.off, axes)
        return values[a].scaled(factor.value, factor.off)
    if kind in (SINE, COSINE):
        return _wave(a, values, waves)[kind == COSINE]
    return reciprocal(values[a]) if kind == RECIPROCAL else root(values[a])


def _wave(
    a: int, values: list[FirstOrder], waves: dict[int, tuple[FirstOrder, FirstOrder]]
) -> tuple[FirstOrder, FirstOrder]:
    """Sine and cosine of a value, found once."""
    if a not in waves:
        waves[a] = sine_and_cosine(values[a])
    return waves[a]


def _loss(
    item: Instruction, value: FirstOrder, values: list[FirstOrder], program: Runnable, numbers: Numbers
) -> Array:
    """Bounds of what an operation loses, of operands as they were computed."""
    if item.kind in (SINE, COSINE):
        return np.full_like(value.mid, numbers.sine)
    if item.kind not in (SCALE, CONSTANT):
        return np.asarray((numbers.unit * value.size + numbers.least) * _UP)
    factor = program.factors[item.target]
    off = factor.double if numbers.name == "double" else factor.single
    if item.kind == CONSTANT:
        return np.full_like(value.mid, off)
    size = values[item.a].size
    rounding = 0.0 if factor.exact else numbers.unit * (abs(factor.value) + factor.off + off) * size
    return np.asarray((off * size + rounding + numbers.least) * _UP)


def arriving(program: Runnable, found: Swept, outputs: Sequence[int]) -> Array:
    """What is lost by the outputs at most, of shape (outputs, B)."""
    code, count = program.code, len(outputs)
    rows, axes = found.reached.shape[0], next(v for v in found.values if v is not None).slopes.shape[-1]
    shares = dict[int, FirstOrder]()
    waves = dict[int, tuple[FirstOrder, FirstOrder]]()
    for place, number in enumerate(outputs):
        one = np.zeros((count, rows))
        one[place] = 1.0
        _add(shares, number, linear(one, np.zeros((count, rows, axes))))
    total = np.zeros((count, rows))
    with np.errstate(all="ignore"):
        for item in reversed(code.instructions):
            share = shares.pop(item.target, None)
            if share is None:
                continue
            total = (total + share.size * found.lost[item.target]) * _ADDED
            for operand, part in _shares(item, share, found.values, program, waves):
                _add(shares, operand, part)
    return total + _LEAST


def _add(shares: dict[int, FirstOrder], number: int, part: FirstOrder) -> None:
    shares[number] = shares[number] + part if number in shares else part


def _shares(
    item: Instruction,
    share: FirstOrder,
    values: list[FirstOrder],
    program: Runnable,
    waves: dict[int, tuple[FirstOrder, FirstOrder]],
) -> list[tuple[int, FirstOrder]]:
    """What of a change of a value is due to its operands."""
    kind, a, b = item.kind, item.a, item.b
    if kind == MULTIPLY:
        return [(a, share * values[b]), (b, share * values[a])]
    if kind == ADD:
        return [(a, share), (b, share)]
    if kind == SUBTRACT:
        return [(a, share), (b, -share)]
    if kind == SCALE:
        factor = program.factors[item.target]
        return [(a, share.scaled(factor.value, factor.off))]
    if kind == CONSTANT:
        return []
    if kind == SINE:
        return [(a, share * _wave(a, values, waves)[1])]
    if kind == COSINE:
        return [(a, -(share * _wave(a, values, waves)[0]))]
    own = values[item.target]
    if kind == RECIPROCAL:
        return [(a, -(share * (own * own)))]
    return [(a, (share * reciprocal(own)).scaled(0.5, 0.0))]
