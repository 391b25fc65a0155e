"""The exact closed start: existence and uniqueness of y with φ(q, y) = 0 near a computed one.

Krawczyk's theorem. Let Y be a box about y, A any matrix, and let

    K = y − A φ(q, y) + (I − A ∂φ/∂y(q, Y)) (Y − y)

lie in the interior of Y for every q of a box. Then for every such q there is exactly one solution in Y, it lies in K,
and ∂φ/∂y is nonsingular on Y.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.errors import ConvergenceError
from ccpin.validated.balls import Ball, around, ball, flint, midpoints
from ccpin.validated.dynamics import ClosedLoop
from ccpin.validated.series import values

Array = NDArray[np.float64]
_NEWTON_STEPS = 20
_UNIQUE = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)


def closed_start(loop: ClosedLoop, q: Sequence[Ball], q_free: Array) -> list[Ball]:
    """The one closed configuration near the computed q′ at every q of a box, as a box as small as the precision gives.

    "Near" is the largest of a few radii (rad or m) for which it is unique, and at most 1e-2.

    Raises:
        ConvergenceError: It is not proven; most likely q′ is open or nearly singular.
    """
    near = [ball(float(q_free[k])) for k in loop.dependent]
    y = _newton(loop, midpoints(q), near)
    far = max((abs(a - b).upper() for a, b in zip(y, near, strict=True)), default=ball(0))
    for radius in _UNIQUE:
        proven = krawczyk(loop, q, y, [ball(radius)] * len(y))
        if proven is not None and far < radius:
            return _assemble(loop, q, _sharpened(loop, q, y, proven))
    raise ConvergenceError(
        "no closed configuration is proven to exist near the computed start; pass a q and a guess on a closed, "
        "nonsingular configuration, or raise the precision"
    )


def unique_there(loop: ClosedLoop, q: Sequence[Ball], box: Sequence[Ball], q_free: Array) -> bool:
    """Whether a box of closed configurations belongs to the branch of the computed q′: q is one box for both."""
    near = [ball(float(q_free[k])) for k in loop.dependent]
    y = _newton(loop, midpoints(q), near)
    for radius in _UNIQUE:
        reach = [ball(radius)] * len(y)
        inside = all(
            around(centre, ball(radius)).contains(box[k]) and abs(centre - start) < radius
            for centre, start, k in zip(y, near, loop.dependent, strict=True)
        )
        if inside and krawczyk(loop, q, y, reach) is not None:
            return True
    return False


def krawczyk(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball], radius: Sequence[Ball]) -> list[Ball] | None:
    """K of the theorem where it lies in the interior of Y = y ± radius, else ``None``."""
    if not y:
        return []
    matrix = flint().arb_mat
    box = [around(centre, r) for centre, r in zip(y, radius, strict=True)]
    try:
        near = _jacobian(loop, q, y).mid().inv().mid()
    except ZeroDivisionError:
        return None
    residual = matrix([[phi] for phi in values(loop.closure, _inputs(loop, q, y))])
    identity = matrix([[int(i == j) for j in range(len(y))] for i in range(len(y))])
    spread = matrix([[inside - centre] for inside, centre in zip(box, y, strict=True)])
    image = matrix([[centre] for centre in y]) - near * residual + (identity - near * _jacobian(loop, q, box)) * spread
    found = list(image.entries())
    return found if all(b.contains_interior(k) for b, k in zip(box, found, strict=True)) else None


def _sharpened(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball], proven: list[Ball]) -> list[Ball]:
    """Apply Krawczyk's operator to its own image, inflated, while that shrinks it."""
    best = proven
    for _ in range(_NEWTON_STEPS):
        radius = [(abs(b - c) * 2).upper() for b, c in zip(best, y, strict=True)]
        image = krawczyk(loop, q, y, [r / 4 for r in radius])
        if image is None:
            return best
        best = image
    return best


def _newton(loop: ClosedLoop, q: Sequence[Ball], start: Sequence[Ball]) -> list[Ball]:
    """Newton's method on midpoints; a start for the proof, not a proof."""
    matrix, y = flint().arb_mat, list(start)
    for _ in range(_NEWTON_STEPS if y else 0):
        residual = matrix([[phi] for phi in values(loop.closure, _inputs(loop, q, y))])
        try:
            step = _jacobian(loop, q, y).mid().inv() * residual
        except ZeroDivisionError:
            return y
        y = [(a - b).mid() for a, b in zip(y, step.entries(), strict=True)]
    return y


def _jacobian(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball]) -> Any:
    return flint().arb_mat(len(y), len(y), values(loop.jacobian, _inputs(loop, q, y)))


def _assemble(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball]) -> list[Ball]:
    q_free: list[Ball] = [None] * loop.n_free
    for places, parts in ((loop.independent, q), (loop.dependent, y)):
        for k, part in zip(places, parts, strict=True):
            q_free[k] = part
    return q_free


def _inputs(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball]) -> list[Ball]:
    """A configuration at rest as inputs of the programs."""
    return [*_assemble(loop, q, y), *[ball(0)] * loop.n]
