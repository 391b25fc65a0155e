"""Negations carried along to where they cost nothing: (−a) b = −(a b), a + (−b) = a − b, 1/(−a) = −1/a.

All these are exact in every arithmetic that rounds to both sides alike, so that results stay the same numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ccpin.programs.instructions import Code, Instruction, Kind


class _Signed(NamedTuple):
    """A value as another one, negated where `minus` is true."""

    minus: bool
    number: int


def unsigned(code: Code, kept: Sequence[int] = ()) -> tuple[Code, tuple[int, ...]]:
    """The same outputs with as few negations as there can be, without linear solves.

    Args:
        code: The instructions.
        kept: Numbers of values whose size is asked for besides the outputs.

    Returns:
        The code, whose values are numbered in order, and the numbers in it of the values kept, up to their signs.
    """
    reader = _Reader(code)
    outputs = tuple(reader.plain(reader.found[number]) for number in code.outputs)
    numbers = tuple(reader.found[number].number for number in kept)
    size = code.inputs + len(reader.instructions)
    return Code(size, code.inputs, tuple(reader.instructions), outputs), numbers


class _Reader:
    """Instructions read in order, and what has become of their values."""

    def __init__(self, code: Code) -> None:
        self.found = {k: _Signed(False, k) for k in range(code.inputs)}
        self.instructions: list[Instruction] = []
        self._known: dict[tuple[object, ...], int] = {}
        self._next = code.inputs
        for item in code.instructions:
            self.found[item.target] = self._read(item)

    def plain(self, value: _Signed) -> int:
        """The number of a value with its sign."""
        return self._value(Kind.SCALE, value.number, constant=-1) if value.minus else value.number

    def _read(self, item: Instruction) -> _Signed:
        kind = item.kind
        if kind in (Kind.ADD, Kind.SUBTRACT):
            a, b = self.found[item.a], self.found[item.b]
            return self._sum(a, b if kind == Kind.ADD else b._replace(minus=not b.minus))
        if kind == Kind.MULTIPLY:
            a, b = self.found[item.a], self.found[item.b]
            return _Signed(a.minus != b.minus, self._value(Kind.MULTIPLY, *sorted((a.number, b.number))))
        if kind == Kind.SCALE:
            a, size = self.found[item.a], abs(item.constant)
            number = a.number if size == 1 else self._value(Kind.SCALE, a.number, constant=size)
            return _Signed(a.minus != (item.constant < 0), number)
        if kind == Kind.RECIPROCAL:
            a = self.found[item.a]
            return _Signed(a.minus, self._value(Kind.RECIPROCAL, a.number))
        if kind == Kind.CONSTANT:
            return _Signed(False, self._value(Kind.CONSTANT, constant=item.constant))
        first = self.plain(self.found[item.a])
        second = self.plain(self.found[item.b]) if kind == Kind.ANGLE else item.b if kind == Kind.GAIN else None
        return _Signed(False, self._value(kind, first, second))

    def _sum(self, a: _Signed, b: _Signed) -> _Signed:
        if a.minus == b.minus:
            return _Signed(a.minus, self._value(Kind.ADD, *sorted((a.number, b.number))))
        if (Kind.SUBTRACT, b.number, a.number, None) in self._known:
            return _Signed(not a.minus, self._value(Kind.SUBTRACT, b.number, a.number))
        if a.minus:
            return _Signed(False, self._value(Kind.SUBTRACT, b.number, a.number))
        return _Signed(False, self._value(Kind.SUBTRACT, a.number, b.number))

    def _value(self, kind: int, a: int | None = None, b: int | None = None, constant: object = None) -> int:
        key = (kind, a, b, constant)
        if key not in self._known:
            self._known[key] = self._next
            self.instructions.append(Instruction(kind, self._next, a, b, constant))
            self._next += 1
        return self._known[key]
