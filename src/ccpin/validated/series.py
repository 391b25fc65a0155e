"""Running a tape's program over balls: values, gradients, and Taylor coefficients along x′ = f(x)."""

from __future__ import annotations

from collections.abc import Sequence
from operator import mul
from typing import Any

from ccpin.validated.balls import Ball, ball, flint, inverse
from ccpin.validated.tape import (
    ADD,
    COSINE,
    MULTIPLY,
    PART,
    SCALE,
    SINE,
    SOLVE,
    SUBTRACT,
    Instruction,
    LinearSystem,
    Program,
)

Inverses = dict[Any, Any]  # a system's matrix (numbers of values) -> enclosure of its inverse


class NotInvertibleError(ArithmeticError):
    """A linear solve met a matrix of balls not proven invertible (caught inside this package)."""


def values(program: Program, inputs: Sequence[Ball]) -> list[Ball]:
    """Balls around the outputs over a box of inputs.

    Raises:
        NotInvertibleError: A matrix to be inverted may be singular on the box.
    """
    found = _values(program, inputs, {})
    return [found[number] for number in program.outputs]


def _values(program: Program, inputs: Sequence[Ball], inverses: Inverses) -> list[Any]:
    found: list[Any] = [None] * program.size
    found[: program.inputs] = inputs
    for item in program.instructions:
        a, b = item.a, item.b
        if item.kind == MULTIPLY:
            result = found[a] * found[b]
        elif item.kind == ADD:
            result = found[a] + found[b]
        elif item.kind == SUBTRACT:
            result = found[a] - found[b]
        elif item.kind == SCALE:
            result = item.constant * found[a]
        elif item.kind == SINE:
            result = found[a].sin()
        elif item.kind == COSINE:
            result = found[a].cos()
        elif item.kind == PART:
            result = found[a][b]
        elif item.kind == SOLVE:
            result = _entries(_inverse(b, found, inverses) * _matrix(b.right, found))
        else:
            result = item.constant
        found[item.target] = result
    return found


def gradients(program: Program, inputs: Sequence[Ball]) -> list[list[Ball]]:
    """∂outputs/∂inputs over a box, one row an output.

    Raises:
        NotInvertibleError: As for `values`.
    """
    inverses: Inverses = {}
    found = _values(program, inputs, inverses)
    size, zero = program.inputs, ball(0)
    slopes: list[Any] = [None] * program.size  # None: constant
    for k in range(size):
        slopes[k] = [ball(int(i == k)) for i in range(size)]
    for item in program.instructions:
        slopes[item.target] = _gradient(item, found, slopes, inverses)
    return [slopes[number] or [zero] * size for number in program.outputs]


def _gradient(item: Instruction, found: list[Any], slopes: list[Any], inverses: Inverses) -> Any:
    a, b = item.a, item.b
    if item.kind == MULTIPLY:
        return _combined(_scaled(slopes[a], found[b]), _scaled(slopes[b], found[a]))
    if item.kind == ADD:
        return _combined(slopes[a], slopes[b])
    if item.kind == SUBTRACT:
        return _combined(slopes[a], _scaled(slopes[b], -1))
    if item.kind == SCALE:
        return _scaled(slopes[a], item.constant)
    if item.kind == SINE:
        return _scaled(slopes[a], found[b])
    if item.kind == COSINE:
        return _scaled(slopes[a], -found[b])
    if item.kind == PART:
        return slopes[a][b]
    if item.kind == SOLVE:
        return _solution_gradient(item, found, slopes, inverses)
    return None


def _scaled(slope: Any, factor: Any) -> Any:
    return None if slope is None else [factor * entry for entry in slope]


def _combined(first: Any, second: Any) -> Any:
    if first is None or second is None:
        return second if first is None else first
    return [a + b for a, b in zip(first, second, strict=True)]


def _solution_gradient(item: Instruction, found: list[Any], slopes: list[Any], inverses: Inverses) -> list[Any]:
    """From A z = B: ∂z = A⁻¹(∂B − ∂A z)."""
    system, solution = item.b, found[item.target]
    matrix, right = system.matrix, system.right
    m, columns = len(matrix), len(right[0])
    inverted = _inverse(system, found, inverses)
    found_slopes: list[Any] = [None] * (m * columns)
    for column in range(columns):
        residual = [slopes[right[row][column]] for row in range(m)]
        for row in range(m):
            for k in range(m):
                change = _scaled(slopes[matrix[row][k]], -solution[k * columns + column])
                residual[row] = _combined(residual[row], change)
        for row in range(m):
            total: Any = None
            for k in range(m):
                total = _combined(total, _scaled(residual[k], inverted[row, k]))
            found_slopes[row * columns + column] = total
    return found_slopes


def all_series(program: Program, start: Sequence[Ball], order: int) -> list[Any]:
    """Taylor coefficients at t = 0 of every value along the solution of x′ = f(x) from a point (a box of points).

    The inputs come first, with coefficients 0 … order; the values have 0 … order − 1 (a SOLVE a list of entries each).
    Coefficient k ball-encloses w⁽ᵏ⁾(0)/k! for every start in the box. Each degree is computed from the degrees below
    it by the rules of power series (Moore).

    Raises:
        NotInvertibleError: As for `values`.
    """
    series: list[Any] = [[] for _ in range(program.size)]
    for k in range(program.inputs):
        series[k] = [start[k]]
    inverses: Inverses = {}
    for degree in range(order):
        for item in program.instructions:
            _advance(item, degree, series, inverses)
        for k, number in enumerate(program.outputs):
            series[k].append(series[number][degree] / (degree + 1))
    return series


def _advance(item: Instruction, degree: int, series: list[Any], inverses: Inverses) -> None:
    """Append the coefficient of one degree to one value."""
    a, b = item.a, item.b
    if item.kind == MULTIPLY:
        result = sum(map(mul, series[a], reversed(series[b])))
    elif item.kind == ADD:
        result = series[a][degree] + series[b][degree]
    elif item.kind == SUBTRACT:
        result = series[a][degree] - series[b][degree]
    elif item.kind == SCALE:
        result = item.constant * series[a][degree]
    elif item.kind in (SINE, COSINE):
        result = _trigonometric(item, degree, series)
    elif item.kind == PART:
        result = series[a][degree][b]
    elif item.kind == SOLVE:
        result = _solution(item.b, degree, series, series[item.target], inverses)
    else:
        result = item.constant if degree == 0 else ball(0)
    series[item.target].append(result)


def _trigonometric(item: Instruction, degree: int, series: list[Any]) -> Ball:
    """From s′ = c a′ and c′ = −s a′."""
    angle, other = series[item.a], series[item.b]
    if degree == 0:
        return angle[0].sin() if item.kind == SINE else angle[0].cos()
    total = sum(j * angle[j] * other[degree - j] for j in range(1, degree + 1))
    return total / (degree if item.kind == SINE else -degree)


def _solution(
    system: LinearSystem, degree: int, series: list[Any], solved: list[Any], inverses: Inverses
) -> list[Ball]:
    """From A z = B: z_k = A₀⁻¹(B_k − Σ_{j≥1} A_j z_{k−j})."""
    matrix, right = system.matrix, system.right
    m, columns = len(matrix), len(right[0])
    if system.matrix not in inverses:
        inverses[system.matrix] = _invert([[series[number][0] for number in row] for row in matrix])
    table = []
    for row in range(m):
        known = []
        for column in range(columns):
            total = series[right[row][column]][degree]
            for k in range(m):
                factor, place = series[matrix[row][k]], k * columns + column
                for j in range(1, degree + 1):
                    total = total - factor[j] * solved[degree - j][place]
            known.append(total)
        table.append(known)
    return _entries(inverses[system.matrix] * flint().arb_mat(table))


def _inverse(system: LinearSystem, found: list[Any], inverses: Inverses) -> Any:
    if system.matrix not in inverses:
        inverses[system.matrix] = _invert([[found[number] for number in row] for row in system.matrix])
    return inverses[system.matrix]


def _invert(table: list[list[Ball]]) -> Any:
    inverted = inverse(flint().arb_mat(table))
    if inverted is None:
        raise NotInvertibleError
    return inverted


def _matrix(numbers: tuple[tuple[int, ...], ...], found: list[Any]) -> Any:
    return flint().arb_mat([[found[number] for number in row] for row in numbers])


def _entries(matrix: Any) -> list[Ball]:
    return list(matrix.entries())
