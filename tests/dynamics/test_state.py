"""A State: closed by construction, immutable, the same answers as the model's shorthands, each computed once."""

import pickle

import numpy as np
import pytest

import ccpin
from ccpin.control import (
    ComputedTorque,
    ControlLaw,
    CoulombCompensation,
    Measurement,
    PDFullGravity,
    PDPlus,
    PDSimpleGravity,
    PointToPoint,
)
from ccpin.dynamics import assembly_modes
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError, UnreachableError
from ccpin.kinematics.parametrization import Parametrization
from ccpin.simulation import closure_forces, joint_forces
from tests.oracles.finite_differences import assert_close
from tests.support.agreement import reference_model

PLACES = {"rpdr": np.radians([-150.0, -160.0]), "delta": np.array([-0.2, 0.1, 0.0])}
OUT_OF_REACH = {"rpdr": [1.5, -1.5], "delta": [2.8, 3.1, 3.0]}
GAINS = {"rpdr": ([11.0, 11.0], [0.65, 0.6]), "delta": ([40.0] * 3, [8.0] * 3)}


@pytest.fixture(scope="module", params=sorted(PLACES))
def model(request):
    """A reduced model."""
    return ccpin.ReducedModel(ccpin.load(request.param))


@pytest.fixture
def place(model):
    """q on the reference's branch, with random v, a and u."""
    rng = np.random.default_rng(5)
    return PLACES[model.mechanism.name], *rng.normal(size=(3, model.n))


def flat(result):
    """A result's arrays, side by side."""
    return np.concatenate([np.ravel(part) for part in (result if isinstance(result, tuple) else (result,))])


@pytest.fixture
def sigmas(monkeypatch):
    """How often σ is computed."""
    counted, sigma = [], Parametrization.sigma

    def counting(self, *arguments):
        counted.append(1)
        return sigma(self, *arguments)

    monkeypatch.setattr(Parametrization, "sigma", counting)
    return counted


def test_it_is_closed(model, place):
    """φ(σ(q)) = 0 and α(σ(q)) = q to solver tolerance."""
    state = model.at(place[0])
    assert np.abs(model.parametrization.constraints.residual(state.q_free)).max() < 1e-12
    np.testing.assert_allclose(model.alpha(state.q_free), place[0], rtol=0, atol=1e-12)
    assert 1e-4 < state.rcond <= 1.0


def test_shorthands_are_its_methods(model, place):
    """Every method of the model with `near` gives what the State gives, bit for bit."""
    q, v, a, u = place
    state = model.at(q)
    for name, arguments in (
        ("terms", (v,)),
        ("energy", (v,)),
        ("forward_dynamics", (v, u)),
        ("inverse_dynamics", (v, a)),
        ("constraint_forces", (v, u)),
        ("forward_dynamics_derivatives", (v, u)),
        ("inverse_dynamics_derivatives", (v, a)),
        ("generalized_force_derivatives", (v, a)),
    ):
        short, method = getattr(model, name)(q, *arguments), getattr(state, name)(*arguments)
        np.testing.assert_array_equal(flat(short), flat(method), err_msg=name)
    np.testing.assert_array_equal(model.sigma(q), state.q_free)
    np.testing.assert_array_equal(model.gravity(q), state.g)
    np.testing.assert_array_equal(model.gravity_derivative(q), state.gravity_derivative)


def test_its_parts_fit(model, place):
    """τ = D q̈ + C q̇ + g, q̈′ = ρ q̈ + ρ̇ q̇, and efforts undo generalized_force."""
    q, v, a, u = place
    state = model.at(q)
    terms = state.terms(v)
    assert_close(state.tau(v, a), state.D @ a + state.C(v) @ v + state.g, 1e-10)
    assert_close(state.a_free(v, a), state.rho @ a + state.rho_dot(v) @ v, 1e-10)
    assert_close(state.v_free(v), terms.v_free, 1e-15)  # one sum in two orders
    assert_close(state.rho.T @ state.joint_efforts(u), state.generalized_force(u), 1e-10)
    assert_close(state.efforts(state.generalized_force(u)), u, 1e-10)


def test_nothing_of_it_can_be_changed(model, place):
    """Neither its attributes nor its arrays, nor the q it was made from."""
    q, v = place[0].copy(), place[1]
    state = model.at(q)
    q += 1.0
    np.testing.assert_array_equal(state.q, place[0])
    for name in ("q", "model", "D", "rho", "anything"):
        with pytest.raises((AttributeError, TypeError)):
            setattr(state, name, 0.0)
    for array in (state.q, state.q_free, state.rho, state.D, state.g, state.gravity_derivative, state.terms(v).D):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_each_thing_is_computed_once(model, place, sigmas):
    """One σ for any number of questions; D, g and ∂g/∂q are the same objects when asked again."""
    q, v, a, u = place
    model = reference_model(model.mechanism)
    state = model.at(q)
    state.terms(v), state.forward_dynamics(v, u), state.constraint_forces(v, u), state.inverse_dynamics(v, a)
    state.energy(v), state.forward_dynamics_derivatives(v, u), model.at(state)
    assert len(sigmas) == 1
    assert model.at(state) is state
    assert all(getattr(state, name) is getattr(state, name) for name in ("D", "g", "gravity_derivative"))


def test_near_is_a_state_or_a_configuration(model, place):
    """Both choose the branch, and agree; a State of another mechanism is refused."""
    state = model.at(place[0])
    moved = place[0] + 0.02
    near = model.at(moved, state)
    np.testing.assert_allclose(near.q_free, model.at(moved, state.q_free).q_free, rtol=0, atol=1e-12)
    np.testing.assert_allclose(near.q_free, model.sigma(moved), rtol=0, atol=1e-12)
    other = ccpin.ReducedModel(ccpin.load("four_bar"))
    with pytest.raises(InvalidInputError, match="pass its q_free"):
        other.at([0.1], state)


def test_the_other_branch_is_kept():
    """A State of the other assembly mode leads to the other mode."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    q = PLACES["rpdr"]
    other = next(mode for mode in assembly_modes(model, q).modes if not mode.is_reference)
    there = model.at(q, other.q_free)
    follows = model.at(q + 0.05, there)
    assert np.abs(follows.q_free - there.q_free).max() < 0.3
    assert np.abs(follows.q_free - model.sigma(q + 0.05)).max() > 0.3


def test_it_survives_pickling(model, place):
    """A copy gives the same numbers and is as read-only."""
    q, v, _, u = place
    state = model.at(q)
    copy = pickle.loads(pickle.dumps(state))
    np.testing.assert_array_equal(copy.forward_dynamics(v, u), state.forward_dynamics(v, u))
    assert not copy.q_free.flags.writeable
    assert repr(copy) == repr(state)
    assert "\n" not in repr(state)


def test_bad_arguments_are_named(model, place):
    """v, a and u of the wrong shape, and q out of reach."""
    q, v, a, u = place
    state = model.at(q)
    for name, call in (
        ("v", lambda: state.terms(v[:-1])),
        ("a", lambda: state.tau(v, np.nan * a)),
        ("u", lambda: state.forward_dynamics(v, u[None])),
        ("force", lambda: state.efforts([])),
    ):
        with pytest.raises(InvalidInputError, match=rf"^{name} has"):
            call()
    with pytest.raises(UnreachableError):
        model.at(OUT_OF_REACH[model.mechanism.name], state)


def test_gravity_is_an_argument(model, place):
    """g and V are linear in gravity, two models of one mechanism differ, and the mechanism's own stays as it was."""
    q, v, _, _ = place
    down, none = (ccpin.ReducedModel(model.mechanism, gravity) for gravity in ((0.0, 0.0, -19.62), np.zeros(3)))
    assert_close(down.gravity(q), 2.0 * model.gravity(q), 1e-10)
    assert_close(down.energy(q, v).potential, 2.0 * model.energy(q, v).potential, 1e-10)
    assert np.abs(none.gravity(q)).max() == 0.0
    np.testing.assert_array_equal(model.gravity_vector, [0.0, 0.0, -9.81])
    np.testing.assert_array_equal(model.mechanism.pin_model.gravity.linear, [0.0, 0.0, -9.81])
    state = model.at(q)
    np.testing.assert_array_equal(none.at(state).g, none.gravity(q))
    assert none.at(state).q_free is state.q_free
    for wrong in ([0.0, -9.81], [0.0, 0.0, np.nan], "down"):
        with pytest.raises(InvalidInputError, match="gravity"):
            ccpin.ReducedModel(model.mechanism, wrong)


def test_writing_to_the_pinocchio_model_changes_nothing(place, model):
    """A model keeps its own copy of masses and gravity."""
    fresh = ccpin.ReducedModel(ccpin.load(model.mechanism.name))
    q, v, _, u = place
    before = fresh.forward_dynamics(q, v, u)
    fresh.mechanism.pin_model.gravity.linear = np.array([1.0, 2.0, 3.0])
    fresh.mechanism.pin_model.inertias[1].mass *= 7.0
    np.testing.assert_array_equal(fresh.forward_dynamics(q, v, u), before)


def test_a_bearing_carries_the_models_weight():
    """The joints' forces of a mechanism at rest, its motors holding it, are linear in the model's own gravity."""
    mechanism = ccpin.load("rpdr")
    loads = []
    for gravity in ((0.0, 0.0, -9.81), (0.0, 0.0, -1.62)):
        model = ccpin.ReducedModel(mechanism, gravity)
        law = PDFullGravity(model, PLACES["rpdr"], *GAINS["rpdr"])
        still = ccpin.simulate(model, law, PLACES["rpdr"], duration=2e-3)
        loads.append(np.array([bearing.force[-1] for bearing in joint_forces(model, still)]))
    assert np.abs(loads[0]).max() > 1.0
    np.testing.assert_allclose(loads[1], loads[0] * 1.62 / 9.81, rtol=0, atol=1e-7)


def test_a_mechanism_stands_for_its_model():
    """Functions that need masses take a mechanism, those that need geometry a model."""
    mechanism, q = ccpin.load("rpdr"), PLACES["rpdr"]
    model = ccpin.ReducedModel(mechanism)
    goal = np.radians([-90.0, -100.0])
    laws = [PDSimpleGravity(subject, goal, *GAINS["rpdr"]) for subject in (mechanism, model)]
    motions = [ccpin.simulate(s, law, q, duration=0.02) for s, law in zip((mechanism, model), laws, strict=True)]
    np.testing.assert_array_equal(motions[0].q, motions[1].q)
    for function in (joint_forces, closure_forces):
        first, second = (function(subject, motions[0]) for subject in (mechanism, model))
        np.testing.assert_array_equal(first[0].force, second[0].force)
    references = [PointToPoint(subject, q, goal, 1.0).at(0.3) for subject in (mechanism, model)]
    np.testing.assert_array_equal(*(reference.q for reference in references))


class Watching(ControlLaw):
    """A law that notes how often another one computes σ for itself."""

    def __init__(self, law, sigmas):
        self.law, self.sigmas, self.own, self.calls = law, sigmas, 0, 0

    def torque(self, t, state, v):
        assert isinstance(state, State), "simulate has a State and must use it"
        before = len(self.sigmas)
        u = self.law.torque(t, state, v)
        self.own, self.calls = self.own + len(self.sigmas) - before, self.calls + 1
        return u


def laws_for(model, q):
    """One of each law that needs σ, and compensation on top of one."""
    gains, end = GAINS[model.mechanism.name], q + 0.1
    reference = PointToPoint(model, q, end, 0.5)
    full = PDFullGravity(model, end, *gains)
    return [full, ComputedTorque(model, reference, *gains), PDPlus(model, reference, *gains)] + [
        CoulombCompensation(full, 0.1, q)
    ]


def test_a_simulation_computes_sigma_once_an_evaluation(model, place, sigmas):
    """Laws read the State: σ is computed at most once an evaluation, a sample and a step, and never by the law."""
    for law in laws_for(model, place[0]):
        watching = Watching(law, sigmas)
        sigmas.clear()
        motion = ccpin.simulate(model, watching, place[0], duration=0.02, sample_period=5e-3)
        assert motion.status == "finished"
        assert watching.own == 0
        assert watching.calls >= motion.evaluations
        assert len(sigmas) <= 1.3 * motion.evaluations + len(motion.t) + 2


def test_a_state_and_its_q_give_a_law_the_same_torque(model, place):
    """A law finds the State of a q that is measured, and lyapunov takes either."""
    q, v, _, _ = place
    state = model.at(q)
    for law in laws_for(model, q):
        for near in (None, state, state.q_free):
            u = law.torque(0.1, Measurement(q, near), v)
            np.testing.assert_allclose(law.torque(0.1, state, v), u, rtol=1e-9, atol=1e-12)
    full = laws_for(model, q)[0]
    assert full.lyapunov(state, v) == pytest.approx(full.lyapunov(q, v, state.q_free), rel=1e-12)
