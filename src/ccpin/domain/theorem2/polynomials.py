"""Polynomials of degree at most two in numbered unknowns, systems of them, and Theorem 2's radius for these."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.errors import InvalidInputError, SingularConfigurationError

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


@dataclass(frozen=True, eq=False)
class QuadraticSystem:
    """The square system P(z) = b in N unknowns, every monomial of P of degree at most two.

    P(z)ᵢ = constantᵢ + Σⱼ linearᵢⱼ zⱼ + Σₖ coefficientₖ z[firstₖ] z[secondₖ] over the k with rowₖ = i. The last
    `free` entries of b are the ones Theorem 2 moves (the independent coordinates, or simple functions of them).
    Build one with `from_polynomials`; every array is read-only.

    Attributes:
        unknowns: Names of the unknowns.
        free: n, the number of last equations with a variable right side.
        right_side: b, of shape (N,).
        constant: Of shape (N,).
        linear: Of shape (N, N).
        row, first, second: Of shape (K,), one entry a quadratic monomial, first ≤ second; no monomial repeats.
        coefficient: Of shape (K,), nonzero.
    """

    unknowns: tuple[str, ...]
    free: int
    right_side: Array
    constant: Array
    linear: Array
    row: Indices
    first: Indices
    second: Indices
    coefficient: Array

    def __post_init__(self) -> None:
        for array in (self.right_side, self.constant, self.linear, self.row, self.first, self.second, self.coefficient):
            array.flags.writeable = False

    @classmethod
    def from_polynomials(
        cls,
        unknowns: Sequence[str],
        polynomials: Sequence[Polynomial],
        *,
        free: int,
        right_side: Sequence[float] | None = None,
    ) -> QuadraticSystem:
        """A system of polynomials, one an equation.

        Args:
            unknowns: Their names.
            polynomials: The left sides P, as many.
            free: n, how many of the last equations have a variable right side.
            right_side: b; default zero.

        Raises:
            InvalidInputError: The system is not square, or has a monomial above degree two.
        """
        size = len(unknowns)
        b = np.zeros(size) if right_side is None else np.array(right_side, dtype=np.float64)
        if len(set(unknowns)) != size or len(polynomials) != size or b.shape != (size,) or not 0 <= free <= size:
            raise InvalidInputError(
                f"a square system is wanted: {size} unknowns ({len(set(unknowns))} different), {len(polynomials)} "
                f"equations, a right side of shape {b.shape}, {free} of the equations free"
            )
        constant, linear = np.zeros(size), np.zeros((size, size))
        quadratic: list[tuple[int, int, int, float]] = []
        for i, polynomial in enumerate(polynomials):
            for monomial, c in polynomial.terms.items():
                if len(monomial) == 0:
                    constant[i] = c
                elif len(monomial) == 1:
                    linear[i, monomial[0]] = c
                elif len(monomial) == 2:
                    quadratic.append((i, monomial[0], monomial[1], c))
                else:
                    raise InvalidInputError(
                        f"equation {i + 1} has the monomial {'*'.join(unknowns[k] for k in monomial)}, above degree "
                        "two: name a product as an unknown of its own (w = x*x, say)"
                    )
        index = np.array([entry[:3] for entry in quadratic], dtype=np.intp).reshape(-1, 3)
        coefficient = np.array([entry[3] for entry in quadratic], dtype=np.float64)
        row, first, second = (np.ascontiguousarray(column) for column in index.T)
        return cls(tuple(unknowns), free, b, constant, linear, row, first, second, coefficient)

    @property
    def size(self) -> int:
        """N, the number of unknowns and of equations."""
        return len(self.unknowns)

    def value(self, z: Array) -> Array:
        """P(z) − b, of shape (N,)."""
        products = self.coefficient * z[self.first] * z[self.second]
        return self.constant - self.right_side + self.linear @ z + self._sum_by_row(products)

    def jacobian(self, z: Array) -> Array:
        """P_z, of shape (N, N): affine in z."""
        jacobian = self.linear.copy()
        np.add.at(jacobian, (self.row, self.first), self.coefficient * z[self.second])
        np.add.at(jacobian, (self.row, self.second), self.coefficient * z[self.first])
        return jacobian

    def magnitude(self, z: Array) -> Array:
        """Σ |coefficient| |monomial| of each row at z, of shape (N,): the scale of its rounding errors."""
        size = np.abs(z)
        products = np.abs(self.coefficient) * size[self.first] * size[self.second]
        return np.asarray(
            np.abs(self.constant) + np.abs(self.right_side) + np.abs(self.linear) @ size + self._sum_by_row(products)
        )

    @property
    def v(self) -> Array:
        """Theorem 2's vector v, of shape (N,).

        Row by row of P_z: the degree-zero monomials dropped, every sign made +, every variable set to 1, summed.
        Each monomial c x y (or c x²) of P's row gives |c| twice. So |P_z(x) − P_z(y)| has row sums of at most
        vᵢ ‖x − y‖∞.
        """
        return self._sum_by_row(2.0 * np.abs(self.coefficient))

    @property
    def c(self) -> float:
        """The largest of v, a Lipschitz constant of P_z in the maximum norm."""
        return float(self.v.max(initial=0.0))

    def rescaled(self, weights: Array) -> QuadraticSystem:
        """The same system in the unknowns z̃ = z / weights (positive, of shape (N,)): another quadratic form of it."""
        scale = weights[self.first] * weights[self.second]
        return replace(self, linear=self.linear * weights, coefficient=self.coefficient * scale)

    def radius(self, z: Array) -> float:
        """Theorem 2: how far each of the last n right sides may move, with one solution near z throughout.

        r = ½ · 1/‖P_z⁻¹ diag(v)‖∞ · 1/‖P_z⁻¹ diag(0, …, 0, 1, …, 1)‖∞, the n ones last, P_z taken at z. This is
        the formula as it stands, for P(z) = b exactly and without rounding; `theorem2` adds margins.

        Raises:
            SingularConfigurationError: P_z(z) is singular.
        """
        jacobian = self.jacobian(z)
        rcond = 1.0 / float(np.linalg.cond(jacobian, 1)) if self.size else 1.0
        if rcond < np.finfo(np.float64).eps:
            raise SingularConfigurationError(
                f"the quadratic system's Jacobian is singular at the centre (reciprocal condition number {rcond:.1e})",
                q_free=z,
                rcond=rcond,
            )
        inverse = np.linalg.inv(jacobian)
        bend = float((np.abs(inverse) @ self.v).max(initial=0.0))
        gain = float(np.abs(inverse[:, self.size - self.free :]).sum(axis=1).max(initial=0.0))
        return 0.5 / (bend * gain) if bend * gain > 0.0 else np.inf

    def _sum_by_row(self, values: Array) -> Array:
        return np.asarray(np.bincount(self.row, weights=values, minlength=self.size), dtype=np.float64)
