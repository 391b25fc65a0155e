"""Theorem P of `ccpin/proof/theorems/closed_boxes.md`, in balls: existence and uniqueness of y with φ(q, y) = 0."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ccpin.validated.arithmetic.balls import Ball, around, flint
from ccpin.validated.arithmetic.series import gradients, values
from ccpin.validated.loop_equations import ClosedLoopEquations


def krawczyk(
    loop: ClosedLoopEquations, q: Sequence[Ball], y: Sequence[Ball], radius: Sequence[Ball]
) -> list[Ball] | None:
    """Theorem P's y_c − Cφ + (I − Cφ_y)(Y − y_c) where it lies in the interior of Y = y ± radius, else ``None``."""
    if not y:
        return []
    size, matrix = len(y), flint().arb_mat
    box = [around(centre, r) for centre, r in zip(y, radius, strict=True)]
    try:
        near = slopes_of(loop, q, y).mid().inv().mid()
    except ZeroDivisionError:
        return None
    centre = matrix(size, 1, list(y))
    spread = matrix(size, 1, [inside - middle for inside, middle in zip(box, y, strict=True)])
    identity = matrix(np.eye(size, dtype=int).tolist())
    image = centre - near * residual_of(loop, q, y) + (identity - near * slopes_of(loop, q, box)) * spread
    found = list(image.entries())
    return found if all(b.contains_interior(k) for b, k in zip(box, found, strict=True)) else None


def residual_of(loop: ClosedLoopEquations, q: Sequence[Ball], y: Sequence[Ball]) -> Any:
    """φ over a box, a column."""
    return flint().arb_mat(len(y), 1, values(loop.closure, loop.at_rest(assembled(loop, q, y))))


def slopes_of(loop: ClosedLoopEquations, q: Sequence[Ball], y: Sequence[Ball]) -> Any:
    """φ_y over a box."""
    slopes = gradients(loop.closure, loop.at_rest(assembled(loop, q, y)))
    return flint().arb_mat([[row[k] for k in loop.dependent] for row in slopes])


def assembled(loop: ClosedLoopEquations, q: Sequence[Ball], y: Sequence[Ball]) -> list[Ball]:
    """The numbers x of q and y."""
    x: list[Ball] = [None] * loop.n_x
    for places, parts in ((loop.independent, q), (loop.dependent, y)):
        for k, part in zip(places, parts, strict=True):
            x[k] = part
    return x
