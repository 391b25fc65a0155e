"""D, C, g, q̈, u, λ and energy of the five-bar against the paper's closed forms, (19) and Pinocchio."""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.errors import UnderactuatedError
from tests.oracles import descriptor
from tests.oracles import rpdr as oracle
from tests.oracles.finite_differences import assert_close, derivative
from tests.support.long_cases import later
from tests.support.paper import COUNT, MODES, order, to_free


def relative(found, expected):
    return np.abs(found - expected).max() / np.abs(expected).max()


def random_states(rng, count, mode):
    for q_paper in oracle.random_configurations(rng, count, mode):
        yield q_paper, rng.normal(scale=3.0, size=2), rng.normal(size=2)


@pytest.mark.parametrize("mode", MODES)
def test_closed_forms_in_each_mode(rpdr, rpdr_model, mode):
    """D (23), C (24), g (25) from D′ (36), C′ (37), g′ (38) at random states of each mode."""
    for q_paper, v, _ in random_states(np.random.default_rng(50 + mode), COUNT, mode):
        terms = rpdr_model.terms(q_paper[:2], v, to_free(rpdr, q_paper + 1e-4))
        mass, coriolis, gravity = oracle.reduced_terms(q_paper, v)
        assert relative(terms.D, mass) <= 1e-10
        assert relative(terms.C, coriolis) <= 1e-10
        assert_close(terms.g, gravity, 1e-10)
        assert_close(rpdr_model.gravity(q_paper[:2], to_free(rpdr, q_paper)), gravity, 1e-10)


@pytest.mark.parametrize("states", later(50, 200))
@pytest.mark.parametrize("mode", MODES)
def test_dynamics_against_other_engines(rpdr, rpdr_model, mode, states):
    """q̈ and λ agree with (19) solved directly and with Pinocchio's constrained dynamics."""
    spherical = replace(rpdr.description, closures=(replace(rpdr.closures[0], kind="spherical"),))
    rows = [list(rpdr.pin_model.names).index(name) - 1 for name in rpdr.independent]
    basis = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # φ's rows are along x and z
    for q_paper, v, u in random_states(np.random.default_rng(60 + mode), states, mode):
        near = to_free(rpdr, q_paper)
        q_free = rpdr_model.sigma(q_paper[:2], near)
        v_free, tau = rpdr_model.rho(q_free) @ v, rpdr.actuation.T @ u
        a = rpdr_model.forward_dynamics(q_paper[:2], v, u, near)
        force = rpdr_model.constraint_forces(q_paper[:2], v, u, near)
        for solver, description in ((descriptor.direct, rpdr.description), (descriptor.pinocchio, spherical)):
            expected = solver(description, rpdr.pin_model, q_free, v_free, tau)
            assert relative(a, expected.a_free[rows]) <= 1e-9
            jacobian = rpdr.constraints().value(q_free).jacobian
            assert_close(jacobian.T @ force, expected.force, 1e-9)
            if solver is descriptor.pinocchio:
                assert_close(force, basis @ expected.multipliers, 1e-9)


@pytest.mark.parametrize("mode", MODES)
def test_mass_rate_less_twice_coriolis_is_skew(rpdr, rpdr_model, mode):
    """Lemma III.1: Ḋ − 2C is skew symmetric, Ḋ by finite differences of the closed form's D along the motion."""
    for q_paper, v, _ in random_states(np.random.default_rng(70 + mode), 100, mode):
        if abs(np.sin(oracle.fold(q_paper))) < 0.2:
            continue
        rate = derivative(lambda s: oracle.reduced_terms(oracle.sigma(q_paper[:2] + s * v, mode), v)[0], 5e-5)  # noqa: B023
        skew = rate - 2.0 * rpdr_model.terms(q_paper[:2], v, to_free(rpdr, q_paper)).C
        assert_close(skew + skew.T, np.zeros((2, 2)), 1e-9, scale=np.abs(rate).max())


@pytest.mark.parametrize("mode", MODES)
def test_power_balance(rpdr, rpdr_model, mode):
    """d(T + V)/dt = q̇ᵀu along the motion u makes."""
    for q_paper, v, u in random_states(np.random.default_rng(80 + mode), 100, mode):
        if abs(np.sin(oracle.fold(q_paper))) < 0.2:
            continue
        q, near = q_paper[:2], to_free(rpdr, q_paper)
        a = rpdr_model.forward_dynamics(q, v, u, near)

        def energy(s, q=q, v=v, a=a, near=near):
            return sum(rpdr_model.energy(q + s * v + 0.5 * s * s * a, v + s * a, near))

        step = 1e-3 / max(10.0, np.linalg.norm(a) ** 0.5, np.linalg.norm(v))
        assert_close(derivative(energy, step), v @ u, 1e-7 * max(1.0, np.linalg.norm(a)))


def test_inverse_dynamics_undoes_forward_dynamics(rpdr_model):
    """ID(q, q̇, FD(q, q̇, u)) = u, and FD undoes ID."""
    rng = np.random.default_rng(90)
    for q in rng.uniform([-2.6, -2.7], [-1.6, -1.8], (50, 2)):
        v, u, a = rng.normal(size=(3, 2))
        assert_close(rpdr_model.inverse_dynamics(q, v, rpdr_model.forward_dynamics(q, v, u)), u, 1e-11)
        assert_close(rpdr_model.forward_dynamics(q, v, rpdr_model.inverse_dynamics(q, v, a)), a, 1e-9)


def test_energy_is_the_papers(rpdr, rpdr_model):
    """T = ½ q̇ᵀD q̇ with the motors' inertia, and ∂V/∂q = g."""
    rng = np.random.default_rng(91)
    for q in rng.uniform([-2.6, -2.7], [-1.6, -1.8], (20, 2)):
        v = rng.normal(size=2)
        mass, _, gravity = oracle.reduced_terms(oracle.sigma(q, 1), v)
        assert rpdr_model.energy(q, v).kinetic == pytest.approx(0.5 * v @ mass @ v, rel=1e-10)
        slope = [derivative(lambda s, e=e, q=q, v=v: rpdr_model.energy(q + s * e, v).potential) for e in np.eye(2)]
        assert_close(np.array(slope), gravity, 1e-9)


def test_many_is_each(rpdr_model):
    """The vectorised calls give each row's own result, bit for bit, and an empty batch gives empty arrays."""
    rng = np.random.default_rng(92)
    Q, (V, U) = rng.uniform([-2.6, -2.7], [-1.6, -1.8], (7, 2)), rng.normal(size=(2, 7, 2))
    terms = rpdr_model.terms_many(Q, V)
    accelerations, points = rpdr_model.forward_dynamics_many(Q, V, U), rpdr_model.sigma_many(Q)
    for k in range(7):
        np.testing.assert_array_equal(points[k], rpdr_model.sigma(Q[k]))
        np.testing.assert_array_equal(accelerations[k], rpdr_model.forward_dynamics(Q[k], V[k], U[k]))
        for many, one in zip(terms, rpdr_model.terms(Q[k], V[k]), strict=True):
            np.testing.assert_array_equal(many[k], one)
    assert rpdr_model.sigma_many(np.empty((0, 2))).shape == (0, 4)
    assert rpdr_model.forward_dynamics_many(*np.empty((3, 0, 2))).shape == (0, 2)


def test_many_of_nothing_keeps_the_fields(rpdr_model):
    """terms_many of an empty batch has every field, with a leading axis of zero."""
    terms = rpdr_model.terms_many(np.empty((0, 2)), np.empty((0, 2)))
    assert [len(field) for field in terms] == [0] * 7
    assert terms.D.shape == (0, 2, 2)


def test_other_motors_enter_through_their_joints(rpdr):
    """With motors on joints 3 and 4, q̈ is (19)'s with u there, and one motor alone cannot make every motion."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"]))
    q, v, u = np.array([-2.0, -2.1]), np.array([0.4, -0.3]), np.array([0.7, -0.2])
    a = model.forward_dynamics(q, v, u)
    tau = to_free(rpdr, [0.0, 0.0, *u])
    q_free = model.sigma(q)
    expected = descriptor.direct(rpdr.description, rpdr.pin_model, q_free, model.rho(q_free) @ v, tau)
    assert_close(a, expected.a_free[order(rpdr)[:2]], 1e-9)
    assert_close(model.inverse_dynamics(q, v, a), u, 1e-9)
    single = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint1"]))
    reachable = single.forward_dynamics(q, v, [0.5])
    assert_close(single.inverse_dynamics(q, v, reachable), np.array([0.5]), 1e-9)
    with pytest.raises(UnderactuatedError, match="1 motors"):
        single.inverse_dynamics(q, v, reachable + [0.0, 5.0])


def test_other_independent_coordinates_describe_the_same_motion(rpdr, rpdr_model):
    """With (joint2, joint3) as q, the motion of the whole free system is unchanged."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", independent=["joint3", "joint2"], actuated=["joint1", "joint2"]))
    q, v, u = np.array([-2.0, -2.1]), np.array([0.4, -0.3]), np.array([0.7, -0.2])
    q_free = rpdr_model.sigma(q)
    v_free = rpdr_model.rho(q_free) @ v
    terms = rpdr_model.terms(q, v)
    expected = terms.rho @ rpdr_model.forward_dynamics(q, v, u) + terms.rho_dot @ v
    rows = [order(rpdr)[2], order(rpdr)[1]]
    other = model.forward_dynamics(model.alpha(q_free), v_free[rows], u, q_free)
    np.testing.assert_allclose(other, expected[rows], rtol=0, atol=1e-9)


def test_redundant_rows_get_the_least_multipliers():
    """Bennett's linkage: λ has the least norm, also where rounding leaves the redundant rows not quite redundant."""
    mechanism = ccpin.load("bennett")
    model, rng = ccpin.ReducedModel(mechanism), np.random.default_rng(1)
    start = model.alpha(mechanism.q_reference)
    for step in 0.3 * rng.normal(size=(60, model.n)):
        q, v, u = start + step, rng.normal(size=model.n), rng.normal(size=model.n)
        found = model.constraint_forces(q, v, u)
        jacobian = mechanism.constraints().value(model.sigma(q)).jacobian
        least = np.linalg.lstsq(jacobian.T, jacobian.T @ found, rcond=1e-9)[0]
        np.testing.assert_allclose(found, least, rtol=0, atol=1e-10 * max(1.0, float(np.abs(least).max())))
