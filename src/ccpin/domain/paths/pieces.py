"""Paths in q-space as polynomial pieces, with proved bounds of how far a piece strays from its chord.

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
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PPoly

from ccpin.arrays import Array, frozen, numbers
from ccpin.errors import InvalidInputError
from ccpin.proof.rounding import UNIT_ROUNDOFF

_CONTINUOUS = 1e-9
_DEGREE = 50


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


def pieces_of(path: ArrayLike | PPoly | BSpline, n: int) -> PPoly:
    """Read a polyline (waypoints of shape (K, n), parameter 0 … K − 1) or a SciPy spline with values of shape (n,).

    Raises:
        InvalidInputError: It has the wrong shape, is not finite, is of a degree above 50, overflows, or is proved to
            jump by more than 1e-9.
    """
    if isinstance(path, BSpline):
        path = _polynomials(path, path.k, _increasing(np.unique(path.t[path.k : len(path.t) - path.k])))
    if isinstance(path, PPoly):
        knots, coefficients = _increasing(numbers(path.x, "knots")), numbers(path.c, "coefficients")
        if coefficients.ndim != 3 or coefficients.shape[1:] != (len(knots) - 1, n):
            raise InvalidInputError(
                f"a spline of {len(knots)} knots with values of shape ({n},) has coefficients of shape "
                f"(degree + 1, {len(knots) - 1}, {n}), not {path.c.shape}"
            )
        long = np.flatnonzero(np.diff(knots) > 0.0)
        knots, coefficients = np.append(knots[long], knots[long[-1] + 1]), coefficients[:, long]
    else:
        points = numbers(path, "path")
        if points.ndim != 2 or points.shape[1] != n or len(points) < 2:
            raise InvalidInputError(f"a path is at least two waypoints of shape (K, {n}); it has shape {points.shape}")
        knots, coefficients = np.arange(len(points), dtype=np.float64), np.stack([np.diff(points, axis=0), points[:-1]])
    if not (np.all(np.isfinite(coefficients)) and np.all(np.isfinite(knots))):
        raise InvalidInputError("the path is not finite")
    if len(coefficients) - 1 > _DEGREE:
        raise InvalidInputError(f"the path is of degree {len(coefficients) - 1}; degrees up to {_DEGREE} are bounded")
    pieces = PPoly(coefficients, knots)
    with np.errstate(all="ignore"):
        whole = chords_of(pieces, knots)
    if not np.all(np.isfinite(whole.deviation)):
        raise InvalidInputError("the path's polynomials overflow on their stretches")
    least = np.abs(whole.start[1:] - whole.end[:-1]) - whole.rounding[1:, 0] - whole.rounding[:-1, 1]
    jumps = least.max(axis=1, initial=0.0)
    if np.any(jumps > _CONTINUOUS):
        worst = int(np.argmax(jumps))
        raise InvalidInputError(f"the path jumps by {jumps[worst]:.3g} at parameter {knots[worst + 1]:.6g}")
    return pieces


def _increasing(knots: Array) -> Array:
    """Knots, if they nowhere decrease and do increase."""
    if knots.ndim != 1 or not np.any(np.diff(knots) > 0.0) or np.any(np.diff(knots) < 0.0):
        raise InvalidInputError("the path's knots do not increase")
    return knots


def _polynomials(spline: BSpline | PPoly, degree: int, knots: Array) -> PPoly:
    """A spline by its Taylor coefficients at each knot, one polynomial between two distinct knots."""
    coefficients = [spline(knots[:-1], nu=k) / math.factorial(k) for k in reversed(range(degree + 1))]
    return PPoly(np.array(coefficients), knots)


def chord_of(pieces: PPoly, start: float, end: float) -> Chord:
    """The stretch from parameter `start` to `end`, both of one piece."""
    chords = chords_of(pieces, np.array([start, end]))
    return Chord(*(values[0] for values in chords))


def chords_of(pieces: PPoly, knots: Array) -> Chord:
    """The stretches between K + 1 increasing parameters, no two of which lie across a knot of the path: (K, n) each.

    In Bernstein form the polynomial is a convex combination of its coefficients β_i, and the chord of the
    coefficients of the line, b_0 + (i/d)(b_d − b_0): their largest difference bounds the deviation at any parameter.
    """
    bernstein, rounding = _bernstein(pieces, knots[:-1], np.diff(knots))
    first, last = bernstein[0], bernstein[-1]
    along = np.linspace(0.0, 1.0, len(bernstein))[:, None, None]
    line = first + along * (last - first)
    straight = (
        8.0 * UNIT_ROUNDOFF * (np.abs(first) + np.abs(last))
    )  # of `line`, and of a chord's middle and half as doubles
    away = np.abs(bernstein - line) + rounding
    deviation = away.max(axis=0) * (1.0 + 4.0 * UNIT_ROUNDOFF) + straight
    return Chord(first, last, deviation, np.stack([rounding[0], rounding[-1]], axis=1))


def points_of(pieces: PPoly, t: Array) -> tuple[Array, Array]:
    """The path at parameters t (K,), and how far the exact points are from these at most: (K, n) each."""
    bernstein, rounding = _bernstein(pieces, t, np.zeros_like(t))
    return bernstein[0], rounding[0]


def _bernstein(pieces: PPoly, start: Array, length: Array) -> tuple[Array, Array]:
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
