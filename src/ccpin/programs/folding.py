"""What a program computes of constants alone, computed once in the arithmetic in which it will be run."""

from __future__ import annotations

import math
from collections.abc import Callable
from fractions import Fraction
from operator import add, mul, sub
from typing import Any, NamedTuple

from ccpin.programs.instructions import Code, Instruction, Kind


class Arithmetic(NamedTuple):
    """Numbers of a kind.

    Attributes:
        number: The number of that kind that stands for a rational.
        root, reciprocal: √a and 1/a.
        angle: The angle of the point (b, a).
    """

    number: Callable[[Fraction], Any]
    root: Callable[[Any], Any]
    reciprocal: Callable[[Any], Any]
    angle: Callable[[Any, Any], Any]


DOUBLES = Arithmetic(lambda value: value, math.sqrt, lambda a: 1 / a, math.atan2)  # rationals stay exact till the end


def folded(code: Code, arithmetic: Arithmetic) -> Code:
    """The same code with constants of that arithmetic, and without instructions over constants alone.

    A product with a constant becomes a SCALE. Values keep their numbers.
    """
    does: dict[int, Callable[..., Any]] = {Kind.ADD: add, Kind.SUBTRACT: sub, Kind.MULTIPLY: mul}
    does |= {Kind.ROOT: arithmetic.root, Kind.RECIPROCAL: arithmetic.reciprocal, Kind.ANGLE: arithmetic.angle}
    constants, found = dict[int, Any](), list[Instruction]()
    for item in code.instructions:
        kind, target, a, b, constant = item
        if kind == Kind.CONSTANT:
            constants[target] = arithmetic.number(constant)
        elif kind == Kind.SCALE and a in constants:
            constants[target] = arithmetic.number(constant) * constants[a]
        elif kind in does and all(number in constants for number in item.operands):
            constants[target] = does[kind](*(constants[number] for number in item.operands))
        elif kind == Kind.MULTIPLY and (a in constants or b in constants):
            factor, other = (a, b) if a in constants else (b, a)
            found.append(Instruction(Kind.SCALE, target, other, None, constants[factor]))
        elif kind == Kind.SCALE:
            found.append(item._replace(constant=arithmetic.number(constant)))
        else:
            found.append(item)
    used = {*code.outputs, *(number for item in found for number in item.operands)}
    kept = [Instruction(Kind.CONSTANT, number, constant=value) for number, value in constants.items() if number in used]
    return code._replace(instructions=(*kept, *found))
