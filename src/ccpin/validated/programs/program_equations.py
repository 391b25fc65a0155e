"""What claims about programs are about: the equations of σ and a program, put together of numbers that cannot change.

Whether they are a mechanism's is not asked here: theorems are about these instructions. The program is put together
here once more, so that it is known which of its values are y after each Newton step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ccpin.programs.evaluation import value_of
from ccpin.programs.folding import DOUBLES, Arithmetic, folded
from ccpin.programs.instructions import ANGLE, CONSTANT, COSINE, GAIN, MULTIPLY, SCALE, SINE, Code
from ccpin.programs.program_sources import Assembled, ProgramSource, assembled, bend_of, slopes_of
from ccpin.proof.digests import digest
from ccpin.proof.facts import NotProvedError, known, require
from ccpin.validated.arithmetic.balls import ball, flint, upper

PRECISION = 128  # bits, in which constants are enclosed


class EnclosedConstant(NamedTuple):
    """A constant of a program.

    Attributes:
        value, off: It is at most `off` from a double.
        double, single: How far a number is from it at most that a program in double, or in float, has for it.
        exact: Whether it is ± a power of two, a product with which is not rounded.
    """

    value: float
    off: float
    double: float
    single: float
    exact: bool


class Runnable(NamedTuple):
    """A program without instructions over constants alone.

    Attributes:
        code: The instructions.
        factors: The constants of CONSTANT and SCALE, by the number of the value.
    """

    code: Code
    factors: Mapping[int, EnclosedConstant]


@known
@dataclass(frozen=True, eq=False)
class ProgramEquations:
    """φ(q, y) = 0 and a program of (q, y, …).

    Attributes:
        source: What both are made of.
    """

    source: ProgramSource

    def __post_init__(self) -> None:
        source = self.source
        require(type(source) is ProgramSource, "no source of a program")
        require([type(code) is Code for code in (source.closure, source.inner)], "no instructions")
        sizes = (*source.sizes, source.steps, *source.independent, *(size for _, size in source.ports))
        require([type(k) is int and k >= 0 for k in sizes], "sizes and places that are none")
        parts = (source.independent, source.sizes, source.ports, source.samples, *source.ports, *source.samples)
        require([type(part) is tuple for part in parts], "what could be changed")
        require(len(source.sizes) == 5 and source.sizes[4] == 0, "constants that are inputs")
        due = dict(zip("vua", source.sizes[1:4], strict=True)) | {"q": len(source.independent), "y": self.n_y}
        require([due.get(name) == size for name, size in source.ports], "inputs of other sizes")
        require([name for name, _ in source.ports][:2] == ["q", "y"], "inputs in another order")
        require(len(set(source.independent) & set(range(source.sizes[0]))) == len(source.independent), "a place twice")
        require(len(source.closure.outputs) == self.n_y, "as many equations as numbers that depend")
        require(source.closure.inputs == source.inner.inputs == sum(source.sizes), "programs of other inputs")
        read = {number for item in source.closure.instructions for number in item.operands}
        read |= set(source.closure.outputs)
        require(read.isdisjoint(range(source.sizes[0], source.closure.inputs)), "equations that read more than x")
        for code in (source.closure, source.inner):
            _require_instructions(code)
        require(len(self.made.code.outputs) == len(source.inner.outputs), "no program")

    @cached_property
    def made(self) -> Assembled:
        """The program, put together.

        Raises:
            NotProvedError: It cannot be.
        """
        try:
            return assembled(self.source)
        except (ArithmeticError, ValueError, TypeError, LookupError, AttributeError) as error:
            raise NotProvedError(f"no program: {error}") from None

    def __reduce__(self) -> tuple[type[ProgramEquations], tuple[ProgramSource]]:
        return ProgramEquations, (self.source,)

    @property
    def n_y(self) -> int:
        """How many numbers depend."""
        return self.source.sizes[0] - len(self.source.independent)

    @cached_property
    def sizes(self) -> Mapping[str, int]:
        """Q, Y: of q and y; W: of all other inputs; P: pivots."""
        rest = sum(size for _, size in self.source.ports[2:])
        return {"Q": len(self.source.independent), "Y": self.n_y, "W": rest, "P": len(self.made.pivots)}

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all instructions and constants."""
        return digest((repr(self.source),))

    @cached_property
    def program(self) -> Runnable:
        """The program, its last corrections after its outputs."""
        outputs = (*self.made.code.outputs, *self.made.corrections)
        return runnable(self.made.code._replace(outputs=outputs))

    @cached_property
    def closure(self) -> Runnable:
        """φ."""
        return runnable(self.source.closure)

    @cached_property
    def slopes(self) -> Runnable:
        """φ_y, row by row."""
        return runnable(slopes_of(self.source.closure, self.source.dependent))

    @cached_property
    def bend(self) -> Runnable:
        """φ_yy η, row by row; η are further inputs."""
        return runnable(bend_of(self.source.closure, self.source.dependent))


def _require_instructions(code: Code) -> None:
    """Every operand is an input or defined before, every constant a rational.

    Raises:
        NotProvedError: One is not.
    """
    require(type(code.instructions) is tuple and type(code.outputs) is tuple, "instructions that could be changed")
    there = set(range(code.inputs))
    for item in code.instructions:
        require(type(item.target) is int and item.target not in there and item.target < code.size, "a value twice")
        operands = (item.a,) if item.kind in (SINE, COSINE) else item.operands
        require(there.issuperset(operands), "an operand that is not there")
        require(item.kind not in (GAIN, ANGLE), "an operation that is not bounded here: turns of balls")
        constant = item.kind in (CONSTANT, SCALE)
        require(type(item.constant) is Fraction if constant else item.constant is None, "a constant that is none")
        there.add(item.target)
    require(there.issuperset(code.outputs), "an output that is not there")


def runnable(code: Code) -> Runnable:
    """A program with constants enclosed."""
    with flint().ctx.workprec(PRECISION):
        arb = flint().arb
        exact = folded(code, Arithmetic(ball, arb.sqrt, lambda a: 1 / a, arb.atan2))
        compiled = folded(code, DOUBLES)
        plain = _numpy_constants(code)
        factors = dict[int, EnclosedConstant]()
        for item, told in zip(exact.instructions, compiled.instructions, strict=True):
            if item.kind in (CONSTANT, SCALE):
                factors[item.target] = _factor(item.constant, float(told.constant), plain.get(item.target))
    return Runnable(exact, factors)


def _factor(constant: Any, compiled: float, plain: float | None) -> EnclosedConstant:
    """A constant of which a compiled program and NumPy have doubles."""
    value = float(constant.mid())
    doubles = [compiled] if plain is None else [compiled, plain]
    off, double, single = (
        _distance(constant, numbers) for numbers in ([value], doubles, [float(np.float32(compiled))])
    )
    power = off == 0.0 and double == 0.0 and abs(math.frexp(value)[0]) == 0.5
    return EnclosedConstant(value, off, double, single, power)


def _distance(constant: Any, numbers: Iterable[float]) -> float:
    """How far numbers are from a ball's at most; 0 where they are all the same."""
    far = [abs(constant - ball(number)) for number in numbers]
    return 0.0 if all(x == 0 for x in far) else max(map(upper, far))


def _numpy_constants(code: Code) -> dict[int, float]:
    """What NumPy has for constants, and for factors of products with one."""
    values, found = list[Any]([None] * code.size), dict[int, float]()
    for item in code.instructions:
        if item.kind == CONSTANT or (item.operands and all(values[number] is not None for number in item.operands)):
            values[item.target] = value_of(item, values, np)
            found[item.target] = float(values[item.target])
        elif item.kind == SCALE:
            found[item.target] = float(item.constant)
        elif item.kind == MULTIPLY and (values[item.a] is not None or values[item.b] is not None):
            found[item.target] = float(values[item.a if values[item.a] is not None else item.b])
    return found
