"""Straight-line programs: a function written once with + − × sin cos and linear solves, then run over any numbers.

The dynamics are recorded on a `Tape` as an expression graph in which constants are exact rationals and vanish where
they are 0 or 1; repeated expressions are recorded once. A planar mechanism written with 3-vectors thus costs what a
planar one should. Constants that are no rationals (lengths of axes, angles of points) are recorded as what they are
made of; whoever runs the instructions computes them once, in his arithmetic (`ccpin.programs.folding`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from ccpin.programs.instructions import Code, Instruction, Kind, LinearSystem, ancestors

Expression = Any  # a Node, or a constant: int or Fraction


class Node:
    """A recorded value."""

    __slots__ = ("index", "tape")

    def __init__(self, tape: Tape, index: int) -> None:
        self.tape, self.index = tape, index

    def __add__(self, other: Expression) -> Expression:
        return self.tape.add(self, other)

    __radd__ = __add__

    def __sub__(self, other: Expression) -> Expression:
        return self.tape.subtract(self, other)

    def __rsub__(self, other: Expression) -> Expression:
        return self.tape.subtract(other, self)

    def __mul__(self, other: Expression) -> Expression:
        return self.tape.multiply(self, other)

    __rmul__ = __mul__

    def __neg__(self) -> Expression:
        return self.tape.multiply(self, -1)


class Tape:
    """The recorder. The first `inputs` nodes are the inputs."""

    def __init__(self, inputs: int) -> None:
        self.instructions: list[Instruction] = []
        self._known: dict[tuple[Any, ...], Node] = {}
        self.inputs = tuple(self._record(Kind.INPUT, k) for k in range(inputs))

    def node(self, value: Expression) -> Node:
        """The value as a node (a constant is recorded)."""
        return value if isinstance(value, Node) else self._record(Kind.CONSTANT, constant=Fraction(value))

    def add(self, a: Expression, b: Expression) -> Expression:
        """The sum a + b."""
        if is_zero(a):
            return b
        if is_zero(b):
            return a
        first, second = sorted((self.node(a).index, self.node(b).index))
        return self._record(Kind.ADD, first, second)

    def subtract(self, a: Expression, b: Expression) -> Expression:
        """The difference a − b."""
        if is_zero(b):
            return a
        if is_zero(a):
            return self.multiply(b, -1)
        return self._record(Kind.SUBTRACT, self.node(a).index, self.node(b).index)

    def multiply(self, a: Expression, b: Expression) -> Expression:
        """The product a b."""
        if not isinstance(a, Node):
            a, b = b, a
        if isinstance(b, Node):
            return self._record(Kind.MULTIPLY, *sorted((a.index, b.index)))
        if is_zero(b):
            return 0
        inner = self.instructions[a.index]
        if inner.kind == Kind.SCALE:
            a, b = Node(self, inner.a), inner.constant * b
        return a if b == 1 else self._record(Kind.SCALE, a.index, constant=Fraction(b))

    def sincos(self, a: Node) -> tuple[Node, Node]:
        """Sine and cosine of a node."""
        known = self._known.get((Kind.SINE, a.index))
        if known is not None:
            return known, Node(self, known.index + 1)
        sine = self._record(Kind.SINE, a.index, len(self.instructions) + 1)
        self._known[Kind.SINE, a.index] = sine
        return sine, self._record(Kind.COSINE, a.index, sine.index)

    def gain(self, cosine: Node, order: int = 0) -> Node:
        """A derivative of g(w) = 2 arccos(w)/√(1 − w²), analytic for w > −1 (`recording.ball_joints`)."""
        return self._record(Kind.GAIN, cosine.index, order)

    def root(self, a: Expression) -> Expression:
        """√a, exact where it is rational."""
        if isinstance(a, Node):
            return self._record(Kind.ROOT, a.index)
        square = Fraction(a)
        root = Fraction(math.isqrt(square.numerator), math.isqrt(square.denominator))
        return root if root * root == square else self._record(Kind.ROOT, self.node(square).index)

    def reciprocal(self, a: Expression) -> Expression:
        """1/a."""
        return self._record(Kind.RECIPROCAL, a.index) if isinstance(a, Node) else 1 / Fraction(a)

    def angle(self, sine: Expression, cosine: Expression) -> Node:
        """The angle of the point (cosine, sine), whose distance from the origin may be any, in (−π, π]."""
        return self._record(Kind.ANGLE, self.node(sine).index, self.node(cosine).index)

    def solve(self, matrix: Any, right: Any) -> Any:
        """A⁻¹B for A of shape (m, m): an array of nodes of B's shape (m, k)."""
        if not len(matrix):
            return np.zeros(np.shape(right), dtype=object)
        return self._solved(self._numbers(matrix), right)

    def derivative(
        self, expressions: Sequence[Expression], direction: dict[int, Expression], *, held: bool = True
    ) -> list[Expression]:
        """The derivative of expressions along a direction of the inputs, by input number.

        The entries of the direction are held fixed, and so are results of linear solves if they are to be `held`; else
        theirs is A⁻¹(∂B − ∂A X), with the matrix that is there.
        """
        slopes: dict[int, Any] = {}
        opaque = {Kind.SOLVE, Kind.PART} if held else set[int]()

        def operands(number: int) -> Sequence[int]:
            item = self.instructions[number]
            return () if item.kind in opaque else item.operands

        for number in sorted(ancestors([e.index for e in expressions if isinstance(e, Node)], operands)):
            item = self.instructions[number]
            slopes[number] = 0 if item.kind in opaque else self._slope(item, slopes, direction)
        return [slopes[e.index] if isinstance(e, Node) else 0 for e in expressions]

    def inlined(self, code: Code, arguments: Sequence[Expression]) -> list[Expression]:
        """The outputs of other instructions at expressions of this tape."""
        found: dict[int, Any] = dict(enumerate(arguments))
        for item in code.instructions:
            self.copied(item, found)
        return [found[number] for number in code.outputs]

    def code(self, outputs: Sequence[Expression], also: Sequence[Expression] = ()) -> Code:
        """The instructions that outputs need, and those of values that are `also` to exist."""
        numbers = tuple(self.node(output).index for output in outputs)
        asked = [*numbers, *(self.node(value).index for value in also)]
        needed = ancestors(asked, lambda number: self.instructions[number].operands)
        kept = tuple(item for item in self.instructions if item.target in needed and item.kind != Kind.INPUT)
        return Code(len(self.instructions), len(self.inputs), kept, numbers)

    def _slope(self, item: Instruction, slopes: dict[int, Any], direction: dict[int, Expression]) -> Any:
        if item.kind == Kind.INPUT:
            return direction.get(item.target, 0)
        if item.kind == Kind.CONSTANT:
            return 0
        if item.kind == Kind.SOLVE:
            return self._solution_slope(item, slopes)
        if item.kind == Kind.PART:
            return slopes[item.a][item.b]
        a = Node(self, item.a)
        if item.kind == Kind.ADD:
            return slopes[item.a] + slopes[item.b]
        if item.kind == Kind.SUBTRACT:
            return slopes[item.a] - slopes[item.b]
        if item.kind == Kind.MULTIPLY:
            return slopes[item.a] * Node(self, item.b) + slopes[item.b] * a
        if item.kind == Kind.SCALE:
            return slopes[item.a] * item.constant
        if is_zero(slopes[item.a]) and (item.kind != Kind.ANGLE or is_zero(slopes[item.b])):
            return 0
        if item.kind == Kind.GAIN:
            return slopes[item.a] * self.gain(a, item.b + 1)
        if item.kind == Kind.SINE:
            return slopes[item.a] * Node(self, item.b)
        if item.kind == Kind.COSINE:
            return slopes[item.a] * Node(self, item.b) * -1
        own = Node(self, item.target)
        if item.kind == Kind.ROOT:
            return slopes[item.a] * self.reciprocal(own) * Fraction(1, 2)
        if item.kind == Kind.RECIPROCAL:
            return slopes[item.a] * (own * own) * -1
        b = Node(self, item.b)
        return (slopes[item.a] * b - slopes[item.b] * a) * self.reciprocal(a * a + b * b)

    def _solution_slope(self, item: Instruction, slopes: dict[int, Any]) -> list[Expression]:
        """A⁻¹(∂B − ∂A X), row by row."""
        m, k = len(item.b.right), len(item.b.right[0])
        solution = np.array([self._record(Kind.PART, item.target, place) for place in range(m * k)], dtype=object)
        matrix, right = (
            np.array([[slopes[number] for number in row] for row in part], dtype=object) for part in item.b
        )
        change = right - matrix @ solution.reshape(m, k)
        moving = [column for column in range(k) if not all(map(is_zero, change[:, column]))]
        found = np.zeros((m, k), dtype=object)
        if moving:
            found[:, moving] = self._solved(item.b.matrix, change[:, moving])
        return found.ravel().tolist()

    def copied(self, item: Instruction, found: dict[int, Any]) -> None:
        """Record an instruction of other instructions, whose values so far are found here."""
        kind, target, a, b, constant = item
        if kind == Kind.CONSTANT:
            found[target] = constant
        elif kind == Kind.ADD:
            found[target] = found[a] + found[b]
        elif kind == Kind.SUBTRACT:
            found[target] = found[a] - found[b]
        elif kind == Kind.MULTIPLY:
            found[target] = found[a] * found[b]
        elif kind == Kind.SCALE:
            found[target] = found[a] * constant
        elif kind in (Kind.SINE, Kind.COSINE):
            found[target] = self.sincos(self.node(found[a]))[kind == Kind.COSINE]
        elif kind == Kind.GAIN:
            found[target] = self.gain(self.node(found[a]), b)
        elif kind == Kind.ROOT:
            found[target] = self.root(found[a])
        elif kind == Kind.RECIPROCAL:
            found[target] = self.reciprocal(found[a])
        elif kind == Kind.ANGLE:
            found[target] = self.angle(found[a], found[b])
        elif kind == Kind.SOLVE:
            matrix, right = ([[found[number] for number in row] for row in table] for table in b)
            found[target] = self.solve(matrix, right).ravel()
        else:
            found[target] = found[a][b]

    def _solved(self, matrix: tuple[tuple[int, ...], ...], right: Any) -> Any:
        head = self._record(Kind.SOLVE, b=LinearSystem(matrix, self._numbers(right)))
        parts = [self._record(Kind.PART, head.index, place) for place in range(np.size(right))]
        return np.array(parts, dtype=object).reshape(np.shape(right))

    def _numbers(self, table: Sequence[Sequence[Expression]]) -> tuple[tuple[int, ...], ...]:
        return tuple(tuple(self.node(entry).index for entry in row) for row in table)

    def _record(self, kind: int, a: Any = None, b: Any = None, constant: Any = None) -> Node:
        key = (kind, a, b, constant)
        shareable = kind not in (Kind.SINE, Kind.COSINE, Kind.INPUT)
        if shareable and key in self._known:
            return self._known[key]
        node = Node(self, len(self.instructions))
        self.instructions.append(Instruction(kind, node.index, a, b, constant))
        if shareable:
            self._known[key] = node
        return node


def is_zero(value: Expression) -> bool:
    """Whether an expression is the constant 0, exactly."""
    return not isinstance(value, Node) and bool(value == 0)
