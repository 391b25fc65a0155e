"""Paths in q-space as polynomial pieces."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline, PPoly

from ccpin.arrays import Array, numbers
from ccpin.errors import InvalidInputError
from ccpin.proof.chords import chords_of

_CONTINUOUS = 1e-9  # rad, m: jumps as wide are crossed straight, wider ones refused (knots are typed in decimals)
_DEGREE = 50  # binomials up to C(50, 25) are doubles (`ccpin.proof.chords`)


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
