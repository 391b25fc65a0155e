"""Straight-line programs: instructions over numbered values, whose constants are exact.

`ccpin.programs.tape` records them; each arithmetic in which they are run (doubles, balls, C, …) says what they compute.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple


class Kind:
    """Codes of kinds of instructions."""

    INPUT, CONSTANT, ADD, SUBTRACT, MULTIPLY, SCALE, SINE, COSINE, SOLVE, PART, GAIN = range(11)
    ROOT, RECIPROCAL, ANGLE = range(11, 14)  # √a, 1/a, and the angle of the point (b, a) as atan2(a, b) has it


class Instruction(NamedTuple):
    """One operation of a program.

    Attributes:
        kind: One of `Kind`.
        target: The number of the value it defines (for SOLVE: of nothing; its PARTs define the values).
        a, b: Numbers of its operands: SINE and COSINE know each other by b where both are sure to be there; PART is
            column b of a row-major solution of SOLVE a; SOLVE keeps a `LinearSystem` in b, GAIN its order.
        constant: The factor of SCALE, the value of CONSTANT.
    """

    kind: int
    target: int
    a: Any = None
    b: Any = None
    constant: Any = None

    @property
    def operands(self) -> Sequence[int]:
        """The numbers of the values it computes with."""
        if self.kind in (Kind.INPUT, Kind.CONSTANT):
            return ()
        if self.kind == Kind.SOLVE:
            return [number for table in self.b for row in table for number in row]
        if self.kind in (Kind.SCALE, Kind.PART, Kind.GAIN, Kind.ROOT, Kind.RECIPROCAL) or self.b is None:
            return (self.a,)
        return (self.a, self.b)


class LinearSystem(NamedTuple):
    """A z = B with numbers of values as entries; A of shape (m, m), B of shape (m, k)."""

    matrix: tuple[tuple[int, ...], ...]
    right: tuple[tuple[int, ...], ...]


class Code(NamedTuple):
    """Instructions in an order in which they can be run.

    Attributes:
        size: How many values there are.
        inputs: How many inputs there are; they are values 0, 1, ….
        instructions: All that the outputs need.
        outputs: Numbers of the output values.
    """

    size: int
    inputs: int
    instructions: tuple[Instruction, ...]
    outputs: tuple[int, ...]

    @property
    def read(self) -> set[int]:
        """Numbers of all values that are operands or outputs."""
        return {number for item in self.instructions for number in item.operands} | set(self.outputs)


def ancestors(stack: list[int], operands: Callable[[int], Sequence[int]]) -> set[int]:
    """Numbers of values and of all that they depend on, by what each is computed of."""
    found = set[int]()
    while stack:
        number = stack.pop()
        if number not in found:
            found.add(number)
            stack.extend(operands(number))
    return found
