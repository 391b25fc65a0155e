"""The system of singular configurations for a cubic φ: derivatives by differences, bounds as written.

φ's own derivatives are exact there; how far it may bend is made up, so that each bound is the sum that its theorem
states, added up here entry by entry.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof.curves import curve_equations
from ccpin.proof.curves.curve_equations import Drift
from tests.support.cubic import MARGIN, SIZE, TAU, Cubic, M, Y, rows, slope_of


@pytest.fixture
def cubic(monkeypatch):
    made = Cubic()
    monkeypatch.setattr(curve_equations, "derivatives", made.derivatives)
    monkeypatch.setattr(curve_equations, "third_bound", made.third)
    monkeypatch.setattr(curve_equations, "third_along", made.third_along)
    return made


# Singular configurations (`singular_system.md`).


def test_the_system_of_singular_configurations(cubic):
    """G = (φ, φ_y w, lᵀw − 1), G′ and G″ of all of x = (θ, w)."""
    rng = np.random.default_rng(1)
    theta, w, pairing = rows(rng, 2, SIZE), rows(rng, 2, M), rows(rng, 2, M)

    def value(x):
        return curve_equations.first_order(cubic.problem, x[:, :SIZE], x[:, SIZE:], pairing)[0]

    def slope(x):
        return curve_equations.first_order(cubic.problem, x[:, :SIZE], x[:, SIZE:], pairing)[1]

    at = cubic.derivatives(None, theta)
    expected = np.concatenate(
        [at.phi, np.einsum("bmj,bj->bm", at.jacobian[:, :, Y], w), (np.sum(pairing * w, axis=1) - 1.0)[:, None]], axis=1
    )
    x = np.concatenate([theta, w], axis=1)
    np.testing.assert_allclose(value(x), expected, rtol=1e-12)
    found = curve_equations.values_at(cubic.problem, theta, w, pairing)
    np.testing.assert_allclose(found.value, expected, rtol=1e-12)
    np.testing.assert_allclose(found.slope, slope_of(value, x), atol=1e-8)
    bend = slope_of(lambda at: slope(at).reshape(2, -1), x).reshape(2, 2 * M + 1, SIZE + M, SIZE + M)
    np.testing.assert_allclose(found.bend, bend, atol=1e-8)
    weight = 1.0 + np.abs(w).sum(axis=1) + np.abs(pairing).sum(axis=1)
    np.testing.assert_allclose(found.rounding, 4.0 * MARGIN * (1.0 + theta[:, 0]) * weight, rtol=1e-12)


def test_the_drift_of_the_system(cubic):
    """|Δφ_θθ| ≤ τ|θ|₁, and of φ_θθθ w: τ|θ|₁ (|w₀|₁ + |Δw|₁) + τ|Δw|₁."""
    rng = np.random.default_rng(2)
    box, w = rng.uniform(0.1, 1.0, (2, SIZE + M)), rows(rng, 2, M)
    at = SimpleNamespace(theta=rows(rng, 2, SIZE), kernel=w, arms=None)
    found = curve_equations.drift(cubic.problem, at, box)
    turn, spread = box[:, :SIZE].sum(axis=1)[:, None], box[:, SIZE:].sum(axis=1)[:, None]
    bent = TAU * turn
    mixed = bent * (np.abs(w).sum(axis=1)[:, None] + spread) + TAU * spread
    none = np.zeros((2, 1))
    np.testing.assert_allclose(found.turned, np.concatenate([bent, mixed, none], axis=1), rtol=1e-12)
    np.testing.assert_allclose(found.mixed, np.concatenate([0 * bent, bent, none], axis=1), rtol=1e-12)
    np.testing.assert_array_equal(cubic.asked[0][1], box[:, :SIZE])


def test_drift_along_moves():
    """By each θ (D|θ|₁ + E|w|₁), by each w E|θ|₁, rows weighted."""
    rng = np.random.default_rng(3)
    turned, mixed, gain = rng.uniform(0, 1, (2, 4)), rng.uniform(0, 1, (2, 4)), rng.uniform(0, 1, (2, 3, 4))
    theta, kernel = rng.uniform(0, 1, 2), rng.uniform(0, 1, 2)
    by_theta, by_kernel = Drift(turned, mixed).along(gain, theta, kernel)
    for b in range(2):
        np.testing.assert_allclose(by_theta[b], gain[b] @ (turned[b] * theta[b] + mixed[b] * kernel[b]), rtol=1e-12)
        np.testing.assert_allclose(by_kernel[b], gain[b] @ (mixed[b] * theta[b]), rtol=1e-12)
