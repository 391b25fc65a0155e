"""Polynomials of degree at most two in numbered unknowns: the arithmetic behind a quadratic form."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ccpin.arrays import Array

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
