"""Scales of the unknowns that make Theorem 2's radius largest.

Substituting z = w ∘ z̃ leaves a system quadratic, and changes the maximum norm in which Theorem 2 measures it. With
B = |J⁻¹|, a = B (0, …, 0, 1, …, 1)ᵀ and v(w)ᵢ = 2 Σ |coefficient| w w over row i's quadratic monomials,

    ω(w) = maxᵢ (B v(w))ᵢ / wᵢ,   γ(w) = maxᵢ aᵢ / wᵢ,   r(w) = 1 / (2 ω(w) γ(w)),

and r(tw) = r(w). So take γ = 1, that is w ≥ a, and ask for the least ω: w ↦ max(a, B v(w)/ω) is monotone, and
the w with ω(w) ≤ ω, w ≥ a are those it does not raise. If there are any, iterating from a converges to the least
of them; ω is found by bisection. Any positive w is a valid choice, so nothing here needs to be exact.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.quadratic import QuadraticSystem

Array = NDArray[np.float64]

_BISECTIONS = 24
_ITERATIONS = 300
_SETTLED = 1e-5
_LEAST = 1e-4


def best_weights(system: QuadraticSystem, centre: Array) -> Array:
    """Weights w of shape (N,), largest 1, near those that maximise r(w) at a centre with nonsingular Jacobian.

    No weight is below 1e-4, so that rounding margins, which do not know the scales, stay small.
    """
    inverse = np.abs(np.linalg.inv(system.jacobian(centre)))
    least = inverse[:, system.size - system.free :].sum(axis=1)
    top = float(least.max(initial=0.0))
    if top == 0.0 or system.c == 0.0:
        return np.ones(system.size)
    least = np.maximum(least / top, _LEAST)
    best = np.ones(system.size)
    high = float((inverse @ system.rescaled(best).v).max())
    low = 0.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        weights = _least_fixed_point(system, inverse, least, middle)
        if weights is None:
            low = middle
        else:
            best, high = weights, middle
    return np.asarray(best / best.max())


def _least_fixed_point(system: QuadraticSystem, inverse: Array, least: Array, omega: float) -> Array | None:
    """The least w ≥ `least` with B v(w) ≤ ω w, or ``None`` where the iteration does not settle."""
    doubled = 2.0 * np.abs(system.coefficient)
    weights = least
    for _ in range(_ITERATIONS):
        products = doubled * weights[system.first] * weights[system.second]
        bend = np.bincount(system.row, weights=products, minlength=system.size)
        raised = np.maximum(least, inverse @ bend / omega)
        growth = float((raised / weights).max())
        if growth < 1.0 + _SETTLED:
            return np.asarray(raised)
        if raised.max() > 1.0 / _LEAST:
            return None
        weights = raised
    return None
