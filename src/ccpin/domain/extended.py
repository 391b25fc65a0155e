"""Extended systems F(x) = 0 of singular configurations, solved by Newton's method."""

from __future__ import annotations

from typing import Protocol, TypeVar

import numpy as np

from ccpin.arrays import Array, Indices, solve_many

_SETTLED = 1e-8  # a step after which Newton's next one is lost in rounding
_LONGEST = 0.5

P = TypeVar("P")


class Equations(Protocol[P]):
    """F at B points, P being what it needs there."""

    def take(self, rows: Indices) -> Equations[P]:
        """Those of some points."""

    def at(self, x: Array) -> P:
        """What is needed at x, of shape (B, unknowns)."""

    def value(self, point: P) -> Array:
        """F, of shape (B, unknowns)."""

    def slope(self, point: P) -> Array:
        """F′, of shape (B, unknowns, unknowns)."""


def solved(equations: Equations[P], x: Array, steps: int) -> Array:
    """Newton's method, its steps shortened to at most 0.5 in any unknown."""
    x, active = x.copy(), np.arange(len(x))
    for _ in range(steps):
        part = equations.take(active)
        point = part.at(x[active])
        step = -solve_many(part.slope(point), part.value(point))
        length = np.max(np.abs(step), axis=1)
        going = np.isfinite(length)
        step, length, active = step[going], length[going], active[going]
        x[active] += step * np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))[:, None]
        active = active[length > _SETTLED * (1.0 + np.abs(x[active]).max(axis=1))]
        if not active.size:
            break
    return x
