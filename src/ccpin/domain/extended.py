"""Extended systems F(x) = 0 of singular configurations: solved by Newton's method, solutions proved by contraction.

The lemma is stated and proved in `ccpin/proof/theorems/extended.md`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, TypeVar

import numpy as np

from ccpin.arrays import Array, Indices, apply
from ccpin.domain.bounds_reach import chain_reach
from ccpin.domain.boxes import Problem, inverses, solve_many
from ccpin.domain.chain_stack import gather
from ccpin.proof.rounding import SLACK

UNIT = 2.0**-53
_SETTLED = 1e-8  # a step after which Newton's next one is lost in rounding
_LONGEST = 0.5
_RADII = (2.0, 8.0, 64.0)

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


def third_bound(problem: Problem, theta: Array, arms: Array, box: Array) -> Array:
    """τ ≥ every third and fourth derivative of φ_i over |θ − θ₀| ≤ box (B, n′), of shape (B, m).

    τ_i = Σ_c ‖(B_c)_i‖ max_j ρ_cj with ρ of `chain_reach`, `arms` (B, C, k) being |∂x_c/∂θ_j| at θ₀ (B, n′).
    """
    system, stack = problem.system, problem.stack
    margin = system.rounding * system.magnitude(np.abs(theta) + box)
    reach = chain_reach(stack, arms, gather(stack, np.abs(theta)), gather(stack, box), margin)
    gains = np.swapaxes(np.linalg.norm(stack.weights, axis=2), 0, 1)
    return np.asarray(reach.max(axis=2, initial=0.0) @ gains.T)


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


def proved_within(
    value: Array, slope: Array, weight: Array, rounding: Array, drift: Callable[[Indices, Array], Array]
) -> Array:
    """The r of the lemma at B points, of shape (B,); NaN where none of those tried will do.

    Args:
        value: F(x₀), of shape (B, unknowns).
        slope: F′(x₀), of shape (B, unknowns, unknowns).
        weight: By how much the rounding of φ counts in F, of shape (B,).
        rounding: The rounding error of the entries of F′, of the shape of `slope`.
        drift: Δ of some of the points for radii, (K, unknowns, unknowns) for (K,) and (K,).
    """
    inverse, count = inverses(slope), slope.shape[1]
    size = np.abs(inverse)
    wrong = np.broadcast_to((weight * (rounding.max(axis=(1, 2)) + 4.0 * UNIT))[:, None], value.shape)
    wrong = wrong + 8.0 * count * UNIT * np.abs(value)
    left = np.max(np.abs(apply(inverse, value)) + apply(size, wrong), axis=1)
    defect = np.abs(np.eye(count) - inverse @ slope) + size @ (rounding + 8.0 * count * UNIT * np.abs(slope))
    found, rows = np.full(len(slope), np.nan), np.flatnonzero(np.isfinite(left))
    for factor in _RADII:
        radius = factor * left[rows]
        kappa = (defect[rows] + size[rows] @ drift(rows, radius)).sum(axis=2).max(axis=1)
        proved = (left[rows] * SLACK + kappa * SLACK * radius < radius) & (kappa * SLACK < 1.0)
        found[rows[proved]] = radius[proved]
        rows = rows[~proved]
        if not rows.size:
            break
    return found
