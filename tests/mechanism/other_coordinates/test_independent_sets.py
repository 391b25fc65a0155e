"""Siblings: one mechanism in other independent coordinates, chosen where its own are poor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ccpin
from ccpin.mechanism.other_coordinates.independent_sets import (
    LEVERAGE,
    Measure,
    _swapped,
    best_independent,
    with_independent,
)
from tests.support import linkages


@pytest.fixture(scope="module", params=["rpdr", "stewart", "hexa", "delta", "balls", "strandbeest"])
def model(request):
    """Planar and spatial ones, with ball joints and with a floating base."""
    own = {"balls": linkages.stewart_on_balls, "strandbeest": linkages.strandbeest}
    subject = own[request.param]() if request.param in own else request.param
    return ccpin.ReducedModel(ccpin.load(subject, floating_base=request.param == "strandbeest"))


def near(model, seed):
    """A State a little off the reference."""
    rng = np.random.default_rng(seed)
    q = model.alpha(model.mechanism.q_reference)
    return model.at(model.coordinates.integrate(q, 0.03 * rng.standard_normal(model.n)), model.mechanism.q_reference)


@pytest.mark.parametrize("seed", range(3))
def test_the_best_coordinates_are_as_good_as_the_theorem_says(model, seed):
    """|X_ij| ≤ 2 and ‖X‖ ≤ √(1 + f² n (n′ − n)), X = ρ in comparable units, from an independent null space."""
    state = near(model, seed)
    mechanism = model.mechanism
    sibling = with_independent(mechanism, best_independent(mechanism, state.q_free, state.rho), state.q_free)
    measure, n, free = Measure(sibling), model.n, mechanism.n_free
    X = measure.rows[:, None] * sibling.parametrization().at(state.q_free).rho / measure.columns
    assert np.linalg.norm(X, 2) <= np.sqrt(1 + LEVERAGE**2 * n * (free - n))
    if mechanism.parametrization().coordinates.scalar:  # components are entries of q̇′ themselves
        assert np.abs(X).max() <= LEVERAGE * (1 + 1e-9)
        assert measure.leverage(sibling.parametrization().at(state.q_free).rho) == pytest.approx(np.abs(X).max())


@pytest.mark.parametrize("seed", range(3))
def test_energy_acceleration_and_forces_do_not_depend_on_the_coordinates(model, seed):
    """T, V, q̈′ and φ_q′ᵀλ of a sibling at the same q′ and q̇′ under the same motors' efforts."""
    state, rng = near(model, seed), np.random.default_rng(seed)
    v, u = rng.standard_normal(model.n), rng.standard_normal(model.n_actuated)
    names = best_independent(model.mechanism, state.q_free, state.rho)
    other = ccpin.ReducedModel(with_independent(model.mechanism, names, state.q_free), model.gravity_vector)
    there = other.at(other.alpha(state.q_free), state.q_free)
    w = other.coordinates.jacobian(state.q_free) @ state.v_free(v)
    assert there.energy(w) == pytest.approx(state.energy(v), rel=1e-9)
    assert model.reading(there, w).v == pytest.approx(v, rel=1e-9, abs=1e-9)
    a, b = state.forward_dynamics(v, u), there.forward_dynamics(w, u)
    scale = np.abs(state.a_free(v, a)).max()
    np.testing.assert_allclose(there.a_free(w, b), state.a_free(v, a), rtol=0, atol=1e-7 * max(1.0, scale))
    jacobian = model.parametrization.constraints.value(state.q_free).jacobian
    ours, theirs = (jacobian.T @ at.constraint_forces(x, u) for at, x in ((state, v), (there, w)))
    np.testing.assert_allclose(theirs, ours, rtol=0, atol=1e-7 * max(1.0, np.abs(ours).max()))


@given(st.integers(2, 7), st.integers(1, 6), st.floats(0.05, 1.4), st.randoms(use_true_random=False))
def test_swaps_end_at_the_bound_where_pivots_alone_do_not(n, more, angle, random):
    """Kahan's matrices, on which pivoting by length is exponentially bad, with rows shuffled and random ones added."""
    c, s = np.cos(angle), np.sin(angle)
    kahan = np.diag(s ** np.arange(n)) @ (np.eye(n) - c * np.triu(np.ones((n, n)), 1))
    added = np.array([[random.uniform(-1, 1) for _ in range(n)] for _ in range(more)])
    basis = np.linalg.qr(np.vstack([kahan.T, added]))[0]
    rows = _swapped(basis, list(range(n)))
    X = basis @ np.linalg.inv(basis[rows])
    assert len(set(rows)) == n
    assert np.abs(X).max() <= LEVERAGE * (1 + 1e-9)
