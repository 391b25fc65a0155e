"""Linear solves written out: elimination in a fixed order of pivots, so that a program is arithmetic alone.

Pivots are taken by Markowitz's count, fewest products first, among those that were never small beside their column at
the samples; entries that are 0 by structure cost nothing, so that loops which share no joint are solved apart. A
symmetric matrix is taken apart as LDLᵀ. Every matrix is eliminated once, whatever it solves for.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.programs.evaluation import value_of
from ccpin.programs.instructions import Code, Kind
from ccpin.programs.signs import unsigned
from ccpin.programs.tape import Expression, Node, Tape, is_zero

_SMALL = 0.02  # of its column's largest entry at a sample: such a pivot is taken only where there is no other


class Pivot(NamedTuple):
    """A value that a program divides by.

    Attributes:
        number: The value.
        scale: Its size at the samples, the geometric mean.
    """

    number: int
    scale: float


class Lowered(NamedTuple):
    """Instructions without linear solves, and what they divide by for them."""

    code: Code
    pivots: tuple[Pivot, ...]


class SampledTape(Tape):
    """A tape that knows all its values at samples of its inputs.

    Args:
        samples: Of shape (N, inputs).
    """

    def __init__(self, samples: Array) -> None:
        self.values: list[Array] = [*np.ascontiguousarray(samples.T)]
        super().__init__(samples.shape[1])

    def size(self, expression: Expression) -> Array:
        """The absolute value at the samples."""
        return np.abs(self.values[expression.index] if isinstance(expression, Node) else np.float64(expression))

    def _record(self, kind: int, a: Any = None, b: Any = None, constant: Any = None) -> Node:
        node = super()._record(kind, a, b, constant)
        if node.index == len(self.values):
            self.values.append(value_of(self.instructions[node.index], self.values, np))
        return node


def lowered(code: Code, samples: Array) -> Lowered:
    """The same outputs without linear solves; `samples` of the inputs, of shape (N, inputs), choose the pivots."""
    tape = SampledTape(samples)
    found: dict[int, Any] = dict(enumerate(tape.inputs))
    eliminations: dict[tuple[tuple[int, ...], ...], _Elimination] = {}
    for item in code.instructions:
        if item.kind == Kind.SOLVE:
            matrix = item.b.matrix
            if matrix not in eliminations:
                eliminations[matrix] = _Elimination(tape, [[found[number] for number in row] for row in matrix])
            right = [[found[number] for number in row] for row in item.b.right]
            found[item.target] = [entry for row in eliminations[matrix].solution(right) for entry in row]
        elif item.kind == Kind.PART:
            found[item.target] = found[item.a][item.b]
        else:
            tape.copied(item, found)
    written = tape.code([found[number] for number in code.outputs])
    used = {item.target for item in written.instructions} | set(range(code.inputs))
    pivots = [pivot for each in eliminations.values() for pivot in each.pivots if pivot.number in used]
    done, numbers = unsigned(written, [pivot.number for pivot in pivots])
    scales = {number: pivot.scale for number, pivot in zip(numbers, pivots, strict=True)}
    return Lowered(done, tuple(Pivot(number, scale) for number, scale in scales.items()))


class _Elimination:
    """L, U and the order of pivots of a matrix of expressions."""

    def __init__(self, tape: SampledTape, matrix: list[list[Expression]]) -> None:
        self._tape = tape
        self.pivots: list[Pivot] = []
        m = len(matrix)
        self._rows = [list(row) for row in matrix]
        self._symmetric = all(_same(matrix[r][c], matrix[c][r]) for r in range(m) for c in range(r))
        self._steps: list[tuple[int, int, Expression, list[tuple[int, Expression]]]] = []
        left, over = set(range(m)), set(range(m))
        while left:
            row, column = self._next(left, over)
            self._eliminate(row, column, left, over)

    def solution(self, right: list[list[Expression]]) -> list[list[Expression]]:
        """A⁻¹B, of B's shape."""
        tape, B = self._tape, [list(row) for row in right]
        columns = range(len(B[0]))
        for row, _, _, factors in self._steps:
            for other, factor in factors:
                B[other] = [B[other][k] - factor * B[row][k] for k in columns]
        found: list[list[Expression]] = [[0] * len(B[0]) for _ in B]
        done = list[int]()
        for row, column, inverse, _ in reversed(self._steps):
            for k in columns:
                value = B[row][k]
                for other in done:
                    value = value - self._rows[row][other] * found[other][k]
                found[column][k] = tape.multiply(inverse, value) if isinstance(inverse, Node) else value * inverse
            done.append(column)
        return found

    def _next(self, left: set[int], over: set[int]) -> tuple[int, int]:
        """The row and column of the next pivot."""
        rows = {r: [c for c in over if not is_zero(self._rows[r][c])] for r in left}
        columns = {c: [r for r in left if not is_zero(self._rows[r][c])] for c in over}
        best: tuple[tuple[float, ...], int, int] | None = None
        for column, among in columns.items():
            if not among:
                raise ZeroDivisionError("a matrix is singular by structure")
            sizes = np.array(
                [np.broadcast_to(self._tape.size(self._rows[r][column]), self._tape.values[0].shape) for r in among]
            )
            relative = (sizes / np.maximum(sizes.max(axis=0), 1e-300)).min(axis=1)
            for row, share in zip(among, relative, strict=True):
                if self._symmetric and row != column:
                    continue
                count = (len(rows[row]) - 1) * (len(among) - 1)
                key = (float(share < _SMALL) * (1.0 - share), count, -share)
                if best is None or key < best[0]:
                    best = key, row, column
        if best is None or (self._symmetric and best[0][0] > 0.9999):
            self._symmetric = False
            return self._next(left, over)
        return best[1], best[2]

    def _eliminate(self, row: int, column: int, left: set[int], over: set[int]) -> None:
        """Take a pivot and subtract its row from the others."""
        tape, A = self._tape, self._rows
        pivot = A[row][column]
        inverse = tape.reciprocal(pivot)
        if isinstance(pivot, Node):
            sizes = np.maximum(tape.size(pivot), 1e-300)
            self.pivots.append(Pivot(pivot.index, float(np.exp(np.log(sizes).mean()))))
        left.discard(row)
        over.discard(column)
        factors = list[tuple[int, Expression]]()
        for other in sorted(left):
            if is_zero(A[other][column]):
                continue
            factor = A[other][column] * inverse
            factors.append((other, factor))
            for c in sorted(over):
                if self._symmetric and c < other:
                    continue
                A[other][c] = A[other][c] - factor * A[row][c]
                if self._symmetric:
                    A[c][other] = A[other][c]
        self._steps.append((row, column, inverse, factors))


def _same(a: Expression, b: Expression) -> bool:
    if isinstance(a, Node) and isinstance(b, Node):
        return a.index == b.index
    return not isinstance(a, Node) and not isinstance(b, Node) and bool(a == b)
