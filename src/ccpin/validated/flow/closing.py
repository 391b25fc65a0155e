"""The exact closed configuration near a computed one: existence and uniqueness of y with φ(q, y) = 0.

Theorem P of `ccpin/proof/theorems/closed_boxes.md`, in balls.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import ConvergenceError
from ccpin.validated.arithmetic.balls import Ball, around, ball, flint
from ccpin.validated.arithmetic.series import gradients, values
from ccpin.validated.model.closed_loop import ClosedLoop

_NEWTON_STEPS = 20  # at most, of Newton's method and of sharpening: they propose, Krawczyk's operator proves
_UNIQUE = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)  # rad or m: radii within which uniqueness is tried, the largest first


def closed_start(loop: ClosedLoop, q: Sequence[Ball], x: Array) -> list[Ball]:
    """The one closed configuration near the computed x at every q of a box, as a box as small as the precision gives.

    "Near" is the largest of a few radii (rad or m) for which it is unique, and at most 1e-2.

    Raises:
        ConvergenceError: It is not proven; most likely x is open or nearly singular.
    """
    near, y = _newton(loop, q, x)
    far = max((abs(a - b).upper() for a, b in zip(y, near, strict=True)), default=ball(0))
    for radius in _UNIQUE:
        proven = krawczyk(loop, q, y, [ball(radius)] * len(y))
        if proven is not None and far < radius:
            return _assemble(loop, q, _sharpened(loop, q, y, proven))
    raise ConvergenceError(
        "no closed configuration is proven to exist near the computed start; pass a q and near= on a closed, "
        "nonsingular configuration, or raise the precision"
    )


def unique_there(loop: ClosedLoop, q: Sequence[Ball], box: Sequence[Ball], x: Array) -> bool:
    """Whether a box of closed configurations belongs to the branch of the computed x: q is one box for both."""
    near, y = _newton(loop, q, x)
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
    """Theorem P's y_c − Cφ + (I − Cφ_y)(Y − y_c) where it lies in the interior of Y = y ± radius, else ``None``."""
    if not y:
        return []
    size, matrix = len(y), flint().arb_mat
    box = [around(centre, r) for centre, r in zip(y, radius, strict=True)]
    try:
        near = _jacobian(loop, q, y).mid().inv().mid()
    except ZeroDivisionError:
        return None
    centre = matrix(size, 1, list(y))
    spread = matrix(size, 1, [inside - middle for inside, middle in zip(box, y, strict=True)])
    identity = matrix(np.eye(size, dtype=int).tolist())
    image = centre - near * _residual(loop, q, y) + (identity - near * _jacobian(loop, q, box)) * spread
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


def _newton(loop: ClosedLoop, q: Sequence[Ball], x: Array) -> tuple[list[Ball], list[Ball]]:
    """The computed y, and y after Newton's method at the centre of q: a start for the proof, not a proof."""
    near = [ball(float(x[k])) for k in loop.dependent]
    centre, y = [part.mid() for part in q], near
    for _ in range(_NEWTON_STEPS if y else 0):
        try:
            step = _jacobian(loop, centre, y).mid().inv() * _residual(loop, centre, y)
        except ZeroDivisionError:
            break
        y = [(a - b).mid() for a, b in zip(y, step.entries(), strict=True)]
    return near, y


def _residual(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball]) -> Any:
    return flint().arb_mat(len(y), 1, values(loop.closure, loop.at_rest(_assemble(loop, q, y))))


def _jacobian(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball]) -> Any:
    slopes = gradients(loop.closure, loop.at_rest(_assemble(loop, q, y)))
    return flint().arb_mat([[row[k] for k in loop.dependent] for row in slopes])


def _assemble(loop: ClosedLoop, q: Sequence[Ball], y: Sequence[Ball]) -> list[Ball]:
    x: list[Ball] = [None] * loop.n_x
    for places, parts in ((loop.independent, q), (loop.dependent, y)):
        for k, part in zip(places, parts, strict=True):
            x[k] = part
    return x
