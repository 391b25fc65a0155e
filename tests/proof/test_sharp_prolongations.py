"""Prolonged systems for a cubic φ: F and F′ as written and by differences, Δ and what rounds entry by entry.

φ's own derivatives are exact there; how far it may bend is made up, so that each bound is the sum that `extended.md`
states.
"""

import numpy as np
import pytest

from ccpin.proof import prolongations as module
from ccpin.proof.prolongations import Prolongation
from tests.support.cubic import MARGIN, SIZE, TAU, Cubic, M, Q, Y, rows, slope_of


@pytest.fixture
def cubic(monkeypatch):
    made = Cubic()
    monkeypatch.setattr(module, "third_bound", made.third)
    monkeypatch.setattr(module, "third_along", made.third_along)
    return made


def columns_of(matrix, D):
    """By s and y: the columns of q times D, then those of y."""
    along = [sum(matrix[:, q] * part for q, part in zip(Q, d, strict=True)) for d in D.T]
    return np.stack([*along, *(matrix[:, y] for y in Y)], axis=1)


def prolonged(cubic, p, seed=4):
    """F about two lines (p = 1) or planes (2), and places."""
    rng = np.random.default_rng(seed)
    directions = 0.5 * rng.normal(size=(2, 2, p))
    system = Prolongation(cubic.problem, rows(rng, 2, 2), directions, rows(rng, 2, M))
    x = rows(rng, 2, p + M + p * M)
    return system, x, system.at(x, lambda theta: cubic.derivatives(None, theta))


@pytest.mark.parametrize("p", [1, 2])
def test_the_places_of_points(cubic, p):
    """q = q₀ + D s, y and the kernels as they are; |q| ≤ |q₀| + |D||s| for what rounds."""
    system, x, point = prolonged(cubic, p)
    assert (system.order, system.unknowns) == (p, x.shape[1])
    for b in range(2):
        moved = system.directions[b] @ x[b, :p]
        np.testing.assert_allclose(point.theta[b, Q], system.origin[b] + moved, rtol=1e-14)
        size = np.abs(system.origin[b]) + np.abs(system.directions[b]) @ np.abs(x[b, :p])
        np.testing.assert_allclose(point.size[b, Q], size, rtol=1e-14)
    np.testing.assert_array_equal(point.theta[:, Y], x[:, p : p + M])
    np.testing.assert_array_equal(point.size[:, Y], np.abs(x[:, p : p + M]))
    np.testing.assert_array_equal(point.kernel.reshape(2, -1), x[:, p + M :])
    np.testing.assert_array_equal(system.theta(x), point.theta)


@pytest.mark.parametrize("p", [1, 2])
def test_the_system_and_its_slope(cubic, p):
    """F = (φ, φ_y v, lv − 1), for planes (…, φ_yy v v + φ_y w, lw) too, and F′ by differences."""
    system, x, point = prolonged(cubic, p)
    slope, bent = point.values.jacobian[:, :, Y], point.values.hessian[:, :, Y][..., Y]
    v = point.kernel[:, 0]
    parts = [
        point.values.phi,
        np.einsum("bij,bj->bi", slope, v),
        np.sum(system.pairing * v, axis=1)[:, None] - 1.0,
    ]
    if p == 2:
        w = point.kernel[:, 1]
        parts += [
            np.einsum("bijk,bj,bk->bi", bent, v, v) + np.einsum("bij,bj->bi", slope, w),
            np.sum(system.pairing * w, axis=1)[:, None],
        ]
    np.testing.assert_allclose(system.value(point), np.concatenate(parts, axis=1), rtol=1e-12)

    def value(at):
        return system.value(system.at(at, lambda theta: cubic.derivatives(None, theta)))

    np.testing.assert_allclose(system.slope(point), slope_of(value, x), atol=1e-8)


def blocks(D, jacobian, bent, curled=None):
    """F′ of blocks by θ, with the columns in the order s, y, v (and w)."""
    p = D.shape[1]
    size = p + M
    made = np.zeros((size + p * M, size + p * M))
    made[:M, :size], made[M : 2 * M, :size] = columns_of(jacobian, D), columns_of(bent, D)
    made[M : 2 * M, size : size + M] = jacobian[:, Y]
    if curled is not None:
        made[2 * M + 1 : -1, :size], made[2 * M + 1 : -1, size + M :] = columns_of(curled, D), jacobian[:, Y]
        made[2 * M + 1 : -1, size : size + M] = 2.0 * bent[:, Y]
    return made


@pytest.mark.parametrize("p", [1, 2])
def test_the_drift_and_the_rounding(cubic, p):
    """Δ(r) as the theorem states it, with V = |v₀|₁ + mr and W likewise; and the rounding of F′'s entries."""
    system, _, point = prolonged(cubic, p)
    radius = np.array([0.2, 0.3])
    drift, rounding = system.drift(point, radius), system.rounding(point)
    box = np.tile(radius[:, None], SIZE)
    box[:, Q] *= np.abs(system.directions).sum(axis=2)
    asked = dict(cubic.asked)
    np.testing.assert_allclose(asked["third"], box, rtol=1e-14)
    np.testing.assert_array_equal(asked["magnitude"], point.size)
    for b, r in enumerate(radius):
        H, D, B = np.abs(point.values.hessian[b]), np.abs(system.directions[b]), box[b].sum()
        sizes = [np.abs(k).sum() for k in point.kernel[b]]
        V, W = sizes[0] + M * r, sizes[-1] + M * r
        partial, tau = H[..., Y].sum(axis=2) * r, TAU[:, None]
        turned = np.array(
            [[sum((H[i, j, k] + TAU[i] * B) * box[b, k] for k in range(SIZE)) for j in range(SIZE)] for i in range(M)]
        )
        bent = partial + tau * B * V
        curled = tau * (B * V**2 + 2 * M * r * V) + partial + tau * B * W if p == 2 else None
        np.testing.assert_allclose(drift[b], blocks(D, turned, bent, curled), rtol=1e-12)
        unit, v, w = np.full((M, SIZE), MARGIN * (1.0 + point.size[b, 0])), 1.0 + sizes[0], 1.0 + sizes[-1]
        expected = blocks(D, unit, unit * v, unit * (2.0 * v**2 + w) if p == 2 else None)
        np.testing.assert_allclose(rounding[b], expected, rtol=1e-12)


@pytest.mark.parametrize("p", [1, 2])
def test_the_lemma_is_asked_of_these(cubic, monkeypatch, p):
    """F, F′, its rounding, weights 1 + |v|₁ + |w|₁, and Δ of the rows wanted."""
    system, _, point = prolonged(cubic, p)
    told = []
    monkeypatch.setattr(module, "proved_within", lambda *given: told.append(given) or np.ones(2))
    np.testing.assert_array_equal(system.proved_within(point), np.ones(2))
    value, slope, weight, rounding, drift = told[0]
    np.testing.assert_array_equal(value, system.value(point))
    np.testing.assert_array_equal(slope, system.slope(point))
    np.testing.assert_allclose(weight, 1.0 + np.abs(point.kernel).sum(axis=(1, 2)), rtol=1e-14)
    np.testing.assert_array_equal(rounding, system.rounding(point))
    expected = system.drift(point, np.array([0.2, 0.3]))[1:]
    np.testing.assert_allclose(drift(np.array([1]), np.array([0.3])), expected, rtol=1e-14)
