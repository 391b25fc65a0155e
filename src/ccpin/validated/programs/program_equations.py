"""What claims about programs are about: the equations of σ and a program, put together of numbers that cannot change.

σ is a function of q, and of constants p of the mechanism where these are inputs: what theorems call q is (q, p) then.

Whether they are a mechanism's is not asked here: theorems are about these instructions. The program is put together
here once more, so that it is known which of its values are y after each Newton step.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ccpin.programs.evaluation import value_of
from ccpin.programs.folding import DOUBLES, Arithmetic, folded
from ccpin.programs.instructions import Code, Kind
from ccpin.programs.program_sources import INPUTS, Assembled, ProgramSource, assembled, bend_of, slopes_of
from ccpin.proof.digests import digest
from ccpin.proof.facts import NotProvedError, known, require
from ccpin.validated.arithmetic.balls import ball, flint, upper

T = TypeVar("T")
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
    """φ(q, p, y) = 0 and a program of (q, y, …, p, …).

    Attributes:
        source: What both are made of.
    """

    source: ProgramSource

    def __post_init__(self) -> None:
        source = self.source
        require(type(source) is ProgramSource, "no source of a program")
        require([type(code) is Code for code in (source.closure, source.inner)], "no instructions")
        sizes = (*source.sizes, source.steps, source.checked, *source.independent, *(size for _, size in source.ports))
        require([type(k) is int and k >= 0 for k in sizes], "sizes and places that are none")
        parts = (source.independent, source.sizes, source.ports, source.samples, *source.ports, *source.samples)
        require([type(part) is tuple for part in parts], "what could be changed")
        require(len(source.sizes) in (5, 6, 1 + len(INPUTS)), "sizes of too few or too many")
        due = dict(zip(INPUTS, source.sizes[1:], strict=False)) | {"q": len(source.independent), "y": self.n_y}
        require([due.get(name) == size for name, size in source.ports], "inputs of other sizes")
        names = [name for name, _ in source.ports]
        require(names[:2] == ["q", "y"] and len(set(names)) == len(names), "inputs in another order, or twice")
        require(source.sizes[4] == 0 or "p" in names, "constants that are no inputs")
        last = (0, self.n_y) if source.steps == 0 else (0,)
        require(source.checked in last, "corrections that are none")
        require(len(set(source.independent) & set(range(source.sizes[0]))) == len(source.independent), "a place twice")
        require(len(source.closure.outputs) == self.n_y, "as many equations as numbers that depend")
        require(source.closure.inputs == source.inner.inputs == sum(source.sizes), "programs of other inputs")
        read = {number for item in source.closure.instructions for number in item.operands}
        read |= set(source.closure.outputs)
        others = set(range(source.sizes[0], source.closure.inputs)) - set(self.places)
        require(read.isdisjoint(others), "equations that read more than x and p")
        for code in (source.closure, source.inner):
            _require_instructions(code)
        require(len(self.made.code.outputs) == len(source.inner.outputs) - source.checked, "no program")

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

    @property
    def places(self) -> tuple[int, ...]:
        """Where q, and p after it, stand among the inputs of φ."""
        first = sum(self.source.sizes[:4])
        return (*self.source.independent, *range(first, first + self.source.sizes[4]))

    def arranged(self, q: Sequence[T], y: Sequence[T], others: Sequence[T]) -> list[T]:
        """(q, p), y and all others in the order of the program's inputs."""
        count = len(self.source.independent)
        own, rest = {"q": q[:count], "y": y, "p": q[count:]}, iter(others)
        return [
            entry
            for name, size in self.source.ports
            for entry in (own[name] if name in own else [next(rest) for _ in range(size)])
        ]

    def apart(self, numbers: Sequence[T]) -> tuple[list[T], list[T], list[T]]:
        """Inputs of the program, in its order, as (q, p), y and all others."""
        found = dict[str, list[T]]()
        entries = iter(numbers)
        for name, size in self.source.ports:
            found[name] = [next(entries) for _ in range(size)]
        first = found.pop("q") + found.pop("p", [])
        return first, found.pop("y"), [entry for part in found.values() for entry in part]

    @cached_property
    def sizes(self) -> Mapping[str, int]:
        """Q, Y: of (q, p) and y; W: of all other inputs; P: pivots."""
        rest = sum(size for name, size in self.source.ports if name not in ("q", "y", "p"))
        return {"Q": len(self.places), "Y": self.n_y, "W": rest, "P": len(self.made.pivots)}

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
        operands = (item.a,) if item.kind in (Kind.SINE, Kind.COSINE) else item.operands
        require(there.issuperset(operands), "an operand that is not there")
        require(
            item.kind not in (Kind.GAIN, Kind.ANGLE),
            "an operation without bounds here: how far a ball, or a law's joint, is turned",
        )
        constant = item.kind in (Kind.CONSTANT, Kind.SCALE)
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
            if item.kind in (Kind.CONSTANT, Kind.SCALE):
                factors[item.target] = _factor(item.constant, float(told.constant), plain.get(item.target))
    return Runnable(exact, factors)


def _factor(constant: Any, compiled: float, plain: float | None) -> EnclosedConstant:
    """A constant of which a compiled program and NumPy have doubles."""
    value = float(constant.mid())
    doubles = [compiled] if plain is None else [compiled, plain]
    off, double, single = (
        _distance(constant, numbers) for numbers in ([value], doubles, [float(np.float32(compiled))])
    )
    power = double == 0.0 and abs(math.frexp(value)[0]) == 0.5  # then it is a double, value
    return EnclosedConstant(value, off, double, single, power)


def _distance(constant: Any, numbers: Iterable[float]) -> float:
    """How far numbers are from a ball's at most; 0 where they are all the same."""
    far = [abs(constant - ball(number)) for number in numbers]
    return 0.0 if all(x == 0 for x in far) else max(map(upper, far))


def _numpy_constants(code: Code) -> dict[int, float]:
    """What NumPy has for constants, and for factors of products with one."""
    values, found = list[Any]([None] * code.size), dict[int, float]()
    for item in code.instructions:
        if all(values[number] is not None for number in item.operands):  # CONSTANT has none
            values[item.target] = value_of(item, values, np)
            found[item.target] = float(values[item.target])
        elif item.kind == Kind.SCALE:
            found[item.target] = float(item.constant)
        elif item.kind == Kind.MULTIPLY and (values[item.a] is not None or values[item.b] is not None):
            found[item.target] = float(values[item.a if values[item.a] is not None else item.b])
    return found
