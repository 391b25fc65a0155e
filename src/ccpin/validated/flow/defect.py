"""How far a solution's Taylor polynomial p is from solving x′ = f(x): a bound of |p′(t) − f(p(t))| on [0, h].

Lemma V of `ccpin/proof/theorems/defect.md`, whose names ‖w‖, ω and T are used here: beside the Taylor coefficients of
every value of f's program (`all_series`) goes a bound ω of the rest, from value to value.
"""

from __future__ import annotations

from collections.abc import Sequence
from operator import mul
from typing import Any, NamedTuple

from ccpin.programs.instructions import Code, Instruction, Kind
from ccpin.validated.arithmetic.balls import Ball, around, ball, flint, gain, inverse, magnitude
from ccpin.validated.arithmetic.series import NotInvertibleError, extend


class _Bound(NamedTuple):
    """Bounds of one value along p.

    Attributes:
        terms: |w_k| hᵏ for k < N.
        tails: Σ_{j≥k} |w_j| hʲ for k ≤ N.
        rest: ω.
    """

    terms: list[Ball]
    tails: list[Ball]
    rest: Ball

    @property
    def size(self) -> Ball:
        """‖w‖."""
        return self.tails[0]


def defect_along(program: Code, series: Sequence[Any], length: Ball) -> list[Ball]:
    """Bounds of |p′ − f(p)| on [0, h], by component.

    Args:
        program: f.
        series: Of every value, from `ccpin.validated.arithmetic.series.all_series` to order N.
        length: h.

    Raises:
        NotInvertibleError: A matrix to be inverted may be singular along p.
    """
    run = _AlongPolynomial.over(program, series, length)
    return [run.bounds[number].rest for number in program.outputs]


def sizes_along(program: Code, polynomial: Sequence[Sequence[Ball]], length: Ball) -> list[Ball]:
    """Bounds of a program's outputs along a polynomial p of its inputs on [0, h].

    Raises:
        NotInvertibleError: As for `defect`.
    """
    order = len(polynomial[0]) - 1
    series: list[Any] = [*(list(row) for row in polynomial), *([] for _ in range(program.size - program.inputs))]
    extend(program, series, order)
    run = _AlongPolynomial.over(program, series, length)
    return [run.bounds[number].size + run.bounds[number].rest for number in program.outputs]


class _AlongPolynomial:
    def __init__(self, series: Sequence[Any], powers: list[Ball], length: Ball) -> None:
        self.series, self.powers, self.length = series, powers, length
        self.bounds: list[Any] = [None] * len(series)

    @classmethod
    def over(cls, program: Code, series: Sequence[Any], length: Ball) -> _AlongPolynomial:
        """All values of a program bounded."""
        order = len(series[0]) - 1
        powers = [ball(1)]
        for _ in range(order):
            powers.append((powers[-1] * length).upper())
        run = cls(series, powers, length)
        for k in range(program.inputs):
            run.bounds[k] = run.bound(series[k][:order], magnitude(series[k][order]) * powers[order])
        for item in program.instructions:
            run.visit(item)
        return run

    def bound(self, coefficients: Sequence[Ball], rest: Ball) -> _Bound:
        terms = [magnitude(c) * power for c, power in zip(coefficients, self.powers, strict=False)]
        tails = [ball(0)]
        for term in reversed(terms):
            tails.append(tails[-1] + term)
        tails.reverse()
        return _Bound(terms, tails, magnitude(rest))

    def visit(self, item: Instruction) -> None:
        """Bound one value."""
        if item.kind == Kind.SOLVE:
            self.bounds[item.target] = self.solution(item)
            return
        if item.kind == Kind.PART:
            self.bounds[item.target] = self.bounds[item.a][item.b]
            return
        self.bounds[item.target] = self.bound(self.series[item.target], self.rest(item))

    def rest(self, item: Instruction) -> Ball:
        """ω of a value that is not the solution of a linear system: the lemma's 1 and 2, sums and multiples."""
        if item.kind in (Kind.ADD, Kind.SUBTRACT):
            return self.bounds[item.a].rest + self.bounds[item.b].rest
        if item.kind == Kind.SCALE:
            return magnitude(item.constant) * self.bounds[item.a].rest
        if item.kind == Kind.MULTIPLY:
            a, b = self.bounds[item.a], self.bounds[item.b]
            return _tail(a, b) + a.size * b.rest + b.size * a.rest + a.rest * b.rest
        if item.kind in (Kind.SINE, Kind.COSINE):
            pair = zip(self.series[item.target], self.series[item.b], strict=True)
            both = self.bound([magnitude(s) + magnitude(c) for s, c in pair], ball(0))
            angle = self.bounds[item.a]
            return _tail(angle, both) + angle.rest
        if item.kind == Kind.GAIN:
            return self.composed(item)
        return ball(0)

    def composed(self, item: Instruction) -> Ball:
        """ω of g⁽ᵏ⁾(u): the lemma's 3."""
        u, centre, order = self.bounds[item.a], self.series[item.a][0], item.b
        size, reach = len(u.terms), u.tails[1]
        low, tail, total = [ball(1), *[ball(0)] * (size - 1)], ball(0), ball(0)
        factorial = ball(1)
        for j in range(1, size):
            factorial = factorial * j
            tail = tail * reach + sum((x * u.tails[max(size - i, 1)] for i, x in enumerate(low)), ball(0))
            low = [sum((u.terms[i] * low[n - i] for i in range(1, n + 1)), ball(0)) for n in range(size)]
            total += magnitude(gain(centre, order + j)) / factorial * tail
        region = around(centre, reach + u.rest)
        total += magnitude(gain(region, order + size)) / (factorial * size) * reach**size
        return total + magnitude(gain(region, order + 1)) * u.rest

    def solution(self, item: Instruction) -> list[_Bound]:
        """Bounds of the entries of z = A⁻¹B, row-major: the lemma's 4."""
        matrix, right = item.b.matrix, item.b.right
        m, columns, table = len(matrix), len(right[0]), flint().arb_mat
        parts = [self.bound([row[k] for row in self.series[item.target]], ball(0)) for k in range(m * columns)]
        inverted = inverse(table([[self.range(number) for number in row] for row in matrix]))
        if inverted is None:
            raise NotInvertibleError
        residual = []
        for row, numbers in zip(matrix, right, strict=True):
            for column, number in enumerate(numbers):
                pairs = [(self.bounds[a], z) for a, z in zip(row, parts[column::columns], strict=True)]
                known = self.bounds[number].rest
                residual.append(sum((_tail(a, z) + a.rest * z.size for a, z in pairs), known))
        sizes = table(m, m, [magnitude(entry) for entry in inverted.matrix.entries()])
        rests = (sizes * table(m, columns, residual)).entries()
        return [part._replace(rest=magnitude(rest)) for part, rest in zip(parts, rests, strict=True)]

    def range(self, number: int) -> Ball:
        """A ball around a value along p on [0, h]."""
        coefficients, bound = self.series[number], self.bounds[number]
        half = self.length / 2
        if len(coefficients) == 1:
            return around(coefficients[0], bound.rest)
        slope = coefficients[1] * half
        return around(coefficients[0] + slope, magnitude(slope) + bound.tails[2] + bound.rest)


def _tail(a: _Bound, b: _Bound) -> Ball:
    """T(a, b) = Σ_{i+j≥N} |a_i||b_j| hⁱ⁺ʲ."""
    return sum(map(mul, a.terms[1:], reversed(b.tails[1:-1])), ball(0))
