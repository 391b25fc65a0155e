"""Functions of ξ ∈ [−1, 1]^D to first order: arrays of them in doubles, every operation rounded outwards.

A `FirstOrder` stands for all arrays x of functions with |x(ξ) − mid − slopes·ξ| ≤ rad by entry, for all ξ. What depends
on the same numbers thus cancels, and what is lost is of second order in them. Roundings are those of IEEE doubles, as
in `ccpin.validated.arithmetic.ball_arrays`; radii are computed from sizes alone and widened by `_OUT`. A bound that
cannot be had is no number or ∞, which no comparison takes for small.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.balls import flint

_UNIT = 2.0**-53  # roundoff of a double
_OUT = 1.0 + 2.0**-43  # on a radius: covers the roundings in computing it, of sums of up to 500 numbers too
_LEAST = 1e-290  # above what thousands of underflows add
_TRIGONOMETRIC = 2.0**-50  # a sine in a ball of 64 bits rounded to a double
_BITS = 64  # in which sines are enclosed, before they are rounded to doubles


class FirstOrder(NamedTuple):
    """Functions of ξ: values at 0 and radii of one shape, slopes of that shape and one axis more."""

    mid: Array
    slopes: Array
    rad: Array

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
        return FirstOrder(
            self.mid + other.mid, self.slopes + other.slopes, (self.rad + other.rad + rounding) * _OUT + _LEAST
        )

    def __sub__(self, other: FirstOrder) -> FirstOrder:
        return self + -other

    def __neg__(self) -> FirstOrder:
        return FirstOrder(-self.mid, -self.slopes, self.rad)

    def __mul__(self, other: Any) -> FirstOrder:
        """(m + l)(m′ + l′) = m m′ + m l′ + m′ l + l l′, what has no slope below in size."""
        mine, yours = self.mid[..., None], other.mid[..., None]
        rad = np.abs(self.mid) * other.rad + np.abs(other.mid) * self.rad + self.spread * other.spread
        rad = rad + 4 * _UNIT * self.size * other.size
        return FirstOrder(self.mid * other.mid, mine * other.slopes + yours * self.slopes, rad * _OUT + _LEAST)

    def scaled(self, factor: float, off: float) -> FirstOrder:
        """Times all numbers that are at most `off` from a factor."""
        rad = abs(factor) * self.rad + off * self.size + 2 * _UNIT * abs(factor) * self.size
        return FirstOrder(factor * self.mid, factor * self.slopes, rad * _OUT + _LEAST)

    def widened(self, by: Array) -> FirstOrder:
        """All functions at most so far from these."""
        return self._replace(rad=(self.rad + by) * _OUT)


def linear(mid: Array, slopes: Array) -> FirstOrder:
    """Linear functions."""
    return FirstOrder(mid, slopes, np.zeros_like(mid))


def constant(value: float, off: float, axes: int) -> FirstOrder:
    """All numbers at most `off` from a value, at every row."""
    return FirstOrder(np.array([value]), np.zeros((1, axes)), np.array([off]))


def reciprocal(x: FirstOrder) -> FirstOrder:
    """1/x = 1/m − (x − m)/m² + (x − m)²/(m²x)."""
    inverse = 1.0 / x.mid
    square = inverse * inverse
    with np.errstate(all="ignore"):
        bend = np.where(x.least > 0.0, x.spread**2 * square / x.least, np.inf)
    rad = x.rad * square + bend + 8 * _UNIT * np.abs(inverse)  # spread < |m|, or it is ∞
    return FirstOrder(inverse, -x.slopes * square[..., None], rad * _OUT + _LEAST)


def root(x: FirstOrder) -> FirstOrder:
    """√x = √m + (x − m)/(2√m) − at most (x − m)²/(8 min(x)^(3/2))."""
    with np.errstate(all="ignore"):
        positive = (x.mid > 0.0) & (x.least > 0.0)
        middle = np.sqrt(np.where(positive, x.mid, 1.0))
        bend = np.where(positive, x.spread**2 / (8 * x.least * np.sqrt(x.least)), np.inf)
    slope = 0.5 / middle
    rad = x.rad * slope + bend + 8 * _UNIT * middle  # spread < m, or it is ∞
    return FirstOrder(middle, x.slopes * slope[..., None], rad * _OUT)


def sine_and_cosine(angle: FirstOrder) -> tuple[FirstOrder, FirstOrder]:
    """|sin(m + d) − sin m − d cos m| ≤ d²/2, and alike for the cosine."""
    with flint().ctx.workprec(_BITS):
        pairs = [flint().arb(x).sin_cos() for x in angle.mid.ravel().tolist()]
    sine, cosine = (np.array([float(pair[k].mid()) for pair in pairs]).reshape(angle.mid.shape) for k in (0, 1))

    def around(value: Array, slope: Array) -> FirstOrder:
        rad = (np.abs(slope) + _TRIGONOMETRIC) * angle.rad + 0.5 * angle.spread**2
        rad = rad + 2 * _TRIGONOMETRIC * (1.0 + angle.spread)
        return FirstOrder(value, angle.slopes * slope[..., None], rad * _OUT)

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
