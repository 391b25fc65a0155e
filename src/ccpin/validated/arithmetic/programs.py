"""Recorded programs in balls: their constants, and which are programs at all.

`ccpin.programs.tape` records them; `ccpin.validated.arithmetic.series` says what they compute.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ccpin.programs.folding import Arithmetic, folded
from ccpin.programs.instructions import Code, Instruction, Kind, LinearSystem
from ccpin.programs.tape import Expression, Tape
from ccpin.proof.facts import NotProvedError
from ccpin.validated.arithmetic.balls import Ball, ball, flint


def in_balls(tape: Tape, outputs: Sequence[Expression], also: Sequence[Expression] = ()) -> Code:
    """What outputs need (and values that are `also` to exist), with constants as balls at the current precision."""
    arb = flint().arb
    return folded(tape.code(outputs, also), Arithmetic(ball, arb.sqrt, lambda x: 1 / x, arb.atan2))


def constant(tape: Tape, value: Expression) -> Ball:
    """The ball of an expression of constants alone."""
    (item,) = in_balls(tape, [value]).instructions
    return item.constant


def require_program(program: Any, inputs: int) -> None:
    """That a program is one of so many inputs, which nothing can change, and whose constants are finite balls.

    Every operand is an input or a value defined before; a sine and a cosine that know each other are of one value.

    Raises:
        NotProvedError: It is none.
    """
    _require(type(program) is Code and program.inputs == inputs, "no program of this many inputs")
    _require(type(program.instructions) is tuple and type(program.outputs) is tuple, "a program that could be changed")
    entries: dict[int, int] = {}  # of each SOLVE: how many it has
    values, waves = set(range(inputs)), dict[tuple[int, int], tuple[int, int]]()
    for item in program.instructions:
        _require(type(item) is Instruction, "what is no instruction")
        kind, target, a, b, constant = item
        new = type(target) is int and inputs <= target < program.size and not {target} & (values | entries.keys())
        _require(new, "a value that is defined twice, or out of its range")
        if kind in (Kind.ADD, Kind.SUBTRACT, Kind.MULTIPLY):
            _require(_all_known((a, b), values), "an operand that is not there")
        elif kind in (Kind.SCALE, Kind.CONSTANT):
            _require(
                is_number(constant) and (kind == Kind.CONSTANT or _all_known((a,), values)), "a constant that is none"
            )
        elif kind in (Kind.SINE, Kind.COSINE):
            _require(_all_known((a,), values), "an operand that is not there")
            waves[kind, target] = a, b
        elif kind == Kind.GAIN:
            _require(_all_known((a,), values) and type(b) is int and b >= 0, "no derivative")
        elif kind == Kind.PART:
            _require(type(a) is int and type(b) is int and 0 <= b < entries.get(a, 0), "no part of a solution")
        else:
            _require(kind == Kind.SOLVE and type(b) is LinearSystem, "no instruction that is known")
            entries[target] = _entries(b, values)
            continue
        values.add(target)
    for (kind, target), (a, b) in waves.items():
        _require(waves.get((Kind.SINE + Kind.COSINE - kind, b)) == (a, target), "a sine without its cosine")
    _require(_all_known(program.outputs, values), "an output that is not there")


def _require(holds: bool, otherwise: str) -> None:
    """`ccpin.proof.facts.require` of one thing, thousands of times.

    Raises:
        NotProvedError: It does not hold.
    """
    if not holds:
        raise NotProvedError(otherwise)


def is_number(value: Any) -> bool:
    """Whether it is a finite ball."""
    return type(value) is flint().arb and bool(value.is_finite())


def _all_known(numbers: tuple[Any, ...], values: set[int]) -> bool:
    return all(type(k) is int and k in values for k in numbers)


def _entries(system: LinearSystem, values: set[int]) -> int:
    """How many unknowns a linear system has.

    Raises:
        NotProvedError: It is none.
    """
    m, columns = len(system.matrix), {len(row) for row in system.right}
    rows = (*system.matrix, *system.right)
    _require({len(row) for row in system.matrix} == {m} == {len(system.right)}, "no square matrix")
    _require(len(columns) == 1 and {type(part) for part in (*system, *rows)} == {tuple}, "no table")
    _require(all(_all_known(row, values) for row in rows), "an entry that is not there")
    return m * columns.pop()


def words(value: Any) -> Any:
    """Programs, balls and tuples of them as tuples of whole numbers and words, for digests."""
    if type(value) is flint().arb:
        return tuple((int(man), int(exp)) for man, exp in (value.mid().man_exp(), value.rad().man_exp()))
    return tuple(map(words, value)) if isinstance(value, tuple) else value
