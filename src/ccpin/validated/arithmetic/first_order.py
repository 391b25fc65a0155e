"""Functions of ξ ∈ [−1, 1]^D to first order: arrays of them in doubles, every operation rounded outwards.

A `FirstOrder` stands for all arrays x of functions with |x(ξ) − mid − slopes·ξ| ≤ rad by entry, for all ξ. What depends
on the same numbers thus cancels, and what is lost is of second order in them. Where axes are `Products` of others,
ξ_k = ξ_i ξ_j, so do such terms, and of them what is lost is of third order. Roundings are those of IEEE doubles, as
in `ccpin.validated.arithmetic.ball_arrays`; radii are computed from sizes alone and widened by `_OUT`. A bound that
cannot be had is no number or ∞, which no comparison takes for small.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.validated.arithmetic.balls import flint

_UNIT = 2.0**-53  # roundoff of a double
_OUT = 1.0 + 2.0**-43  # on a radius: covers the roundings in computing it, of sums of up to 500 numbers too
_LEAST = 1e-290  # above what thousands of underflows add
_TRIGONOMETRIC = 2.0**-50  # a sine in a ball of 64 bits rounded to a double
_BITS = 64  # in which sines are enclosed, before they are rounded to doubles


class Products(NamedTuple):
    """Axes that are products of two others, after all others.

    Attributes:
        first, second: Of which ones each of them is.
        groups: Of which group every axis is, as columns of 0 and 1.
        apart: Of which two groups products are no axes, 0 or 1.
    """

    first: Indices
    second: Indices
    groups: Array
    apart: Array


class FirstOrder(NamedTuple):
    """Functions of ξ: values at 0 and radii of one shape, slopes of that shape and one axis more, and its products."""

    mid: Array
    slopes: Array
    rad: Array
    products: Products | None = None

    @property
    def spread(self) -> Array:
        """Upper bounds of |x − mid|."""
        return np.asarray((np.abs(self.slopes).sum(axis=-1) + self.rad) * _OUT)

    @property
    def size(self) -> Array:
        """Upper bounds of |x|."""
        return np.asarray((np.abs(self.mid) + self.spread) * _OUT)

    @property
    def least(self) -> Array:
        """Lower bounds of |x|, below 0 where x may vanish."""
        return np.asarray(np.abs(self.mid) * (2.0 - _OUT) - self.spread * _OUT)

    def __add__(self, other: Any) -> FirstOrder:
        rounding = 2 * _UNIT * (self.size + other.size)
        rad = (self.rad + other.rad + rounding) * _OUT + _LEAST
        return FirstOrder(self.mid + other.mid, self.slopes + other.slopes, rad, self.products)

    def __sub__(self, other: FirstOrder) -> FirstOrder:
        return self + -other

    def __neg__(self) -> FirstOrder:
        return FirstOrder(-self.mid, -self.slopes, self.rad, self.products)

    def __mul__(self, other: Any) -> FirstOrder:
        """(m + l)(m′ + l′) = m m′ + m l′ + m′ l + l l′; of l l′ what is on no axis by its size."""
        mine, yours = self.mid[..., None], other.mid[..., None]
        slopes, products = mine * other.slopes + yours * self.slopes, self.products
        rad = np.abs(self.mid) * other.rad + np.abs(other.mid) * self.rad
        if products is None:
            rad = rad + self.spread * other.spread
        else:
            i, j = products.first, products.second
            both = self.slopes[..., i] * other.slopes[..., j]
            both += np.where(i == j, 0.0, self.slopes[..., j] * other.slopes[..., i])
            slopes[..., slopes.shape[-1] - len(i) :] += both
            a, b = (np.abs(each.slopes) @ products.groups for each in (self, other))  # by group, |l| at most
            rad = rad + ((a @ products.apart) * b).sum(axis=-1) + a.sum(axis=-1) * other.rad + self.rad * other.spread
        rad = rad + 4 * _UNIT * self.size * other.size
        return FirstOrder(self.mid * other.mid, slopes, rad * _OUT + _LEAST, products)

    def scaled(self, factor: float, off: float) -> FirstOrder:
        """Times all numbers that are at most `off` from a factor."""
        rad = abs(factor) * self.rad + off * self.size + 2 * _UNIT * abs(factor) * self.size
        return FirstOrder(factor * self.mid, factor * self.slopes, rad * _OUT + _LEAST, self.products)

    def widened(self, by: Array) -> FirstOrder:
        """All functions at most so far from these."""
        return self._replace(rad=(self.rad + by) * _OUT)

    def beside(self, products: Products) -> FirstOrder:
        """The same, with axes that are products of its own."""
        none = np.zeros((*self.mid.shape, len(products.first)))
        return self._replace(slopes=np.concatenate([self.slopes, none], axis=-1), products=products)

    @property
    def bent(self) -> FirstOrder:
        """(x − m)²."""
        off = self._replace(mid=np.zeros_like(self.mid))
        return off * off


def products_of(sizes: Sequence[int], joined: Sequence[tuple[int, int]]) -> Products:
    """Products of axes that stand in groups of these sizes: of any two whose groups, or whose group, are joined."""
    names, last = np.repeat(np.arange(len(sizes)), sizes), len(sizes)
    among = np.zeros((last, last), dtype=np.bool_)
    for a, b in joined:
        among[a, b] = among[b, a] = True
    first, second = np.nonzero(np.triu(among[np.ix_(names, names)]))
    groups = np.eye(last + 1)[np.concatenate([names, np.full(len(first), last)])]
    return Products(first, second, groups, np.pad(1.0 - among, (0, 1), constant_values=1.0))


def linear(mid: Array, slopes: Array, products: Products | None = None) -> FirstOrder:
    """Linear functions."""
    return FirstOrder(mid, slopes, np.zeros_like(mid), products)


def constant(value: float, off: float, axes: int, products: Products | None = None) -> FirstOrder:
    """All numbers at most `off` from a value, at every row."""
    return FirstOrder(np.array([value]), np.zeros((1, axes)), np.array([off]), products)


def reciprocal(x: FirstOrder) -> FirstOrder:
    """1/x = 1/m − (x − m)/m² + (x − m)²/m³ − (x − m)³/(m³x)."""
    inverse = 1.0 / x.mid
    square, bent = inverse * inverse, x.bent
    cube = square * inverse
    with np.errstate(all="ignore"):
        rest = np.where(x.least > 0.0, (x.spread * np.abs(inverse)) ** 3 / x.least, np.inf)
    slopes = cube[..., None] * bent.slopes - square[..., None] * x.slopes
    rad = x.rad * square + bent.rad * np.abs(cube) + rest + 16 * _UNIT * np.abs(inverse)  # spread < |m|, or it is ∞
    return FirstOrder(inverse, slopes, rad * _OUT + _LEAST, x.products)


def root(x: FirstOrder) -> FirstOrder:
    """√x = √m + (x − m)/(2√m) − at most (x − m)²/(8 min(x)^(3/2))."""
    with np.errstate(all="ignore"):
        positive = (x.mid > 0.0) & (x.least > 0.0)
        middle = np.sqrt(np.where(positive, x.mid, 1.0))
        bend = np.where(positive, x.spread**2 / (8 * x.least * np.sqrt(x.least)), np.inf)
    slope = 0.5 / middle
    rad = x.rad * slope + bend + 8 * _UNIT * middle  # spread < m, or it is ∞
    return FirstOrder(middle, x.slopes * slope[..., None], rad * _OUT, x.products)


def sine_and_cosine(angle: FirstOrder) -> tuple[FirstOrder, FirstOrder]:
    """|sin(m + d) − sin m − d cos m + (d²/2) sin m| ≤ |d|³/6, and alike for the cosine."""
    with flint().ctx.workprec(_BITS):
        pairs = [flint().arb(x).sin_cos() for x in angle.mid.ravel().tolist()]
    sine, cosine = (np.array([float(pair[k].mid()) for pair in pairs]).reshape(angle.mid.shape) for k in (0, 1))

    bent = angle.bent

    def around(value: Array, slope: Array) -> FirstOrder:
        rad = (np.abs(slope) + _TRIGONOMETRIC) * angle.rad + 0.5 * np.abs(value) * bent.rad
        rad = rad + angle.spread**3 / 6 + 2 * _TRIGONOMETRIC * (1.0 + angle.spread) ** 2
        slopes = slope[..., None] * angle.slopes - (0.5 * value)[..., None] * bent.slopes
        return FirstOrder(value, slopes, rad * _OUT, angle.products)

    return around(sine, cosine), around(cosine, -sine)


def preconditioned(matrix: Array, table: list[list[FirstOrder]], *, less_identity: bool = False) -> Array:
    """Upper bounds of |C T|, or of |I − C T|, by entry, of shape (B, m, k), for C of shape (B, m, m)."""
    mid, rad = (
        np.stack([np.stack([getattr(entry, part) for entry in row], axis=-1) for row in table], axis=-2)
        for part in ("mid", "rad")
    )  # (B, m, k)
    slopes = np.stack([np.stack([entry.slopes for entry in row], axis=-2) for row in table], axis=-3)
    size = np.stack([np.stack([entry.size for entry in row], axis=-1) for row in table], axis=-2)
    m = matrix.shape[-1]
    near = matrix @ mid
    if less_identity:
        near = np.eye(m) - near
    moving = np.abs(np.einsum("bij,bjkd->bikd", matrix, slopes)).sum(axis=-1)
    sizes = np.abs(matrix) @ size + (1.0 if less_identity else 0.0)
    found = np.abs(near) + moving + np.abs(matrix) @ rad + 8 * (m + 2) * _UNIT * sizes
    return np.asarray(found * _OUT + _LEAST)
