"""The systems of singular configurations, folds and cusps for a cubic φ: derivatives by differences, bounds as written.

φ's own derivatives are exact there; how far it may bend is made up, so that each bound is the sum that its theorem
states, added up here entry by entry.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.domain.singular import cusp_points, folds
from ccpin.domain.singular.cusp_points import Cusp, _CuspEquations
from ccpin.domain.singular.folds import _System
from ccpin.proof.curves import curve_equations
from ccpin.proof.curves.curve_equations import Drift
from ccpin.proof.equations import Derivatives

M, SIZE, Q, Y = 3, 5, np.array([3, 1]), np.array([0, 4, 2])
TAU, MARGIN = np.array([0.3, 0.5, 0.7]), 1e-3


class Cubic:
    """φ of three rows over five coordinates, and the problem that has it."""

    def __init__(self, seed=0):
        rng = np.random.default_rng(seed)
        self.p, self.J = rng.normal(size=M), rng.normal(size=(M, SIZE))
        H, T = rng.normal(size=(M, SIZE, SIZE)), rng.normal(size=(M, SIZE, SIZE, SIZE))
        self.H = H + np.swapaxes(H, 1, 2)
        self.T = sum(
            np.moveaxis(T, (1, 2, 3), order)
            for order in ((1, 2, 3), (1, 3, 2), (2, 1, 3), (2, 3, 1), (3, 1, 2), (3, 2, 1))
        )
        self.asked = []
        system = SimpleNamespace(
            m=M, n=2, n_free=SIZE, independent=Q, dependent=Y, rounding=MARGIN, magnitude=self._magnitude
        )
        self.problem = SimpleNamespace(system=system, stack=None)

    def _magnitude(self, reach):
        self.asked.append(("magnitude", np.array(reach)))
        return 1.0 + reach[:, 0]

    def derivatives(self, problem, theta):
        t = theta
        curl = np.einsum("mijk,bk->bmij", self.T, t)
        hessian = self.H + curl
        jacobian = self.J + np.einsum("bmij,bj->bmi", self.H + 0.5 * curl, t)
        phi = self.p + np.einsum("mi,bi->bm", self.J, t)
        phi = phi + 0.5 * np.einsum("bmij,bi,bj->bm", self.H + curl / 3.0, t, t)
        return Derivatives(phi, jacobian, hessian, np.zeros((len(t), 1, 1)))

    def third(self, problem, theta, arms, box):
        self.asked.append(("third", np.array(box)))
        return np.tile(TAU, (len(theta), 1))

    def third_along(self, system, stack, theta, turn):
        return np.einsum("mijk,bk->bmij", self.T, turn)


@pytest.fixture
def cubic(monkeypatch):
    made = Cubic()
    for module in (curve_equations, cusp_points, folds):
        name = "derivatives" if module is curve_equations else "closure_derivatives"
        monkeypatch.setattr(module, name, made.derivatives)
        monkeypatch.setattr(module, "third_bound", made.third)
    for module in (curve_equations, cusp_points):
        monkeypatch.setattr(module, "third_along", made.third_along)
    return made


def slope_of(function, x, step=1e-5):
    """The derivatives of a function of rows, by central differences."""
    columns = []
    for k in range(x.shape[1]):
        move = np.zeros_like(x)
        move[:, k] = step
        columns.append((function(x + move) - function(x - move)) / (2.0 * step))
    return np.stack(columns, axis=2)


def columns_of(matrix, d):
    """By s and y: the columns of q along d, then those of y."""
    return np.stack(
        [sum(matrix[:, q] * part for q, part in zip(Q, d, strict=True)), *(matrix[:, y] for y in Y)], axis=1
    )


def rows(rng, count, size):
    return 0.5 * rng.normal(size=(count, size))


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


# Folds (Theorem S).


def fold(cubic, seed=4):
    rng = np.random.default_rng(seed)
    return _System(cubic.problem, rows(rng, 2, 2), rows(rng, 2, 2), rows(rng, 2, M)), rows(rng, 2, 1 + 2 * M)


def test_the_system_of_folds_on_lines(cubic):
    """F(s, y, w) = (φ, φ_y w, lw − 1) at q₀ + s d, and F′."""
    system, x = fold(cubic)
    point = system.at(x)
    for b in range(2):
        np.testing.assert_allclose(point.theta[b, Q], system.origin[b] + x[b, 0] * system.directions[b], rtol=1e-14)
    np.testing.assert_array_equal(point.theta[:, Y], x[:, 1 : 1 + M])
    np.testing.assert_array_equal(point.kernel, x[:, 1 + M :])
    slope = point.values.jacobian[:, :, Y]
    lw = np.sum(system.pairing * point.kernel, axis=1) - 1.0
    expected = np.concatenate([point.values.phi, np.einsum("bij,bj->bi", slope, point.kernel), lw[:, None]], axis=1)
    np.testing.assert_allclose(system.value(point), expected, rtol=1e-12)
    np.testing.assert_allclose(system.slope(point), slope_of(lambda x: system.value(system.at(x)), x), atol=1e-8)


def test_the_drift_of_folds(cubic):
    """Δ(r) and the rounding of F′'s entries, entry by entry."""
    system, x = fold(cubic)
    point, radius = system.at(x), np.array([0.2, 0.3])
    drift, rounding = system.drift(point, radius)
    moves = np.ones((2, SIZE))
    moves[:, Q] = np.abs(system.directions)
    box = radius[:, None] * moves
    asked = dict(cubic.asked)
    np.testing.assert_allclose(asked["third"], box, rtol=1e-14)
    np.testing.assert_allclose(asked["magnitude"], np.abs(point.theta) + box, rtol=1e-14)
    for b, r in enumerate(radius):
        H, w, d = np.abs(point.values.hessian[b]), np.abs(point.kernel[b]).sum(), np.abs(system.directions[b])
        third = TAU * box[b].sum()
        turned = np.array(
            [[sum((H[i, j, k] + third[i]) * box[b, k] for k in range(SIZE)) for j in range(SIZE)] for i in range(M)]
        )
        curled = np.array(
            [[sum(H[i, j, k] * r for k in Y) + third[i] * (w + M * r) for j in range(SIZE)] for i in range(M)]
        )
        expected = np.zeros((2 * M + 1, 2 * M + 1))
        expected[:M, : M + 1], expected[M:-1, : M + 1] = columns_of(turned, d), columns_of(curled, d)
        expected[M:-1, M + 1 :] = turned[:, Y]
        np.testing.assert_allclose(drift[b], expected, rtol=1e-12)
        unit = np.full((M, SIZE), MARGIN * (1.0 + abs(point.theta[b, 0]) + box[b, 0]))
        expected[:M, : M + 1], expected[M:-1, : M + 1] = columns_of(unit, d), columns_of(unit * (1.0 + w), d)
        expected[M:-1, M + 1 :] = unit[:, Y]
        np.testing.assert_allclose(rounding[b], expected, rtol=1e-12)


def assert_asked(monkeypatch, module, system, point, weight, rounding, drift_of):
    """The lemma is asked of F, F′, its rounding, weights, and Δ of the rows it wants."""
    told = []
    monkeypatch.setattr(module, "proved_within", lambda *given: told.append(given) or np.ones(2))
    module._proved_within(system, point)
    value, slope, given_weight, given_rounding, drift = told[0]
    np.testing.assert_array_equal(value, system.value(point))
    np.testing.assert_array_equal(slope, system.slope(point))
    np.testing.assert_allclose(given_weight, weight, rtol=1e-14)
    np.testing.assert_array_equal(given_rounding, rounding)
    np.testing.assert_array_equal(drift(np.array([1]), np.array([0.3])), drift_of(np.array([0.2, 0.3]))[1:])


def test_folds_are_proved_with_their_numbers(cubic, monkeypatch):
    """Rounding as at r = 0, weights 1 + |w|₁."""
    system, x = fold(cubic)
    point = system.at(x)
    weight, rounding = 1.0 + np.abs(point.kernel).sum(axis=1), system.drift(point, np.zeros(2))[1]
    assert_asked(monkeypatch, folds, system, point, weight, rounding, lambda radius: system.drift(point, radius)[0])


# Cusps (Theorem C).


def cusp(cubic, seed=5):
    rng = np.random.default_rng(seed)
    return _CuspEquations(cubic.problem, rows(rng, 2, M)), rows(rng, 2, 2 + 3 * M)


def test_the_system_of_cusps(cubic):
    """F(q, y, v, w) = (φ, φ_y v, lv − 1, φ_yy v v + φ_y w, lw), and F′."""
    system, x = cusp(cubic)
    point = system.at(x)
    np.testing.assert_array_equal(point.theta[:, [*Q, *Y]], x[:, :SIZE])
    np.testing.assert_array_equal(point.v, x[:, SIZE : SIZE + M])
    np.testing.assert_array_equal(point.w, x[:, SIZE + M :])
    slope, bent = point.values.jacobian[:, :, Y], point.values.hessian[:, :, Y][..., Y]
    expected = np.concatenate(
        [
            point.values.phi,
            np.einsum("bij,bj->bi", slope, point.v),
            np.sum(system.pairing * point.v, axis=1)[:, None] - 1.0,
            np.einsum("bijk,bj,bk->bi", bent, point.v, point.v) + np.einsum("bij,bj->bi", slope, point.w),
            np.sum(system.pairing * point.w, axis=1)[:, None],
        ],
        axis=1,
    )
    np.testing.assert_allclose(system.value(point), expected, rtol=1e-12)
    np.testing.assert_allclose(system.slope(point), slope_of(lambda x: system.value(system.at(x)), x), atol=1e-8)


def blocks(jacobian, bent, curled):
    """F′ of blocks by θ, with the columns in the order q, y, v, w."""
    order, made = [*Q, *Y], np.zeros((3 * M + 2, 3 * M + 2))
    made[:M, :SIZE], made[M : 2 * M, :SIZE], made[2 * M + 1 : -1, :SIZE] = (
        jacobian[:, order],
        bent[:, order],
        curled[:, order],
    )
    made[M : 2 * M, SIZE : SIZE + M], made[2 * M + 1 : -1, SIZE + M :] = jacobian[:, Y], jacobian[:, Y]
    made[2 * M + 1 : -1, SIZE : SIZE + M] = 2.0 * bent[:, Y]
    return made


def test_the_drift_of_cusps(cubic):
    """Δ(r) as the module states it, with P = n′ and V = |v₀|₁ + mr; and the rounding of F′'s entries."""
    system, x = cusp(cubic)
    point, radius = system.at(x), np.array([0.2, 0.3])
    drift = system.drift(point, radius)
    np.testing.assert_array_equal(dict(cubic.asked)["third"], np.tile(radius[:, None], SIZE))
    rounding = system.rounding(point)
    np.testing.assert_array_equal(dict(cubic.asked)["magnitude"], np.abs(point.theta))
    for b, r in enumerate(radius):
        H, v, w = np.abs(point.values.hessian[b]), np.abs(point.v[b]).sum(), np.abs(point.w[b]).sum()
        V, W, P = v + M * r, w + M * r, SIZE
        total, partial, tau = H.sum(axis=2), H[..., Y].sum(axis=2), TAU[:, None]
        turned = (total + tau * P**2 * r) * r
        bent = partial * r + tau * P * r * V
        curled = tau * (P * V**2 + 2 * M * V) * r + partial * r + tau * P * r * W
        np.testing.assert_allclose(drift[b], blocks(turned, bent, curled), rtol=1e-12)
        unit = np.full((M, SIZE), MARGIN * (1.0 + abs(point.theta[b, 0])))
        expected = blocks(unit, unit * (1.0 + v), unit * (2.0 * (1.0 + v) ** 2 + (1.0 + w)))
        np.testing.assert_allclose(rounding[b], expected, rtol=1e-12)


def test_cusps_are_proved_with_their_numbers(cubic, monkeypatch):
    """Weights 1 + |v|₁ + |w|₁."""
    system, x = cusp(cubic)
    point = system.at(x)
    weight = 1.0 + np.abs(point.v).sum(axis=1) + np.abs(point.w).sum(axis=1)
    rounding = system.rounding(point)
    assert_asked(monkeypatch, cusp_points, system, point, weight, rounding, lambda radius: system.drift(point, radius))


def test_cusps_are_counted_once():
    """Two within 1e-6 in every coordinate, modulo 2π of angles, are one."""
    reading = SimpleNamespace(theta=lambda q_free: q_free, system=SimpleNamespace(periodic=np.array([True, False])))
    made = [Cusp(np.zeros(2), np.array(at) + [0.5, 0.25], np.zeros(1), 0.0) for at in (
        (0.0, 0.0), (2 * np.pi, 0.99e-6), (0.0, 1.01e-6), (-0.99e-6, 0.0), (0.0, 2 * np.pi), (1.01e-6, 3e-6),
    )]  # fmt: skip
    assert cusp_points.distinct(reading, made) == (made[0], made[2], made[4], made[5])
    assert cusp_points.distinct(reading, []) == ()
    far, near = made[2]._replace(error=0.6e-6), made[2]._replace(error=0.4e-6)
    assert cusp_points.distinct(reading, [made[0]._replace(error=0.5e-6), far]) == (made[0]._replace(error=0.5e-6),)
    assert len(cusp_points.distinct(reading, [made[0]._replace(error=0.5e-6), near])) == 2
