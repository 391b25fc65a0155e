"""The unknowns of a quadratic form: joint variables centred at a configuration, and products named on the way."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross
from ccpin.domain.theorem2.polynomials import Monomial, Polynomial, combine

Vector = tuple[Polynomial, Polynomial, Polynomial]

NOISE = 1e-14  # of a polynomial's largest coefficient: smaller ones are what rounding left of zeros


class AngleTerm(NamedTuple):
    """sign · (displacement of the joint whose configuration starts at `idx_q`); `wrapped`: stored as (cos, sin)."""

    idx_q: int
    wrapped: bool
    sign: float

    def at(self, q_free: Array) -> float:
        """The signed displacement in radians."""
        if self.wrapped:
            return self.sign * math.atan2(q_free[self.idx_q + 1], q_free[self.idx_q])
        return self.sign * float(q_free[self.idx_q])


class Circle(NamedTuple):
    """u = cos Δ and s = sin Δ, Δ the change of the angle Σ terms from its value at the centre."""

    terms: tuple[AngleTerm, ...]
    centre: float
    name: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns u, s."""
        return f"{self.name}.cos", f"{self.name}.sin"

    def values(self, q_free: Array) -> tuple[float, ...]:
        """(u, s) at a configuration; (1, 0) at the centre."""
        change = sum(term.at(q_free) for term in self.terms) - self.centre
        return math.cos(change), math.sin(change)


class Slide(NamedTuple):
    """d, the change of a prismatic joint's displacement from the centre, in metres."""

    idx_q: int
    centre: float
    name: str

    @property
    def names(self) -> tuple[str, ...]:
        """The name of the unknown d."""
        return (f"{self.name}.slide",)

    def values(self, q_free: Array) -> tuple[float, ...]:
        """(d,) at a configuration; (0,) at the centre."""
        return (float(q_free[self.idx_q]) - self.centre,)


class Ball(NamedTuple):
    """The unit quaternion (x, y, z, w) of a spherical joint's rotation R₀ᵀ R from the centre, w ≥ 0."""

    idx_q: int
    centre: tuple[float, float, float, float]
    name: str

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the four unknowns."""
        return tuple(f"{self.name}.{part}" for part in ("qx", "qy", "qz", "qw"))

    def values(self, q_free: Array) -> tuple[float, ...]:
        """The conjugate of the centre's quaternion times the configuration's; (0, 0, 0, 1) at the centre."""
        a, (w0, b) = -np.array(self.centre[:3]), (self.centre[3], q_free[self.idx_q : self.idx_q + 4])
        vector = w0 * b[:3] + b[3] * a + cross(a, b[:3])
        w = w0 * b[3] - a @ b[:3]
        turned = np.array([*vector, w]) * (1.0 if w >= 0 else -1.0) / np.linalg.norm(b)
        return tuple(float(x) for x in turned)


JointVariable = Circle | Slide | Ball


@dataclass(eq=False)
class Unknowns:
    """The growing list of unknowns, their values at the centre, and the equations that define the products.

    Attributes:
        names, centre: One entry an unknown.
        charts: Joint variables, with the number of the first unknown of each.
        definitions: (number of the unknown w, polynomial p) for each product w = p, in an order in which every p
            holds earlier unknowns only.
    """

    names: list[str] = field(default_factory=list)
    centre: list[float] = field(default_factory=list)
    charts: list[tuple[int, JointVariable]] = field(default_factory=list)
    definitions: list[tuple[int, Polynomial]] = field(default_factory=list)
    _named: dict[object, Polynomial] = field(default_factory=dict)

    def chart(self, chart: JointVariable, q_free: Array) -> tuple[Polynomial, ...]:
        """Add a joint's unknowns, with their values at the centre `q_free`."""
        self.charts.append((len(self.names), chart))
        return tuple(self._add(name, value) for name, value in zip(chart.names, chart.values(q_free), strict=True))

    def affine(self, polynomial: Polynomial) -> Polynomial:
        """The polynomial itself where its degree is at most one, else an unknown defined to equal it."""
        polynomial = polynomial.cleaned(NOISE)
        if polynomial.degree < 2:
            return polynomial
        key = polynomial.key
        if key not in self._named:
            self.definitions.append((len(self.names), polynomial))
            self._named[key] = self._add(f"product{len(self.definitions)}", polynomial.at(self.centre))
        return self._named[key]

    def affine_vector(self, vector: Vector) -> Vector:
        """The vector with what is of degree two named: each monomial (w = x y), or each component.

        Monomials are shared between vectors of one body and make v small; but their number grows with the number of
        joints. They are named where that takes at most twice as many new unknowns.
        """
        vector = _each(lambda component: component.cleaned(NOISE), vector)
        monomials = {m for component in vector for m in component.terms if len(m) == 2}
        new = sum(Polynomial({m: 1.0}).key not in self._named for m in monomials)
        components = sum(component.degree == 2 and component.key not in self._named for component in vector)
        if new > 2 * components:
            return _each(self.affine, vector)
        return _each(lambda p: combine((c, self.affine(Polynomial({m: 1.0}))) for m, c in p.terms.items()), vector)

    def product(self, left: Polynomial, right: Polynomial) -> Polynomial:
        """A polynomial of degree at most two that equals left · right where the products are what they are named."""
        if left.degree + right.degree > 2:
            left, right = self.affine(left), self.affine(right)
        return left * right

    def dot(self, left: Sequence[Polynomial], right: Sequence[Polynomial]) -> Polynomial:
        """Σ leftᵢ rightᵢ."""
        return combine((1.0, self.product(a, b)) for a, b in zip(left, right, strict=True))

    def lift(self, q_free: Array) -> Array:
        """Every unknown's value at a configuration, closed or open."""
        z = np.zeros(len(self.names))
        for start, chart in self.charts:
            values = chart.values(q_free)
            z[start : start + len(values)] = values
        for index, polynomial in self.definitions:
            z[index] = polynomial.at(z)
        return z

    def identities(self) -> list[Polynomial]:
        """The equations that hold whether the loops are closed or not: unit circles, quaternions, definitions."""
        rows = []
        for start, chart in self.charts:
            if not isinstance(chart, Slide):
                squares: dict[Monomial, float] = {(start + k, start + k): 1.0 for k in range(len(chart.names))}
                rows.append(Polynomial({**squares, (): -1.0}))
        rows += [p - Polynomial.unknown(index) for index, p in self.definitions]
        return rows

    def _add(self, name: str, value: float) -> Polynomial:
        self.names.append(name)
        self.centre.append(value)
        return Polynomial.unknown(len(self.names) - 1)


def _each(function: Callable[[Polynomial], Polynomial], vector: Vector) -> Vector:
    x, y, z = map(function, vector)
    return x, y, z


def constant_vector(vector: Array) -> Vector:
    """A constant as a vector of polynomials."""
    x, y, z = (Polynomial.constant(float(c)) for c in vector)
    return x, y, z


def turned(matrix: Array, vector: Vector) -> Vector:
    """The matrix times the vector."""
    x, y, z = (combine(zip(map(float, row), vector, strict=True)) for row in matrix)
    return x, y, z


def plus(left: Vector, right: Vector, factor: float = 1.0) -> Vector:
    """The sum left + factor · right."""
    x, y, z = (combine([(1.0, a), (factor, b)]) for a, b in zip(left, right, strict=True))
    return x, y, z


def without_noise(array: Array) -> Array:
    """The array with entries below 1e-15 of its largest (or of one) set to zero."""
    return np.where(np.abs(array) < 1e-15 * max(1.0, float(np.abs(array).max(initial=0.0))), 0.0, array)
