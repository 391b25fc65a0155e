"""Arrays of numbers known to first order in common parameters, and to within a radius: affine forms.

An `Affine` stands for the arrays x(ε) = mid + Σ_p lin_p ε_p + r with |r| ≤ rad entrywise, for parameters ε that all
forms of one computation share: the first ones, `boxed` of them, with |ε_p| ≤ 1 each, the others together in the unit
ball, Σ ε_p² ≤ 1. Each operation returns a form that holds its exact result for every ε and every r
of its operands; what is of second order in ε goes to the radius. So quantities that move together are not taken for
independent, and the radius of a result shrinks with the square of what its arguments vary.

Rounding. A sum of K products of floating-point numbers is off by at most K + 1 units of roundoff u of the sum of their
absolute values, whatever the order; four times as much is added, which covers the roundings of radii too (sums of
nonnegative numbers, off by a relative K u), and so do factors 1 + 1e-13.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ccpin.arrays import Array, Mask, inverses, solve_many
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF

_GROWN = 1.0 + 1e-13  # above (1 + u)^k for k < 900 roundings of sums of nonnegative numbers
_TINY = 1e-290  # above what underflow loses in any of these sums
_ROOMIER = 1.0 + 1e-8  # so that a bound that was solved for meets, with SLACK, the inequality that is checked


@dataclass(frozen=True, eq=False)
class Affine:
    """All arrays mid + Σ_p lin_p ε_p + r with |r| ≤ rad entrywise.

    Attributes:
        mid: The middles.
        lin: First-order parts, of shape (P, *mid.shape); of parameters beyond P they are zero.
        rad: The radii, nonnegative, of mid's shape.
        boxed: How many of the parameters, the first ones, are bounded one by one.
    """

    mid: Array
    lin: Array
    rad: Array
    boxed: int = 0
    __array_ufunc__ = None  # so that an array's own operators leave the work to the ones below

    @property
    def magnitude(self) -> Array:
        """The largest |x|."""
        return np.asarray((np.abs(self.mid) + self.spread) * _GROWN)

    @property
    def spread(self) -> Array:
        """The largest |x − mid|."""
        return np.asarray((self.swing + self.rad) * _GROWN)

    @property
    def swing(self) -> Array:
        """The largest |Σ_p lin_p ε_p|, entrywise."""
        box = np.abs(self.lin[: self.boxed]).sum(axis=0)
        return np.asarray(box if self.boxed >= len(self.lin) else box + _lengths(self.lin[self.boxed :]))

    def __getitem__(self, index: Any) -> Affine:
        key = index if isinstance(index, tuple) else (index,)
        return Affine(self.mid[key], self.lin[(slice(None), *key)], self.rad[key], self.boxed)

    def __neg__(self) -> Affine:
        return Affine(-self.mid, -self.lin, self.rad, self.boxed)

    def __add__(self, other: Operand) -> Affine:
        other = affine(other)
        mid, lin = self.mid + other.mid, _sum(self.lin, other.lin, np.broadcast_shapes(self.mid.shape, other.mid.shape))
        rounding = 4.0 * UNIT_ROUNDOFF * (np.abs(mid) + np.abs(lin).sum(axis=0))
        return Affine(mid, lin, (self.rad + other.rad + rounding) * _GROWN, max(self.boxed, other.boxed))

    def __sub__(self, other: Operand) -> Affine:
        return self + -affine(other)

    __radd__ = __add__

    def __mul__(self, factor: Array | float) -> Affine:
        """By exact numbers (of the last axes' shape)."""
        mid, lin = self.mid * factor, self.lin * factor
        rounding = 4.0 * UNIT_ROUNDOFF * (np.abs(mid) + np.abs(lin).sum(axis=0))
        return Affine(mid, lin, (self.rad * np.abs(factor) + rounding) * _GROWN + _TINY, self.boxed)

    __rmul__ = __mul__

    def transposed(self) -> Affine:
        """The last two axes exchanged."""
        mid, lin, rad = (np.swapaxes(part, -1, -2) for part in (self.mid, self.lin, self.rad))
        return Affine(mid, lin, rad, self.boxed)

    def reshape(self, *shape: int) -> Affine:
        """The same numbers in another shape, all of whose entries are given."""
        lin = self.lin.reshape(len(self.lin), *shape)
        return Affine(self.mid.reshape(shape), lin, self.rad.reshape(shape), self.boxed)


Operand: TypeAlias = Affine | Array | float


def affine(value: Operand) -> Affine:
    """A form, or an exact number or array as one."""
    if isinstance(value, Affine):
        return value
    mid = np.asarray(value, dtype=np.float64)
    return Affine(mid, np.zeros((0, *mid.shape)), np.zeros_like(mid))


def _lengths(vectors: Array) -> Array:
    """Euclidean norms over the first axis."""
    return np.asarray(np.sqrt(np.einsum("p...,p...->...", vectors, vectors)) * _GROWN)


def _sum(first: Array, second: Array, shape: tuple[int, ...]) -> Array:
    """First-order parts added; what one has no parameter of is zero there."""
    fewer, more = sorted((first, second), key=len)
    total = np.zeros((len(more), *shape))
    for lin in (fewer, more):
        if len(lin):
            total[: len(lin)] += lin.reshape(len(lin), *(len(shape) + 1 - lin.ndim) * (1,), *lin.shape[1:])
    return total


def stacked(parts: Sequence[Affine], axis: int) -> Affine:
    """Forms of one shape side by side along a new axis."""
    count = max(len(part.lin) for part in parts)
    lin = np.stack([np.broadcast_to(p.lin if len(p.lin) else 0.0, (count, *p.mid.shape)) for p in parts], axis=axis + 1)
    mid, rad = (np.stack(x, axis=axis) for x in zip(*((p.mid, p.rad) for p in parts), strict=True))
    return Affine(mid, lin, rad, max(p.boxed for p in parts))


def joined(parts: Sequence[Affine], axis: int) -> Affine:
    """Forms with equally many parameters one behind the other along an axis, counted from the last (−1, −2, …)."""
    mid, lin, rad = (np.concatenate(x, axis=axis) for x in zip(*((p.mid, p.lin, p.rad) for p in parts), strict=True))
    return Affine(mid, lin, rad, parts[0].boxed)


def summed(value: Affine, axis: int) -> Affine:
    """The sum along an axis, counted from the first."""
    rounding = 4.0 * (value.mid.shape[axis] + 1) * UNIT_ROUNDOFF
    sizes = np.abs(value.mid) + np.abs(value.lin).sum(axis=0)
    rad = value.rad.sum(axis=axis) + rounding * sizes.sum(axis=axis)
    lin = value.lin.sum(axis=axis + 1)
    return Affine(value.mid.sum(axis=axis), lin, rad * (_GROWN + rounding), value.boxed)


def product(subscripts: str, first: Operand, second: Operand) -> Affine:
    """A sum of products in the notation of `numpy.einsum`, without an ellipsis."""
    a, b = affine(first), affine(second)
    inputs, output = subscripts.split("->")
    left, right = inputs.split(",")
    sizes = dict(zip(left + right, a.mid.shape + b.mid.shape, strict=True))
    rounding = 4.0 * (math.prod(size for letter, size in sizes.items() if letter not in output) + 2) * UNIT_ROUNDOFF
    mid = np.einsum(subscripts, a.mid, b.mid)
    by_a = np.einsum(f"P{left},{right}->P{output}", a.lin, b.mid) if len(a.lin) else a.lin.reshape(0, *mid.shape)
    by_b = np.einsum(f"{left},P{right}->P{output}", a.mid, b.lin) if len(b.lin) else b.lin.reshape(0, *mid.shape)
    swing_a, swing_b = a.swing, b.swing
    reach_a, reach_b = np.abs(a.mid) + swing_a, np.abs(b.mid) + swing_b
    rad = np.einsum(subscripts, reach_a, b.rad + rounding * reach_b)
    if np.any(a.rad):
        rad = rad + np.einsum(subscripts, a.rad, reach_b + b.rad)
    if len(a.lin) and len(b.lin):
        rad = rad + np.einsum(subscripts, swing_a, swing_b)
    rounded = np.asarray(rad * (_GROWN + 2.0 * rounding) + _TINY)
    return Affine(mid, _sum(by_a, by_b, mid.shape), rounded, max(a.boxed, b.boxed))


def cross(a: Affine, b: Affine) -> Affine:
    """a × b over the last axis, of forms of equally many axes."""
    letters = "abcdefgh"[: a.mid.ndim]
    here, there = [1, 2, 0], [2, 0, 1]
    subscripts = f"{letters},{letters}->{letters}"
    return product(subscripts, a[..., here], b[..., there]) - product(subscripts, a[..., there], b[..., here])


def sine_versine(angle: Affine) -> tuple[Affine, Affine]:
    """Sin θ and 1 − cos θ: |sin(θ + x) − sin θ − x cos θ| ≤ ½x², and alike for the cosine."""
    sine, cosine, versine = np.sin(angle.mid), np.cos(angle.mid), 2.0 * np.sin(0.5 * angle.mid) ** 2
    bent = 0.5 * angle.spread**2 + 8.0 * UNIT_ROUNDOFF * (1.0 + angle.spread)
    along, across = (bent + np.abs(slope) * angle.rad for slope in (cosine, sine))
    bent_sine = Affine(sine, cosine * angle.lin, along * _GROWN, angle.boxed)
    return bent_sine, Affine(versine, sine * angle.lin, across * _GROWN, angle.boxed)


class FormInverse(NamedTuple):
    """What solves M x = r for all M of a form (B, m, m), by an approximate inverse X of its middle.

    With |I − XM| ≤ E entrywise and a vector w > 0 with Ew < w every M is nonsingular, and for any approximate
    solution x₀ the exact one is x₀ + y with y = X(r − Mx₀) + (I − XM)y, so |y| ≤ (I − E)⁻¹|X(r − Mx₀)|.

    Attributes:
        matrix: M. approximate: X. defect: E, of shape (B, m, m).
        regular: Whether every M is proved nonsingular, of shape (B,).
    """

    matrix: Affine
    approximate: Array
    defect: Array
    regular: Mask

    def solve(self, right: Affine) -> Affine:
        """M⁻¹ r for r (B, m, k); NaN where M may be singular."""
        mid = self.approximate @ right.mid
        lin = self.approximate @ _sum(right.lin, -(self.matrix.lin @ mid), right.mid.shape)
        near = Affine(mid, lin, np.zeros_like(mid), max(self.matrix.boxed, right.boxed))
        size = product("bij,bjk->bik", self.approximate, right - product("bij,bjk->bik", self.matrix, near)).magnitude
        bound = inverses(np.eye(self.defect.shape[1]) - self.defect) @ (size + _TINY) * _ROOMIER
        with np.errstate(invalid="ignore"):
            held = self.regular & np.all((size + self.defect @ bound) * SLACK <= bound, axis=(1, 2))
        return Affine(mid, lin, np.where(held[:, None, None], bound, np.nan), near.boxed)


def inverse(matrix: Affine) -> FormInverse:
    """Prepare to solve systems with all matrices of a form (B, m, m)."""
    approximate, identity = inverses(matrix.mid), np.eye(matrix.mid.shape[1])
    defect = (product("bij,bjk->bik", approximate, matrix) - identity).magnitude
    weight = solve_many(identity - defect, np.ones(defect.shape[:2]))
    with np.errstate(invalid="ignore"):
        shrunk = np.einsum("bij,bj->bi", defect, weight) * SLACK
        regular = np.all((weight > 0.0) & (shrunk < weight), axis=1)
    return FormInverse(matrix, approximate, defect, np.asarray(regular & np.isfinite(defect).all(axis=(1, 2))))
