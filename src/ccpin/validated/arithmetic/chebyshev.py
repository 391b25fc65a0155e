"""Analytic functions over a box, bounded by their values at points of it: Chebyshev series of total degree N.

With q_i = c_i + h_i ξ_i, a function of modulus M at most for ξ_i in Bernstein's ellipses of parameter ρ is
Σ a_k Π T_{k_i}(ξ_i) with |a_k| ≤ 2ⁿ M ρ^{−|k|} (`ccpin/proof/theorems/identifiable.md`).
"""

from __future__ import annotations

import math

import numpy as np

from ccpin.arrays import Array
from ccpin.validated.arithmetic.ball_arrays import BallArray, exactly, raised, stacked
from ccpin.validated.arithmetic.polydisc import ring

_OUT = 1.0 + 2.0**-36  # on what is not negative: covers the roundings of sums of up to 100,000 such numbers


def waves(points: Array, degree: int) -> BallArray:
    """Π T_{k_i}(ξ_i) for |k| ≤ N at points of shape (P, n), of shape (P, K).

    T_{i+j} = 2 T_i T_j − T_{i−j} by halves, i − j ≤ 1: radii then grow as N², one by one as (1 + √2)^N.
    """
    rows = [exactly(np.ones_like(points)), exactly(points)]
    while len(rows) <= degree:
        small, large = rows[len(rows) // 2], rows[(len(rows) + 1) // 2]
        rows.append(exactly(np.full_like(points, 2.0)) * small * large - rows[len(rows) % 2])
    every, total = stacked(rows), exactly(np.ones((len(points), 1)))
    for place, orders in enumerate(ring(points.shape[1], degree).exponents.T):
        total = total * every.at(np.s_[:, place, orders])
    return total


def beyond(bound: Array, n: int, degree: int, rho: float) -> Array:
    """Σ |a_k| over |k| > N at most: 2ⁿ M C(N + n, n − 1) ρ^{−N−1}/(1 − κ), κ = (N + n + 1)/((N + 2)ρ); ∞ for κ ≥ ¾."""
    kappa = (degree + n + 1) / ((degree + 2) * rho)
    if not kappa < 0.75:
        return np.full_like(bound, np.inf)
    return raised(bound * (2**n * math.comb(degree + n, n - 1) * rho ** -(degree + 1) / (1.0 - kappa)))


def bounded(values: BallArray, points: Array, degree: int, bound: Array, rho: float) -> Array:
    """Upper bounds over the box of functions of values (K, F) at K = C(N + n, n) points and of bounds M (F,)."""
    table = waves(points, degree)
    try:
        near = np.linalg.inv(table.mid)
    except np.linalg.LinAlgError:
        return np.full_like(bound, np.inf)
    return between(np.asarray(near, dtype=np.float64), table, values, beyond(bound, points.shape[1], degree, rho))


def between(near: Array, table: BallArray, values: BallArray, rest: Array) -> Array:
    """(|L f|₁ + t Σ|L|)/(1 − δ) + t for any L, V of `waves`, δ = ‖I − LV‖₁ and t of `beyond`; ∞ for δ ≥ ½."""
    delta = (exactly(np.eye(len(near))) - exactly(near) @ table).size.sum(axis=0).max() * _OUT
    if not delta < 0.5:
        return np.full_like(rest, np.inf)
    seen = (exactly(near) @ values).size.sum(axis=0) + rest * np.abs(near).sum(axis=0).sum()
    return np.asarray((seen / (1.0 - delta) + rest) * _OUT)
