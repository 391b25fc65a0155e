"""Polynomials of degree at most two in numbered unknowns: the arithmetic behind a quadratic form."""

from __future__ import annotations

import ast
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ccpin.arrays import Array
from ccpin.errors import InvalidInputError

Monomial = tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Polynomial:
    """Σ terms[m] Π z[i in m]: a monomial is the sorted tuple of its unknowns' numbers, () for the constant."""

    terms: Mapping[Monomial, float]

    @classmethod
    def constant(cls, value: float) -> Polynomial:
        """The polynomial that is `value` everywhere."""
        return cls({(): float(value)} if value else {})

    @classmethod
    def unknown(cls, index: int) -> Polynomial:
        """The polynomial z[index]."""
        return cls({(index,): 1.0})

    @property
    def degree(self) -> int:
        """The total degree, 0 for constants and for zero."""
        return max(map(len, self.terms), default=0)

    @property
    def key(self) -> tuple[tuple[Monomial, float], ...]:
        """A hashable value that tells polynomials apart."""
        return tuple(sorted(self.terms.items()))

    def __add__(self, other: Polynomial) -> Polynomial:
        return combine([(1.0, self), (1.0, other)])

    def __sub__(self, other: Polynomial) -> Polynomial:
        return combine([(1.0, self), (-1.0, other)])

    def __mul__(self, other: Polynomial) -> Polynomial:
        product: dict[Monomial, float] = {}
        for left, a in self.terms.items():
            for right, b in other.terms.items():
                monomial = tuple(sorted(left + right))
                product[monomial] = product.get(monomial, 0.0) + a * b
        return _without_zeros(product)

    def scaled(self, factor: float) -> Polynomial:
        """`factor` times the polynomial."""
        return combine([(factor, self)])

    def cleaned(self, relative: float) -> Polynomial:
        """The polynomial without coefficients at most `relative` times its largest one."""
        least = relative * max(map(abs, self.terms.values()), default=0.0)
        return Polynomial({m: c for m, c in self.terms.items() if abs(c) > least})

    def at(self, z: Array | Sequence[float]) -> float:
        """The value at z."""
        return math.fsum(c * math.prod(float(z[i]) for i in m) for m, c in self.terms.items())


def combine(parts: Iterable[tuple[float, Polynomial]]) -> Polynomial:
    """The linear combination Σ factor · polynomial."""
    total: dict[Monomial, float] = {}
    for factor, polynomial in parts:
        if factor:
            for monomial, c in polynomial.terms.items():
                total[monomial] = total.get(monomial, 0.0) + factor * c
    return _without_zeros(total)


def _without_zeros(terms: dict[Monomial, float]) -> Polynomial:
    return Polynomial({m: c for m, c in terms.items() if c})


def parse_polynomial(text: str, unknowns: Sequence[str]) -> Polynomial:
    """Read a polynomial such as ``"x*u - 2*y**2 + 1"``: numbers, unknowns, + − * /, whole powers, brackets.

    The text is parsed, never evaluated. ``str()`` of a sympy polynomial is of this form.

    Raises:
        InvalidInputError: Anything else occurs in it, or a name that is not among `unknowns`.
    """
    try:
        tree = ast.parse(text.strip(), mode="eval")
    except (SyntaxError, ValueError) as error:
        raise InvalidInputError(f"'{text}' is not a polynomial: {error}") from None
    try:
        return _Reader(text, {name: i for i, name in enumerate(unknowns)}).read(tree.body)
    except RecursionError:
        raise InvalidInputError(f"'{text[:60]}…' is nested too deeply; expand the polynomial") from None


class _Reader:
    def __init__(self, text: str, index: dict[str, int]) -> None:
        self.text = text
        self.index = index

    def read(self, node: ast.expr) -> Polynomial:
        if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and math.isfinite(node.value):
            return Polynomial.constant(float(node.value))
        if isinstance(node, ast.Name):
            if node.id not in self.index:
                raise self.error(f"'{node.id}' is not an unknown; those are {', '.join(self.index)}")
            return Polynomial.unknown(self.index[node.id])
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
            return self.read(node.operand).scaled(-1.0 if isinstance(node.op, ast.USub) else 1.0)
        if isinstance(node, ast.BinOp):
            return self.binary(node)
        raise self.error("only numbers, unknowns, + - * /, whole powers and brackets are allowed")

    def binary(self, node: ast.BinOp) -> Polynomial:
        left, right = self.read(node.left), self.read(node.right)
        if isinstance(node.op, ast.Add):
            return left + right
        if isinstance(node.op, ast.Sub):
            return left - right
        if isinstance(node.op, ast.Mult):
            return left * right
        if right.degree == 0:
            value = right.terms.get((), 0.0)
            if isinstance(node.op, ast.Div) and value:
                return left.scaled(1.0 / value)
            if isinstance(node.op, ast.Pow) and value in (0.0, 1.0, 2.0):
                return (Polynomial.constant(1.0), left, left * left)[int(value)]
        raise self.error("divide by numbers only, and raise to the powers 0, 1, 2 only")

    def error(self, reason: str) -> InvalidInputError:
        return InvalidInputError(f"'{self.text}' is not a polynomial of degree at most two: {reason}")
