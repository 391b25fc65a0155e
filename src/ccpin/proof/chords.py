"""Polynomial pieces of paths in q-space: proved bounds of how far a piece strays from its chord.

Rounding. Let p(x_k + t) = Σ c_i tⁱ, s and h doubles near the stretch's offset and length. Its Bernstein coefficients

    β_i = Σ_{j≤i} C(i, j)/C(d, j) a_j,        a_j = h^j Σ_{i≥j} C(i, j) c_i s^{i−j},

are sums of products. Computed by d rounds of synthetic division, every product of a_j has passed d additions that left
it where it was and d steps (a product, an addition, the rounding of s); powers of h (2d), the matrix (2) and its sum
(d) follow: at most 7d + 5 roundings. So the computed b_i is off by at most γ times the same sum of absolute values,
γ = (8d + 16)u, u = 2⁻⁵³ (Higham, Accuracy and Stability, §3.1; the room left is for coefficients of derivatives and for
the sum of absolute values, which is computed too). Binomials up to C(50, 25) are doubles: hence the largest degree.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple, Protocol

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.proof.rounding import UNIT_ROUNDOFF


class Polynomials(Protocol):
    """Pieces Σ c_i (t − x_k)^(d−i) between knots x_k: coefficients c (d + 1, K, n), knots x (K + 1,)."""

    @property
    def c(self) -> Array:
        """The coefficients, highest power first."""

    @property
    def x(self) -> Array:
        """The knots."""


class Chord(NamedTuple):
    """A stretch of one piece.

    Attributes:
        start, end: The end points as computed, of shape (n,).
        deviation: How far the exact polynomial strays from the straight line between them, of shape (n,): rounding
            included.
        rounding: How far the exact start and end are from the computed ones, of shape (2, n).
    """

    start: Array
    end: Array
    deviation: Array
    rounding: Array

    @property
    def middle(self) -> Array:
        """Half way, as a double."""
        return np.asarray(0.5 * (self.start + self.end))

    @property
    def along(self) -> Array:
        """From the middle to the end, as a double."""
        return np.asarray(0.5 * (self.end - self.start))


def chord_of(pieces: Polynomials, start: float, end: float) -> Chord:
    """The stretch from parameter `start` to `end`, both of one piece."""
    chords = chords_of(pieces, np.array([start, end]))
    return Chord(*(values[0] for values in chords))


def chords_of(pieces: Polynomials, knots: Array) -> Chord:
    """The stretches between K + 1 increasing parameters, no two of which lie across a knot of the path: (K, n) each.

    In Bernstein form the polynomial is a convex combination of its coefficients β_i, and the chord of the
    coefficients of the line, b_0 + (i/d)(b_d − b_0): their largest difference bounds the deviation at any parameter.
    """
    bernstein, rounding = _bernstein(pieces, knots[:-1], np.diff(knots))
    first, last = bernstein[0], bernstein[-1]
    along = np.linspace(0.0, 1.0, len(bernstein))[:, None, None]
    line = first + along * (last - first)
    ends = np.abs(first) + np.abs(last)
    straight = 8.0 * UNIT_ROUNDOFF * ends  # of `line`, and of a chord's middle and half as doubles
    away = np.abs(bernstein - line) + rounding
    deviation = away.max(axis=0) * (1.0 + 4.0 * UNIT_ROUNDOFF) + straight
    return Chord(first, last, deviation, np.stack([rounding[0], rounding[-1]], axis=1))


def points_of(pieces: Polynomials, t: Array) -> tuple[Array, Array]:
    """The path at parameters t (K,), and how far the exact points are from these at most: (K, n) each."""
    bernstein, rounding = _bernstein(pieces, t, np.zeros_like(t))
    return bernstein[0], rounding[0]


def _bernstein(pieces: Polynomials, start: Array, length: Array) -> tuple[Array, Array]:
    """Bernstein coefficients of stretches (K,), of shape (d + 1, K, n), and how far the exact ones are from them."""
    degree = len(pieces.c) - 1
    number = np.clip(np.searchsorted(pieces.x, start, side="right") - 1, 0, pieces.c.shape[1] - 1)
    rising = pieces.c[::-1, number]
    powers = np.stack([rising, np.abs(rising)], axis=1)
    offset = (start - pieces.x[number])[:, None]
    offset = np.stack([offset, np.abs(offset)])
    for done in range(degree):
        for i in range(degree - 1, done - 1, -1):
            powers[i] += offset * powers[i + 1]
    steps = np.cumprod(np.stack([np.ones_like(length), *[length] * degree]), axis=0)
    scaled = powers * steps[:, None, :, None]
    values, sizes = np.moveaxis(np.tensordot(_to_bernstein(degree), scaled, axes=1), 1, 0)
    return values, (8 * degree + 16) * UNIT_ROUNDOFF * sizes + np.finfo(np.float64).tiny


@lru_cache
def _to_bernstein(degree: int) -> Array:
    """C(i, j)/C(d, j), of shape (d + 1, d + 1)."""
    rows = range(degree + 1)
    return frozen(np.array([[math.comb(i, j) / math.comb(degree, j) for j in rows] for i in rows]))
