"""Running a tape's program over balls: values, gradients, and Taylor coefficients along x′ = f(x)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import mul
from typing import Any

import numpy as np

from ccpin.programs.instructions import Code, Instruction, Kind
from ccpin.validated.arithmetic.balls import Ball, BallInverse, ball, flint, gain, inverse

Memory = dict[Any, Any]  # a system's matrix (numbers of values) -> its inverse; (w, k) -> coefficients of g⁽ᵏ⁾(w)


class NotInvertibleError(ArithmeticError):
    """A linear solve met a matrix of balls not proven invertible (caught inside this package)."""


def values(program: Code, inputs: Sequence[Ball]) -> list[Ball]:
    """Balls around the outputs over a box of inputs.

    Raises:
        NotInvertibleError: A matrix to be inverted may be singular on the box.
    """
    found = _values(program, inputs, {})
    return [found[number] for number in program.outputs]


def _values(program: Code, inputs: Sequence[Ball], inverses: Memory) -> list[Any]:
    found: list[Any] = [None] * program.size
    found[: program.inputs] = inputs
    for item in program.instructions:
        found[item.target] = _value(item, found, inverses)
    return found


def _value(item: Instruction, found: list[Any], inverses: Memory) -> Any:
    a, b = item.a, item.b
    if item.kind == Kind.MULTIPLY:
        return found[a] * found[b]
    if item.kind == Kind.ADD:
        return found[a] + found[b]
    if item.kind == Kind.SUBTRACT:
        return found[a] - found[b]
    if item.kind == Kind.SCALE:
        return item.constant * found[a]
    if item.kind == Kind.SINE:
        return found[a].sin()
    if item.kind == Kind.COSINE:
        return found[a].cos()
    if item.kind == Kind.GAIN:
        return gain(found[a], b)
    if item.kind == Kind.PART:
        return found[a][b]
    if item.kind == Kind.SOLVE:
        right = flint().arb_mat([[found[number] for number in row] for row in b.right])
        return _inverse(b.matrix, found.__getitem__, inverses).times(right).entries()
    return item.constant


def gradients(program: Code, inputs: Sequence[Ball]) -> list[list[Ball]]:
    """∂outputs/∂inputs over a box, one row an output.

    Every value w over the box ± δ about c is narrowed by the mean value theorem, w ∈ w(c) + w′(box)δ, so that what is
    lost where values depend on one another is of the order of δ².

    Raises:
        NotInvertibleError: As for `values`.
    """
    inverses: Memory = {}
    middle = _values(program, [x.mid() for x in inputs], {})
    size = program.inputs
    zero = np.full(size, ball(0), dtype=object)
    off = np.array([x - x.mid() for x in inputs], dtype=object)
    found: list[Any] = [*inputs, *[None] * (program.size - size)]
    slopes: list[Any] = [None] * program.size  # 0: constant
    slopes[:size] = zero + np.eye(size, dtype=object)

    def narrowed(value: Ball, centre: Ball, slope: Any) -> Ball:
        other = centre + (slope @ off)
        return other if other.rad() < value.rad() else value

    for item in program.instructions:
        k = item.target
        found[k] = _value(item, found, inverses)
        if item.kind == Kind.SINE:  # its slope is the cosine, which comes next
            found[item.b] = found[item.a].cos()
        slopes[k] = _gradient(item, found, slopes, zero, inverses)
        if item.kind == Kind.SOLVE:
            found[k] = [narrowed(*entry) for entry in zip(found[k], middle[k], slopes[k], strict=True)]
        elif item.kind != Kind.PART and not isinstance(slopes[k], int):
            found[k] = narrowed(found[k], middle[k], slopes[k])
    return [list(zero + slopes[number]) for number in program.outputs]


def _gradient(item: Instruction, found: list[Any], slopes: list[Any], zero: Any, inverses: Memory) -> Any:
    a, b = item.a, item.b
    if item.kind == Kind.MULTIPLY:
        return slopes[a] * found[b] + slopes[b] * found[a]
    if item.kind == Kind.ADD:
        return slopes[a] + slopes[b]
    if item.kind == Kind.SUBTRACT:
        return slopes[a] - slopes[b]
    if item.kind == Kind.SCALE:
        return slopes[a] * item.constant
    if item.kind == Kind.SINE:
        return slopes[a] * found[b]
    if item.kind == Kind.COSINE:
        return slopes[a] * -found[b]
    if item.kind == Kind.GAIN:
        return slopes[a] * gain(found[a], b + 1)
    if item.kind == Kind.PART:
        return slopes[a][b]
    if item.kind == Kind.SOLVE:
        return _solution_gradient(item, found, slopes, zero, inverses)
    return 0


def _solution_gradient(item: Instruction, found: list[Any], slopes: list[Any], zero: Any, inverses: Memory) -> Any:
    """From A z = B: ∂z = A⁻¹(∂B − ∂A z), of shape (mk, inputs)."""

    def table(numbers: tuple[tuple[int, ...], ...]) -> Any:
        """The slopes of a matrix, of shape (rows, inputs, columns)."""
        return np.array([[zero + slopes[number] for number in row] for row in numbers], dtype=object).swapaxes(1, 2)

    right = table(item.b.right)
    m, size, columns = right.shape
    residual = right - table(item.b.matrix) @ np.array(found[item.target], dtype=object).reshape(m, columns)
    inverted = _inverse(item.b.matrix, found.__getitem__, inverses)
    solved = inverted.times(flint().arb_mat(m, size * columns, list(residual.ravel()))).entries()
    return np.array(solved, dtype=object).reshape(m, size, columns).swapaxes(1, 2).reshape(m * columns, size)


def all_series(program: Code, start: Sequence[Ball], order: int) -> list[Any]:
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
    inverses: Memory = {}
    for degree in range(order):
        _extend(program, series, degree, inverses)
        for k, number in enumerate(program.outputs):
            series[k].append(series[number][degree] / (degree + 1))
    return series


def extend(program: Code, series: list[Any], order: int) -> None:
    """Append the coefficients 0 … order − 1 of a program's values to the inputs' coefficients, which are there.

    Raises:
        NotInvertibleError: As for `values`.
    """
    inverses: Memory = {}
    given = series[: program.inputs]
    for degree in range(order):  # a product takes all coefficients that are there: those of inputs come one by one too
        series[: program.inputs] = (row[: degree + 1] for row in given)
        _extend(program, series, degree, inverses)
    series[: program.inputs] = given


def _extend(program: Code, series: list[Any], degree: int, inverses: Memory) -> None:
    for item in program.instructions:
        _advance(item, degree, series, inverses)


def _advance(item: Instruction, degree: int, series: list[Any], inverses: Memory) -> None:
    """Append the coefficient of one degree to one value."""
    a, b = item.a, item.b
    if item.kind == Kind.MULTIPLY:
        result = sum(map(mul, series[a], reversed(series[b])))
    elif item.kind == Kind.ADD:
        result = series[a][degree] + series[b][degree]
    elif item.kind == Kind.SUBTRACT:
        result = series[a][degree] - series[b][degree]
    elif item.kind == Kind.SCALE:
        result = item.constant * series[a][degree]
    elif item.kind in (Kind.SINE, Kind.COSINE):
        result = _trigonometric(item, degree, series)
    elif item.kind == Kind.GAIN:
        result = _composed(a, b, degree, series, inverses)
    elif item.kind == Kind.PART:
        result = series[a][degree][b]
    elif item.kind == Kind.SOLVE:
        result = _solution(item, degree, series, inverses)
    else:
        result = item.constant if degree == 0 else ball(0)
    series[item.target].append(result)


def _trigonometric(item: Instruction, degree: int, series: list[Any]) -> Ball:
    """From s′ = c a′ and c′ = −s a′."""
    angle, other = series[item.a], series[item.b]
    if degree == 0:
        return angle[0].sin() if item.kind == Kind.SINE else angle[0].cos()
    total = sum(j * angle[j] * other[degree - j] for j in range(1, degree + 1))
    return total / (degree if item.kind == Kind.SINE else -degree)


def _composed(a: int, order: int, degree: int, series: list[Any], known: Memory) -> Ball:
    """A coefficient of h = g⁽ᵏ⁾(w), from h′ = g⁽ᵏ⁺¹⁾(w) w′."""
    found = known.setdefault((a, order), [])
    while len(found) <= degree:
        n = len(found)
        parts = (j * series[a][j] * _composed(a, order + 1, n - j, series, known) for j in range(1, n + 1))
        found.append(sum(parts, ball(0)) / n if n else gain(series[a][0], order))
    return found[degree]


def _solution(item: Instruction, degree: int, series: list[Any], inverses: Memory) -> list[Ball]:
    """From A z = B: z_k = A₀⁻¹(B_k − Σ_{j≥1} A_j z_{k−j})."""
    matrix, right = item.b.matrix, item.b.right
    inverted = _inverse(matrix, lambda number: series[number][0], inverses)
    known = np.array([[series[number][degree] for number in row] for row in right], dtype=object)
    if degree:
        past = np.array(series[item.target][::-1], dtype=object).reshape(degree, *known.shape)
        factors = np.array([[series[number][1 : degree + 1] for number in row] for row in matrix], dtype=object)
        known = known - np.tensordot(factors, past, axes=([1, 2], [1, 0]))
    return list(inverted.times(flint().arb_mat(known.tolist())).entries())


def _inverse(matrix: tuple[tuple[int, ...], ...], value: Callable[[int], Ball], inverses: Memory) -> BallInverse:
    known: BallInverse | None = inverses.get(matrix)
    if known is None:
        known = inverse(flint().arb_mat([[value(number) for number in row] for row in matrix]))
        if known is None:
            raise NotInvertibleError
        inverses[matrix] = known
    return known
