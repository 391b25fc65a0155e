"""Paths in q-space as polynomial pieces, with bounds of how far a piece strays from its chord."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import BSpline, PPoly
from scipy.special import comb

from ccpin.errors import InvalidInputError

Array = NDArray[np.float64]
_CONTINUOUS = 1e-9


class Pieces(NamedTuple):
    """A continuous path of P polynomial pieces in n coordinates.

    Attributes:
        knots: Parameters where pieces meet, of shape (P + 1,).
        coefficients: Of (t − knot)ᵏ, of shape (P, degree + 1, n), lowest power first.
    """

    knots: Array
    coefficients: Array

    def at(self, t: Array) -> Array:
        """Points of the path at parameters (K,), of shape (K, n)."""
        piece = np.clip(np.searchsorted(self.knots, t, side="right") - 1, 0, len(self.coefficients) - 1)
        x = t - self.knots[piece]
        powers = x[:, None] ** np.arange(self.coefficients.shape[1])
        return np.asarray(np.sum(powers[..., None] * self.coefficients[piece], axis=1))


class Chord(NamedTuple):
    """A stretch of one piece: end points (n,), and how far it strays from the straight line between them, (n,)."""

    start: Array
    end: Array
    deviation: Array


def pieces_of(path: ArrayLike | PPoly | BSpline, n: int) -> Pieces:
    """Read a polyline (waypoints of shape (K, n), parameter 0 … K − 1) or a SciPy spline with values of shape (n,).

    Raises:
        InvalidInputError: It has the wrong shape, is not finite, or jumps.
    """
    if isinstance(path, BSpline):
        path = _polynomials(path)
    if isinstance(path, PPoly):
        knots, coefficients = np.asarray(path.x, dtype=np.float64), np.asarray(path.c, dtype=np.float64)[::-1]
        if coefficients.ndim != 3 or coefficients.shape[2] != n:
            raise InvalidInputError(f"the spline's values must have shape ({n},); its coefficients have {path.c.shape}")
        long = np.flatnonzero(np.diff(knots) > 0.0)
        pieces = Pieces(np.append(knots[long], knots[long[-1] + 1]), np.moveaxis(coefficients, 0, 1)[long])
    else:
        points = np.asarray(path, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != n or len(points) < 2:
            raise InvalidInputError(f"a path is at least two waypoints of shape (K, {n}); it has shape {points.shape}")
        steps = np.stack([points[:-1], np.diff(points, axis=0)], axis=1)
        pieces = Pieces(np.arange(len(points), dtype=np.float64), steps)
    if not (np.all(np.isfinite(pieces.coefficients)) and np.all(np.isfinite(pieces.knots))):
        raise InvalidInputError("the path is not finite")
    _refuse_jumps(pieces)
    return pieces


def _polynomials(spline: BSpline) -> PPoly:
    """A B-spline by its Taylor coefficients at each knot, one polynomial between two distinct knots."""
    degree = spline.k
    knots = np.unique(spline.t[degree : len(spline.t) - degree])
    coefficients = [spline(knots[:-1], nu=k) / math.factorial(k) for k in reversed(range(degree + 1))]
    return PPoly(np.array(coefficients), knots)


def _refuse_jumps(pieces: Pieces) -> None:
    lengths = np.diff(pieces.knots)[:-1, None]
    powers = lengths ** np.arange(pieces.coefficients.shape[1])
    ends = np.sum(powers[..., None] * pieces.coefficients[:-1], axis=1)
    jumps = np.abs(ends - pieces.coefficients[1:, 0]).max(axis=1, initial=0.0)
    if np.any(jumps > _CONTINUOUS):
        worst = int(np.argmax(jumps))
        raise InvalidInputError(f"the path jumps by {jumps[worst]:.3g} at parameter {pieces.knots[worst + 1]:.6g}")


def chord_of(pieces: Pieces, piece: int, start: float, end: float) -> Chord:
    """The stretch from parameter `start` to `end` of one piece.

    In Bernstein form the polynomial is a convex combination of its coefficients b_i, and the chord of the
    coefficients of the line, b_0 + (i/d)(b_d − b_0): their largest difference bounds the deviation.
    """
    local = pieces.coefficients[piece]
    degree = len(local) - 1
    x, width = start - pieces.knots[piece], end - start
    shifted = np.array(
        [
            sum(comb(j, k, exact=True) * local[j] * x ** (j - k) for j in range(k, degree + 1)) * width**k
            for k in range(degree + 1)
        ]
    )
    bernstein = np.array(
        [
            sum(comb(i, k, exact=True) / comb(degree, k, exact=True) * shifted[k] for k in range(i + 1))
            for i in range(degree + 1)
        ]
    )
    line = bernstein[0] + np.linspace(0.0, 1.0, degree + 1)[:, None] * (bernstein[-1] - bernstein[0])
    rounding = 1e-14 * (1.0 + np.abs(bernstein).max(axis=0))
    return Chord(bernstein[0], bernstein[-1], np.abs(bernstein - line).max(axis=0) + rounding)
