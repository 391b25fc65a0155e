"""Cusps against the sextic's triple roots, their derivatives against differences, and what must not be accepted."""

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.domain.closures.system import reading_of
from ccpin.domain.singular.cusp_points import proved_cusps
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.equations import closures_of, derivatives, third_along
from ccpin.proof.prolongations import Prolongation
from tests.oracles import planar_3rpr as oracle
from tests.support.legs import load_slice

POSITIVE = np.array([[1e-3, 1e-3], [1.0, 1.0]])


@pytest.fixture(scope="module")
def slice_():
    """The slice at 14.98 cm and its singular curves."""
    mechanism = load_slice()
    return mechanism, domain.singularities(mechanism, starts=12)


def reading(mechanism):
    return reading_of(mechanism, mechanism.q_reference).bounded("reach")


@pytest.mark.slow
def test_the_cusps_of_a_slice_are_the_triple_roots(slice_):
    """All six of positive leg lengths, each as near as it says."""
    found = domain.cusps(slice_[0], POSITIVE, curves=slice_[1])
    expected = oracle.cusps(0.1498, grid=60)
    assert len(found) == len(expected) == 6
    for cusp in found:
        assert np.abs(cusp.q - expected).max(axis=1).min() < 1e-7
        assert cusp.error < 1e-7


@pytest.mark.slow
@pytest.mark.parametrize("leg1", [0.12, 0.17, 0.2])
def test_the_cusps_of_other_slices(leg1):
    """All that the sextic has, from all singular curves."""
    found = domain.cusps(load_slice(leg1), POSITIVE)
    expected = oracle.cusps(leg1)
    assert len(found) == len(expected)
    assert all(np.abs(cusp.q - expected).max(axis=1).min() < 1e-7 for cusp in found)


@pytest.mark.slow
def test_three_solutions_on_one_side_and_one_on_the_other(slice_):
    """On a small circle about a cusp the sextic has two real roots more on an arc, and on no more than that."""
    cusp = domain.cusps(slice_[0], [[0.17, 0.25], [0.19, 0.28]], curves=slice_[1])[0]
    around = cusp.q + 2e-3 * np.column_stack([np.cos(t := np.linspace(0, 2 * np.pi, 721)), np.sin(t)])
    modes = oracle.modes(np.column_stack([np.full(len(around), 0.1498), around]), near=1e-7)[0]
    assert sorted(set(modes.tolist())) == [4, 6]
    assert np.count_nonzero(np.diff(modes)) == 2
    assert np.mean(modes == 6) < 0.2


@pytest.mark.parametrize("name", ["rpdr", "planar_3rrr", "delta"])
def test_third_derivatives_against_differences(name):
    """Σ φ_ijk v_k is the derivative of φ_ij along v."""
    at = reading(ccpin.load(name)).problem
    rng = np.random.default_rng(6)
    theta, v, step = rng.normal(size=(1, at.system.n_free)), rng.normal(size=(1, at.system.n_free)), 1e-5
    ends = [derivatives(at, theta + side * step * v).hessian for side in (1.0, -1.0)]
    expected = (ends[0] - ends[1]) / (2.0 * step)
    assert np.abs(third_along(at, theta, v) - expected).max() < 1e-8


def test_the_slope_and_its_drift():
    """F′ is the derivative of F, and Δ bounds how it changes on balls up to 1e-2."""
    at = reading(load_slice()).problem
    rng = np.random.default_rng(7)
    m, n = at.system.m, at.system.n
    for _ in range(20):
        pairing = rng.normal(size=(1, m))
        pairing /= np.linalg.norm(pairing)
        equations = Prolongation(closures_of(at), np.zeros((1, n)), np.eye(n)[None], pairing)

        def point(x, equations=equations):
            return equations.at(x, lambda theta: derivatives(at, theta))

        x = np.concatenate([rng.uniform(0.1, 0.3, (1, n)), rng.normal(size=(1, 3 * m))], axis=1)
        slope = equations.slope(point(x))[0]
        for k in range(x.shape[1]):
            step = 1e-6 * np.eye(1, x.shape[1], k)
            column = (equations.value(point(x + step)) - equations.value(point(x - step)))[0] / 2e-6
            assert np.abs(slope[:, k] - column).max() < 1e-7
        radius = 10.0 ** rng.uniform(-6, -2)
        drift = equations.drift(point(x), np.array([radius]))[0]
        for _ in range(50):
            moved = x + radius * rng.choice([-1.0, 1.0], x.shape)
            assert np.all(np.abs(equations.slope(point(moved))[0] - slope) <= drift + 1e-12)


@pytest.mark.slow
def test_a_fold_is_no_cusp(rpdr):
    """The five-bar's stretched loop is folded everywhere: nothing is proved from any of its points."""
    curves = domain.singularities(rpdr, starts=12)
    assert domain.cusps(rpdr, curves=curves) == ()
    at = reading(rpdr)
    theta = np.array([at.theta(q) for curve in curves if curve.kind == "fold" for q in curve.q_free[::40]])
    assert proved_cusps(at, theta) == []


def test_other_numbers_of_coordinates_are_refused():
    """Cusps are points where n = 2."""
    with pytest.raises(UnsupportedMechanismError):
        domain.cusps(ccpin.load("four_bar"))
