"""Arrays of balls in doubles: midpoints and radii, every operation rounded outwards.

A `BallArray` stands for all arrays x with |x − mid| ≤ rad by entry. Sums, products and quotients of doubles are those
of IEEE 754 up to the order of summation: the computed value differs from the exact one by at most u = 2⁻⁵³ of it, a
sum of k products by at most ku of the sum of their sizes (to first order; 2ku is taken), unless it underflows, which
`_LEAST` covers. Radii are computed from sizes alone and widened by as much again. Nothing else is used of the
processor: sines and cosines come from ball arithmetic.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic import balls
from ccpin.validated.arithmetic.balls import Ball, ball, centre_of, flint, upper

_UNIT = 2.0**-53  # roundoff of a double
_LEAST = 1e-290  # above what thousands of underflows add
_OUT = 1.0 + 2.0**-46  # on a radius: covers the roundings in computing it
_TRIGONOMETRIC = 2.0**-50  # a sine in a ball of 64 bits rounded to a double
_BITS = 64  # in which sines and gains are enclosed, before they are rounded to doubles


class BallArray(NamedTuple):
    """Arrays of balls: midpoints and radii of one shape."""

    mid: Array
    rad: Array

    def __add__(self, other: Any) -> BallArray:
        mid = self.mid + other.mid
        rad = np.abs(mid)
        rad *= _UNIT
        rad += self.rad
        rad += other.rad
        rad *= _OUT
        return BallArray(mid, rad)

    def __sub__(self, other: BallArray) -> BallArray:
        return self + -other

    def __neg__(self) -> BallArray:
        return BallArray(-self.mid, self.rad)

    def __mul__(self, other: Any) -> BallArray:
        mid = self.mid * other.mid
        rad = np.abs(mid)
        rad *= 2 * _UNIT
        rad += self.rad * (np.abs(other.mid) + other.rad)
        rad += np.abs(self.mid) * other.rad
        rad *= _OUT
        rad += _LEAST
        return BallArray(mid, rad)

    def __matmul__(self, other: BallArray) -> BallArray:
        mid = self.mid @ other.mid
        left, right = np.abs(self.mid), np.abs(other.mid)
        rounding = 4 * _UNIT * (self.mid.shape[-1] + 2)
        rad = left @ (other.rad + rounding * right) + self.rad @ (right + other.rad)
        return BallArray(mid, rad * (1.0 + rounding) * _OUT + _LEAST)

    def at(self, index: Any) -> BallArray:
        """A part of the arrays."""
        return BallArray(self.mid[index], self.rad[index])

    def swapped(self, first: int, second: int) -> BallArray:
        """Two axes exchanged."""
        return BallArray(self.mid.swapaxes(first, second), self.rad.swapaxes(first, second))

    def balls(self) -> list[Ball]:
        """A vector's entries, one by one."""
        return [flint().arb(mid, rad) for mid, rad in zip(self.mid.tolist(), self.rad.tolist(), strict=True)]

    @property
    def size(self) -> Array:
        """Upper bounds of |x|."""
        return np.asarray((np.abs(self.mid) + self.rad) * _OUT)


def exactly(values: Any) -> BallArray:
    """Doubles as balls of radius 0."""
    return BallArray(values, np.zeros_like(values))


def raised(bound: Array) -> Array:
    """A bound made of at most some hundred sums and products of doubles that are not negative, rounded up."""
    return np.asarray(bound * _OUT + _LEAST)


def stacked(parts: Iterable[BallArray], axis: int = -1) -> BallArray:
    """Arrays of balls joined along a new axis."""
    mids, rads = zip(*parts, strict=True)
    return BallArray(np.stack(mids, axis), np.stack(rads, axis))


def joined(first: BallArray, second: BallArray) -> BallArray:
    """Two stacks of arrays of balls as one."""
    return BallArray(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))


def zeros(*shape: int) -> BallArray:
    """Zeros, to be written to."""
    return BallArray(np.zeros(shape), np.zeros(shape))


def hull(stack: BallArray, group: int) -> BallArray:
    """Balls around each group of so many in a stack."""
    shape = (-1, group, *stack.mid.shape[1:])
    lower, upper = ((stack.mid + sign * stack.rad).reshape(shape) for sign in (-1.0, 1.0))
    low, high = lower.min(axis=1), upper.max(axis=1)
    mid = 0.5 * (low + high)
    reach = np.maximum(high - mid, mid - low)
    return BallArray(mid, (reach + 4 * _UNIT * np.maximum(np.abs(low), np.abs(high))) * _OUT)


def of_balls(rows: Sequence[Sequence[Ball]]) -> BallArray:
    """A table of balls in doubles, of radii `_LEAST` or more: products of subnormal ones are much slower."""
    mid = np.array([centre_of(row) for row in rows])
    rad = np.array(
        [
            [upper(abs(x - ball(c))) for x, c in zip(row, centre, strict=True)]
            for row, centre in zip(rows, mid.tolist(), strict=True)
        ]
    )
    return BallArray(mid, np.maximum(rad, _LEAST))


def sine_and_cosine(angle: BallArray) -> tuple[BallArray, BallArray]:
    """|sin(m + d) − sin m| ≤ |cos m| r + r²/2 for |d| ≤ r, and alike for the cosine."""
    with flint().ctx.workprec(_BITS):
        pairs = [flint().arb(x).sin_cos() for x in angle.mid.ravel().tolist()]
    sine, cosine = (np.array([float(pair[k]) for pair in pairs]).reshape(angle.mid.shape) for k in (0, 1))
    bend = 0.5 * angle.rad**2

    def around(value: Array, slope: Array) -> BallArray:
        reach = np.minimum((np.abs(slope) + _TRIGONOMETRIC) * angle.rad + bend, 2.0)
        return BallArray(value, (reach + _TRIGONOMETRIC) * _OUT)

    return around(sine, cosine), around(cosine, sine)


def gain(cosine: BallArray, order: int) -> BallArray:
    """A derivative of `ccpin.validated.arithmetic.balls.gain`'s function over balls of shape (B,)."""
    with flint().ctx.workprec(_BITS):
        found = of_balls([[balls.gain(x, order)] for x in cosine.balls()])
    return found.at(np.s_[:, 0])


def inverse(matrix: BallArray) -> BallArray | None:
    """Balls around the inverses of all matrices in a stack (…, m, m); ``None`` where some are not proven to exist.

    With C ≈ mid⁻¹ and N ≥ |I − CA|, ‖N‖∞ = δ < 1: A⁻¹ = (CA)⁻¹C and |(CA)⁻¹ − I| ≤ N + δ²/(1 − δ) by entry.
    """
    try:
        near = np.linalg.inv(matrix.mid)
    except np.linalg.LinAlgError:
        return None
    identity = np.eye(matrix.mid.shape[-1])
    off = (exactly(np.broadcast_to(identity, near.shape)) - exactly(near) @ matrix).size
    delta = off.sum(axis=-1).max(axis=-1) * _OUT
    if not np.all(delta < 0.99):  # NaN too
        return None
    rest = (delta**2 / (1.0 - delta) * _OUT)[..., None, None]
    return BallArray(np.broadcast_to(identity, near.shape), (off + rest) * _OUT) @ exactly(near)
