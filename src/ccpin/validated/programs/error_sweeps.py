"""A program forwards over boxes, each operation widened by what is lost in it; then backwards: what that does at last.

See `ccpin/proof/theorems/program_rounding.md`: an error π made at a value arrives at an output times ∂output/∂value,
taken at some values between the exact and the computed ones. Errors that cancel in a solve thus do so here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.programs.instructions import Instruction, Kind
from ccpin.programs.sine_cosine import DOUBLE, FLOAT
from ccpin.proof.facts import require
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


def evaluated(program: Runnable, inputs: Sequence[FirstOrder]) -> list[FirstOrder]:
    """The outputs over boxes, without roundings."""
    sweep = ErrorSweep(program, inputs)
    sweep.run(program.code.outputs)
    return [sweep.values[number] for number in program.code.outputs]


class ErrorSweep:
    """A program over boxes, forwards as far as it is asked for, backwards from there.

    Args:
        program: The program.
        inputs: What its inputs are in, rows of shape (B,).
        numbers: The format in which it is computed; none: exactly.

    Attributes:
        values: What every value is in, exact, computed, or in between.
        lost: Bounds of what is lost in each operation, by the number of its value, of shape (B,).
        reached: Whether every sine is of an angle within reach, of shape (B,).
    """

    def __init__(self, program: Runnable, inputs: Sequence[FirstOrder], numbers: Numbers | None = None) -> None:
        self._program, self._numbers, self._done = program, numbers, 0
        self._axes, self._products = inputs[0].slopes.shape[-1], inputs[0].products
        self._waves = dict[int, tuple[FirstOrder, FirstOrder]]()
        self.values: dict[int, FirstOrder] = dict(enumerate(inputs))
        self.lost = dict[int, Array]()
        self.reached = np.ones(len(inputs[0].mid), dtype=np.bool_)

    def run(self, wanted: Sequence[int]) -> None:
        """Go on until these values are there."""
        code = self._program.code
        missing = set(wanted) - set(self.values)
        with np.errstate(all="ignore"):
            while missing:
                item = code.instructions[self._done]
                self._run(item)
                self._done += 1
                missing.discard(item.target)

    def arriving(self, wanted: Sequence[int], known: Mapping[int, Array]) -> Array:
        """What is lost by values at most, of shape (wanted, B); of those `known` it is this, whatever they come of."""
        rows, count = len(self.reached), len(wanted)
        shares = dict[int, FirstOrder]()
        for place, number in enumerate(wanted):
            one = np.zeros((count, rows))
            one[place] = 1.0
            _add(shares, number, linear(one, np.zeros((count, rows, self._axes)), self._products))
        total = np.zeros((count, rows))
        with np.errstate(all="ignore"):
            for item in reversed(self._program.code.instructions[: self._done]):
                share = shares.pop(item.target, None)
                if share is None:
                    continue
                lost = known.get(item.target, self.lost[item.target])
                total = (total + share.size * lost) * _ADDED
                if item.target not in known:
                    for operand, part in self._shares(item, share):
                        _add(shares, operand, part)
        return total + _LEAST

    def _run(self, item: Instruction) -> None:
        value = self._value(item)
        if self._numbers is not None:
            loss = self._loss(item, value, self._numbers)
            if item.kind in (Kind.SINE, Kind.COSINE):
                self.reached &= self.values[item.a].size <= self._numbers.reach
            self.lost[item.target] = loss
            value = value.widened(loss)
        self.values[item.target] = value

    def _value(self, item: Instruction) -> FirstOrder:
        kind, a, b, values = item.kind, item.a, item.b, self.values
        if kind == Kind.MULTIPLY:
            return values[a] * values[b]
        if kind == Kind.ADD:
            return values[a] + values[b]
        if kind == Kind.SUBTRACT:
            return values[a] - values[b]
        if kind in (Kind.SCALE, Kind.CONSTANT):
            factor = self._program.factors[item.target]
            if kind == Kind.CONSTANT:
                return constant(factor.value, factor.off, self._axes, self._products)
            return values[a].scaled(factor.value, factor.off)
        if kind in (Kind.SINE, Kind.COSINE):
            return self._wave(a)[kind == Kind.COSINE]
        require(kind in (Kind.RECIPROCAL, Kind.ROOT), "an operation that is not bounded here")
        return reciprocal(values[a]) if kind == Kind.RECIPROCAL else root(values[a])

    def _wave(self, a: int) -> tuple[FirstOrder, FirstOrder]:
        """Sine and cosine of a value, found once."""
        if a not in self._waves:
            self._waves[a] = sine_and_cosine(self.values[a])
        return self._waves[a]

    def _loss(self, item: Instruction, value: FirstOrder, numbers: Numbers) -> Array:
        """Bounds of what an operation loses, of operands as they were computed."""
        if item.kind in (Kind.SINE, Kind.COSINE):
            return np.full_like(value.mid, numbers.sine)
        if item.kind not in (Kind.SCALE, Kind.CONSTANT):
            return np.asarray((numbers.unit * value.size + numbers.least) * _UP)
        factor = self._program.factors[item.target]
        off = factor.double if numbers.name == "double" else factor.single
        if item.kind == Kind.CONSTANT:
            return np.full_like(value.mid, off)
        size = self.values[item.a].size
        rounding = 0.0 if factor.exact else numbers.unit * (abs(factor.value) + factor.off + off) * size
        return np.asarray((off * size + rounding + numbers.least) * _UP)

    def _shares(self, item: Instruction, share: FirstOrder) -> list[tuple[int, FirstOrder]]:
        """What of a change of a value is due to its operands."""
        kind, a, b, values = item.kind, item.a, item.b, self.values
        if kind == Kind.MULTIPLY:
            return [(a, share * values[b]), (b, share * values[a])]
        if kind == Kind.ADD:
            return [(a, share), (b, share)]
        if kind == Kind.SUBTRACT:
            return [(a, share), (b, -share)]
        if kind == Kind.SCALE:
            factor = self._program.factors[item.target]
            return [(a, share.scaled(factor.value, factor.off))]
        if kind == Kind.CONSTANT:
            return []
        if kind == Kind.SINE:
            return [(a, share * self._wave(a)[1])]
        if kind == Kind.COSINE:
            return [(a, -(share * self._wave(a)[0]))]
        own = values[item.target]
        if kind == Kind.RECIPROCAL:
            return [(a, -(share * (own * own)))]
        return [(a, (share * reciprocal(own)).scaled(0.5, 0.0))]


def _add(shares: dict[int, FirstOrder], number: int, part: FirstOrder) -> None:
    shares[number] = shares[number] + part if number in shares else part
