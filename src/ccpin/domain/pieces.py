"""Paths in q-space as polynomial pieces, with bounds of how far a piece strays from its chord."""

from __future__ import annotations

import math
from functools import reduce
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BPoly, BSpline, PPoly

from ccpin.arrays import Array, numbers
from ccpin.errors import InvalidInputError

_CONTINUOUS = 1e-9


class Chord(NamedTuple):
    """A stretch of one piece: end points (n,), and how far it strays from the straight line between them, (n,)."""

    start: Array
    end: Array
    deviation: Array


def pieces_of(path: ArrayLike | PPoly | BSpline, n: int) -> PPoly:
    """Read a polyline (waypoints of shape (K, n), parameter 0 … K − 1) or a SciPy spline with values of shape (n,).

    Raises:
        InvalidInputError: It has the wrong shape, is not finite, or jumps.
    """
    if isinstance(path, BSpline):
        path = _polynomials(path, path.k, np.unique(path.t[path.k : len(path.t) - path.k]))
    if isinstance(path, PPoly):
        knots, coefficients = np.asarray(path.x, dtype=np.float64), np.asarray(path.c, dtype=np.float64)
        if coefficients.ndim != 3 or coefficients.shape[2] != n:
            raise InvalidInputError(f"the spline's values must have shape ({n},); its coefficients have {path.c.shape}")
        long = np.flatnonzero(np.diff(knots) > 0.0)
        knots, coefficients = np.append(knots[long], knots[long[-1] + 1]), coefficients[:, long]
    else:
        points = numbers(path, "path")
        if points.ndim != 2 or points.shape[1] != n or len(points) < 2:
            raise InvalidInputError(f"a path is at least two waypoints of shape (K, {n}); it has shape {points.shape}")
        knots, coefficients = np.arange(len(points), dtype=np.float64), np.stack([np.diff(points, axis=0), points[:-1]])
    if not (np.all(np.isfinite(coefficients)) and np.all(np.isfinite(knots))):
        raise InvalidInputError("the path is not finite")
    ends = reduce(lambda total, c: total * np.diff(knots)[:-1, None] + c, coefficients[:, :-1])
    jumps = np.abs(ends - coefficients[-1, 1:]).max(axis=1, initial=0.0)
    if np.any(jumps > _CONTINUOUS):
        worst = int(np.argmax(jumps))
        raise InvalidInputError(f"the path jumps by {jumps[worst]:.3g} at parameter {knots[worst + 1]:.6g}")
    return PPoly(coefficients, knots)


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

    In Bernstein form the polynomial is a convex combination of its coefficients b_i, and the chord of the
    coefficients of the line, b_0 + (i/d)(b_d − b_0): their largest difference bounds the deviation at any parameter.
    """
    degree = len(pieces.c) - 1
    bernstein = BPoly.from_power_basis(_polynomials(pieces, degree, knots)).c
    along = np.linspace(0.0, 1.0, degree + 1)[:, None, None]
    line = bernstein[0] + along * (bernstein[-1] - bernstein[0])
    rounding = 1e-14 * (1.0 + np.abs(bernstein).max(axis=0))
    return Chord(bernstein[0], bernstein[-1], np.abs(bernstein - line).max(axis=0) + rounding)
