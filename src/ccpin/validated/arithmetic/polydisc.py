"""Functions analytic in a polydisc |ξ_i| < 1: polynomials in doubles and what is left, rounded outwards.

‖f‖ = Σ |a_k| of f = Σ a_k ξ^k is a norm with ‖fg‖ ≤ ‖f‖‖g‖, and |f| ≤ ‖f‖ in the closed polydisc. An `Analytic`
stands for all f with ‖f − Σ_{|k| ≤ N} mid_k ξ^k‖ ≤ rest: what multiplication has beyond the degree N goes into `rest`,
and so do roundings, which are those of IEEE doubles. A bound that cannot be had is no number or ∞, which no comparison
takes for small.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.programs.instructions import Code, Kind
from ccpin.validated.arithmetic.balls import ball, flint, upper
from ccpin.validated.arithmetic.series import NotInvertibleError

_UNIT = 2.0**-53  # roundoff of a double
_OUT = 1.0 + 2.0**-38  # on what is not negative: covers the roundings of sums of up to 10,000 such numbers
_LEAST = 1e-290  # above what thousands of underflows add
_BITS = 64  # in which sines are enclosed, before they are rounded to doubles
_TRIGONOMETRIC = 2.0**-50  # a sine in a ball of 64 bits rounded to a double
_TERMS = 40  # at most, of the exponential series


class Ring(NamedTuple):
    """Polynomials of n numbers, of total degree N at most: K = C(N + n, n) coefficients, degree by degree.

    Attributes:
        exponents: k, of shape (K, n).
        degrees: |k|, as columns of 0 and 1, of shape (K, N + 1).
        left, right, starts: Pairs of coefficients whose product is kept, in the order of where it goes, and where each
            of these begins.
    """

    exponents: Indices
    degrees: Array
    left: Indices
    right: Indices
    starts: Indices


@lru_cache(maxsize=8)
def ring(n: int, degree: int) -> Ring:
    """The polynomials of n numbers."""
    every = [k for k in product(range(degree + 1), repeat=n) if sum(k) <= degree]
    every.sort(key=sum)
    places = {k: place for place, k in enumerate(every)}
    pairs = [
        (places[tuple(map(sum, zip(a, b, strict=True)))], i, j)
        for i, a in enumerate(every)
        for j, b in enumerate(every)
        if sum(a) + sum(b) <= degree
    ]
    target, left, right = np.array(sorted(pairs), dtype=np.int64).T
    exponents = np.array(every, dtype=np.int64).reshape(len(every), n)
    degrees = np.eye(degree + 1)[exponents.sum(axis=1)]
    return Ring(exponents, degrees, left, right, np.searchsorted(target, np.arange(len(every))))


class Analytic(NamedTuple):
    """Arrays of functions: coefficients of shape (…, K), what is left of shape (…)."""

    mid: Array
    rest: Array
    ring: Ring

    @property
    def size(self) -> Array:
        """Upper bounds of ‖f‖."""
        return np.asarray((np.abs(self.mid).sum(axis=-1) + self.rest) * _OUT)

    def __add__(self, other: Any) -> Analytic:
        rest = self.rest + other.rest + _UNIT * (self.size + other.size)
        return Analytic(self.mid + other.mid, rest * _OUT, self.ring)

    def __sub__(self, other: Analytic) -> Analytic:
        return self + other.scaled(-1.0, 0.0)

    def __mul__(self, other: Any) -> Analytic:
        mine, yours = self.mid[..., self.ring.left], other.mid[..., self.ring.right]
        mid = np.add.reduceat(mine * yours, self.ring.starts, axis=-1)
        a, b = self._by_degree, other._beyond
        rest = (a * b).sum(axis=-1) + a.sum(axis=-1) * other.rest + self.rest * other.size
        rest = rest + mid.shape[-1] * _UNIT * self.size * other.size
        return Analytic(mid, rest * _OUT + _LEAST, self.ring)

    def __matmul__(self, other: Analytic) -> Analytic:
        """Products of matrices."""
        mine, yours = (np.moveaxis(x, -1, 0) for x in (self.mid[..., self.ring.left], other.mid[..., self.ring.right]))
        mid = np.moveaxis(np.add.reduceat(mine @ yours, self.ring.starts, axis=0), 0, -1)
        a, b = self._by_degree, other._beyond
        rest = np.einsum("ikd,kjd->ij", a, b) + a.sum(axis=-1) @ other.rest + self.rest @ other.size
        terms = mid.shape[-1] * other.mid.shape[0]
        rest = rest + terms * _UNIT * (self.size @ other.size)
        return Analytic(mid, rest * _OUT + _LEAST, self.ring)

    def scaled(self, factor: float, off: float) -> Analytic:
        """Times all numbers that are at most `off` from a factor."""
        rest = abs(factor) * self.rest + (off + _UNIT * abs(factor)) * self.size
        return Analytic(factor * self.mid, rest * _OUT + _LEAST, self.ring)

    def at(self, index: Any) -> Analytic:
        """A part of the arrays."""
        return Analytic(self.mid[index], self.rest[index], self.ring)

    @property
    def polynomials(self) -> Analytic:
        """The polynomials alone."""
        return self._replace(rest=np.zeros_like(self.rest))

    @property
    def _by_degree(self) -> Array:
        """Σ |a_k| over |k| = d, of shape (…, N + 1)."""
        return np.asarray(np.abs(self.mid) @ self.ring.degrees)

    @property
    def _beyond(self) -> Array:
        """Σ |a_k| over |k| > N − d: what a factor of degree d takes beyond N."""
        own = self._by_degree
        last = np.cumsum(own[..., ::-1], axis=-1)
        return np.concatenate([np.zeros_like(own[..., :1]), last[..., :-1]], axis=-1)


def constants(values: Array, off: Array, known: Ring) -> Analytic:
    """All constant functions at most so far from values."""
    mid = np.zeros((*values.shape, len(known.exponents)))
    mid[..., 0] = values
    return Analytic(mid, off, known)


def stacked(parts: Sequence[Analytic]) -> Analytic:
    """Arrays of functions along a new first axis."""
    return Analytic(np.stack([x.mid for x in parts]), np.stack([x.rest for x in parts]), parts[0].ring)


def sine_and_cosine(angle: Analytic) -> tuple[Analytic, Analytic]:
    """sin(m + u) = sin m cos u + cos m sin u, m the value at 0, with the series of sin u and cos u up to uᵏ/k!.

    Of each at most ‖u‖ᵏ/k! κ/(1 − κ²) is left, κ = ‖u‖/(k + 1); ∞ for κ ≥ ½.
    """
    with flint().ctx.workprec(_BITS):
        pair = [float(x.mid()) for x in flint().arb(float(angle.mid[0])).sin_cos()]
    moved = angle._replace(mid=np.concatenate([[0.0], angle.mid[1:]]))
    one, size = constants(np.array(1.0), np.array(0.0), angle.ring), float(moved.size)
    term, waves, count, bound = one, [one, one.scaled(0.0, 0.0)], 0, 1.0
    while count < _TERMS and not bound < _UNIT:
        count += 1
        term = (term * moved).scaled(1.0 / count, _UNIT)
        waves[count % 2] = waves[count % 2] + term.scaled(1.0 if count % 4 < 2 else -1.0, 0.0)
        bound = bound * size / count * _OUT
    ratio = size / (count + 1)
    left = bound * ratio / (1.0 - ratio**2) if ratio < 0.5 else np.inf
    cosine, sine = (x._replace(rest=(x.rest + left) * _OUT) for x in waves)
    s, c = pair
    return (
        cosine.scaled(s, _TRIGONOMETRIC) + sine.scaled(c, _TRIGONOMETRIC),
        cosine.scaled(c, _TRIGONOMETRIC) - sine.scaled(s, _TRIGONOMETRIC),
    )


def inverse(matrix: Analytic) -> Analytic:
    """Polynomials near the inverse of a square matrix: B + B(I − AB), again and again; nothing is proved of them.

    Raises:
        NotInvertibleError: The value at 0 has none.
    """
    try:
        start = np.linalg.inv(matrix.mid[..., 0])
    except np.linalg.LinAlgError:
        raise NotInvertibleError from None
    found, near = constants(np.asarray(start), np.zeros(start.shape), matrix.ring), matrix.polynomials
    identity = unit(len(start), matrix.ring)
    for _ in range(matrix.ring.degrees.shape[1].bit_length()):
        found = (found + found @ (identity - near @ found).polynomials).polynomials
    return found


def unit(size: int, known: Ring) -> Analytic:
    """The unit matrix."""
    return constants(np.eye(size), np.zeros((size, size)), known)


def solution(matrix: Analytic, right: Analytic) -> Analytic:
    """A⁻¹b: with δ = ‖I − BA‖ < 1 it is at most ‖B(b − Az)‖/(1 − δ) from z = Bb, in the norm of the largest row.

    Raises:
        NotInvertibleError: It is not proved that there is one.
    """
    near = inverse(matrix)
    delta = float((unit(len(matrix.mid), matrix.ring) - near @ matrix).size.sum(axis=1).max() * _OUT)
    if not delta < 0.5:
        raise NotInvertibleError
    found = (near @ right).polynomials
    off = (near @ (right - matrix @ found)).size.max(axis=0) / (1.0 - delta) * _OUT
    return found._replace(rest=np.broadcast_to(off, found.rest.shape))


class ProgramOutputs(NamedTuple):
    """Outputs of a program and, by its chosen inputs, their slopes (outputs, chosen)."""

    values: Analytic
    slopes: Analytic


@np.errstate(all="ignore")
def evaluated(program: Code, inputs: Analytic, chosen: Sequence[int] = ()) -> ProgramOutputs:
    """A program's outputs over functions, and its slopes by some of its inputs.

    Raises:
        NotInvertibleError: A matrix may be singular; a turn of a ball is read, which is not known over complex numbers;
            slopes are asked for of solutions.
    """
    known, width = inputs.ring, len(chosen)
    found: list[Any] = [*map(inputs.at, range(program.inputs)), *[None] * (program.size - program.inputs)]
    flat = constants(np.zeros(width), np.zeros(width), known)
    slopes: list[Any] = [flat] * program.size
    for place, number in enumerate(chosen):
        slopes[number] = constants(np.eye(width)[place], np.zeros(width), known)
    waves: dict[int, tuple[Analytic, Analytic]] = {}
    for item in program.instructions:
        kind, k, a, b, _ = item
        if kind in (Kind.ADD, Kind.SUBTRACT):
            sign = 1.0 if kind == Kind.ADD else -1.0
            found[k], slopes[k] = (x[a] + x[b].scaled(sign, 0.0) for x in (found, slopes))
        elif kind == Kind.MULTIPLY:
            found[k], slopes[k] = found[a] * found[b], slopes[a] * found[b] + slopes[b] * found[a]
        elif kind == Kind.SCALE:
            found[k], slopes[k] = (x[a].scaled(*_double(item.constant)) for x in (found, slopes))
        elif kind in (Kind.SINE, Kind.COSINE):
            sine, cosine = waves[a] = waves.get(a) or sine_and_cosine(found[a])
            found[k] = sine if kind == Kind.SINE else cosine
            slopes[k] = slopes[a] * (cosine if kind == Kind.SINE else sine.scaled(-1.0, 0.0))
        elif kind == Kind.CONSTANT:
            value, off = _double(item.constant)
            found[k] = constants(np.array(value), np.array(off), known)
        elif kind == Kind.SOLVE and not width:
            matrix, right = (stacked([stacked([found[x] for x in row]) for row in table]) for table in b)
            found[k] = solution(matrix, right)
        elif kind == Kind.PART:
            columns = found[a].rest.shape[1]
            found[k] = found[a].at((b // columns, b % columns))
        else:
            raise NotInvertibleError
    return ProgramOutputs(*(stacked([x[number] for number in program.outputs]) for x in (found, slopes)))


def _double(constant: Any) -> tuple[float, float]:
    """A double and how far a ball's numbers are from it at most."""
    value = float(constant.mid())
    return value, upper(abs(constant - ball(value)))
