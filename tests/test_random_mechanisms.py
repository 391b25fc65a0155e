"""Every identity of the reduced model on random mechanisms: trees, loops and closures of every kind."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ccpin
from ccpin.errors import SingularConfigurationError, UnreachableError
from tests.oracles import descriptor
from tests.oracles.finite_differences import assert_close, derivative, velocity
from tests.support.strategies import mechanisms

seeds = st.integers(0, 2**32 - 1)


class State:
    """A random mechanism at a random state near its reference, and the smooth curve σ(q ⊕ (s q̇ + ½ s² q̈)).

    The velocities are scaled to ‖ρ q̇‖ = ‖ρ q̈‖ = 1 and the finite differences' step to how fast ρ turns, which near
    a singularity is fast.
    """

    def __init__(self, drawn, seed):
        self.drawn, self.seed = drawn, seed
        rng = np.random.default_rng(seed)
        independent = ccpin.load(drawn.description, free=["all"]).independent
        self.mechanism = ccpin.load(drawn.description, actuated=independent, free=["all"])
        self.model = ccpin.ReducedModel(self.mechanism)
        self.pin_model = self.mechanism.pin_model
        self.q, self.q_free = self.somewhere(rng)
        self.u = rng.normal(size=self.model.n_actuated)
        assume(self.model.parametrization.rcond(self.q_free) > 1e-3)
        rho = self.model.rho(self.q_free)
        self.v, self.a = (x / np.linalg.norm(rho @ x) for x in rng.normal(size=(2, self.model.n)))
        rate = self.model.rho_dot(self.q_free, rho @ self.v)
        self.step = 1e-2 / max(10.0, float(np.linalg.norm(rate, 2)))

    def __repr__(self):
        return f"State({self.drawn}, seed={self.seed})"

    def somewhere(self, rng):
        """A q off the reference, halfway back as long as it cannot be reached."""
        coordinates = self.model.coordinates
        start = self.model.alpha(self.mechanism.q_reference)
        step = 0.2 * rng.normal(size=self.model.n)
        for _ in range(14):
            q = coordinates.integrate(start, step)
            try:
                return q, self.model.sigma(q)
            except (UnreachableError, SingularConfigurationError):
                step = 0.5 * step
        raise AssertionError("σ does not exist even next to the reference")

    def q_at(self, s):
        return self.model.coordinates.integrate(self.q, s * self.v + 0.5 * s * s * self.a)

    def curve(self, s):
        return self.model.sigma(self.q_at(s), self.q_free)

    @property
    def tau(self):
        return self.model.at(self.q, self.q_free).joint_efforts(self.u)


def states(**options):
    return st.builds(State, mechanisms(**options), seeds)


@settings(max_examples=8)
@given(mechanisms())
def test_reference_is_the_pose_drawn(drawn):
    """The tree puts every link where NumPy's forward kinematics does, and the closures are closed there."""
    mechanism = ccpin.load(drawn.description, free=["all"])
    model, data = mechanism.pin_model, mechanism.pin_model.createData()
    assume("the loops were closed from a step away from a singular closed pose" not in mechanism.notes)
    pin.framesForwardKinematics(model, data, mechanism.q_reference)
    for link, pose in drawn.poses.items():
        np.testing.assert_allclose(data.oMf[model.getFrameId(link)].homogeneous, pose, rtol=0, atol=1e-10)
    assert np.abs(mechanism.constraints().residual(mechanism.q_reference)).max(initial=0.0) <= 1e-10


@settings(max_examples=8)
@given(states())
def test_sigma_is_closed_and_has_the_coordinates_asked_for(state):
    """φ(σ(q)) = 0 by the oracle's own rows, and α(σ(q)) = q."""
    rows = descriptor.rows(state.mechanism.description, state.pin_model, state.q_free, np.zeros(state.pin_model.nv))
    assert max(abs(row.value) for row in rows) <= 1e-10
    step = state.model.coordinates.difference(state.model.alpha(state.q_free), state.q)
    np.testing.assert_allclose(step, 0.0, rtol=0, atol=1e-10)


@settings(max_examples=7)
@given(states())
def test_rho_and_its_rate(state):
    """ρ q̇ is the velocity of the curve σ(q(t)), and ρ̇ the rate of ρ along it."""
    v_free = state.model.rho(state.q_free) @ state.v
    assert_close(v_free, velocity(state.pin_model, state.curve, state.step), 1e-7)
    rho_dot = derivative(lambda s: state.model.rho(state.curve(s)), state.step)
    assert_close(
        state.model.rho_dot(state.q_free, v_free), rho_dot, 1e-7, scale=1.0
    )  # ρ of joints side by side changes by about 1 in a radian


@settings(max_examples=7)
@given(states())
def test_mass_matrix_is_the_kinetic_energy(state):
    """D is symmetric, positive definite, and ½ q̇ᵀD q̇ is the energy of the moving bodies and rotors."""
    terms = state.model.terms(state.q, state.v)
    assert_close(terms.D, terms.D.T, 1e-13)
    assert np.linalg.eigvalsh(terms.D).min() > 0
    tree, data = state.pin_model, state.pin_model.createData()
    pin.forwardKinematics(tree, data, terms.q_free, terms.v_free)
    kinetic = sum(0.5 * tree.inertias[j].vtiv(data.v[j]) for j in range(1, tree.njoints))
    kinetic += 0.5 * tree.armature @ terms.v_free**2
    assert 0.5 * state.v @ terms.D @ state.v == pytest.approx(kinetic, rel=1e-11)
    assert state.model.energy(state.q, state.v).kinetic == pytest.approx(kinetic, rel=1e-12)


@settings(max_examples=7)
@given(states())
def test_mass_rate_less_twice_coriolis_is_skew(state):
    """Lemma III.1: Ḋ − 2C is skew symmetric, Ḋ by finite differences along the motion."""
    rate = derivative(lambda s: state.model.terms(state.q_at(s), state.v, state.q_free).D, state.step)
    terms = state.model.terms(state.q, state.v)
    skew = rate - 2.0 * terms.C
    scale = max(min(1.0, np.abs(terms.D).max()), np.abs(rate).max())
    assert_close(skew + skew.T, np.zeros_like(skew), 1e-9, scale=scale)


@settings(max_examples=7)
@given(states())
def test_power_balance(state):
    """d(T + V)/dt = q̇ᵀ(D q̈ + C q̇ + g), the left side by finite differences of the free system's energies."""
    terms = state.model.terms(state.q, state.v)
    power = state.v @ (terms.D @ state.a + terms.C @ state.v + terms.g)

    def energy(s):
        return sum(state.model.energy(state.q_at(s), state.v + s * state.a, state.q_free))

    assert_close(power, derivative(energy, state.step), 1e-8 * max(1.0, abs(energy(0.0))))


@settings(max_examples=7)
@given(states())
def test_inverse_dynamics_undoes_forward_dynamics(state):
    """Where every independent coordinate has a motor, ID(FD(u)) = u; ID is D q̈ + C q̇ + g."""
    model = state.model
    here = model.at(state.q)
    terms = here.terms(state.v)
    force = terms.D @ state.a + terms.C @ state.v + terms.g
    a = model.forward_dynamics(state.q, state.v, state.u)
    assert_close(terms.D @ a + terms.C @ state.v + terms.g, terms.rho.T @ state.tau, 1e-9)
    u = model.inverse_dynamics(state.q, state.v, state.a)
    assert_close(terms.rho.T @ here.joint_efforts(u), force, 1e-9)
    transmission = terms.rho.T @ np.array([here.joint_efforts(e) for e in np.eye(model.n_actuated)]).T
    assume(np.linalg.matrix_rank(transmission, tol=1e-6) == model.n_actuated)
    assert_close(model.inverse_dynamics(state.q, state.v, a), state.u, 1e-7)


@settings(max_examples=8)
@given(states())
def test_motion_solves_the_descriptor_form(state):
    """q̈′ = ρ q̈ + ρ̇ q̇ and φ_q′ᵀλ are those of (19) solved directly with rows written anew."""
    _assert_same_motion(state, descriptor.direct)


@settings(max_examples=7)
@given(states(kinds=("spherical", "fixed")))
def test_motion_is_pinocchios(state):
    """The same, against Pinocchio's proximal constrained dynamics."""
    _assert_same_motion(state, descriptor.pinocchio)


def _assert_same_motion(state, solver):
    model, terms = state.model, state.model.terms(state.q, state.v)
    a = model.forward_dynamics(state.q, state.v, state.u)
    expected = solver(state.mechanism.description, state.pin_model, terms.q_free, terms.v_free, state.tau)
    assert_close(terms.rho @ a + terms.rho_dot @ state.v, expected.a_free, 1e-9)
    multipliers = model.constraint_forces(state.q, state.v, state.u)
    jacobian = state.mechanism.constraints().value(terms.q_free).jacobian
    scale = max(1.0, float(np.abs(expected.a_free).max()))
    assert_close(jacobian.T @ multipliers, expected.force, 1e-9 * scale)
    np.testing.assert_allclose(terms.rho.T @ jacobian.T, 0.0, rtol=0, atol=1e-10 * np.abs(terms.rho).max() * 10)
