"""Tracking laws: their formulas, what they do to the error, and σ computed in real time."""

import numpy as np
import pytest
from scipy.linalg import expm

import ccpin
from ccpin.control import (
    ComputedTorque,
    Hold,
    Measurement,
    PDFullGravity,
    PDOnlineGravity,
    PDPlus,
    PointToPoint,
    WithSigmaError,
)
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from tests.oracles import rpdr
from tests.oracles.finite_differences import derivative
from tests.support.ball_joint import ball_joint
from tests.support.paper import GOAL, K_V, START

MOVES = {
    "rpdr": (START, GOAL),
    "delta": (np.array([-0.2, 0.1, 0.0]), np.array([0.4, -0.1, 0.3])),
}
LAWS = (ComputedTorque, PDPlus, PDOnlineGravity)
SIGMA_ORDER = [0, 2, 1, 3]  # Pinocchio's depth-first q′ of the RPDR in the paper's order
every_move = pytest.mark.parametrize("name", sorted(MOVES))


@pytest.fixture(scope="module")
def models():
    return {name: ccpin.ReducedModel(ccpin.load(name)) for name in MOVES}


def law_for(model, law_class, reference=None):
    reference = reference or PointToPoint(model, *MOVES[model.mechanism.name], 0.4)
    if law_class is ComputedTorque:
        return ComputedTorque(model, reference, [400.0] * model.n, [40.0] * model.n)
    return law_class(model, reference, [11.0] * model.n, [0.65] * model.n)


def states(model, count=4):
    """(t, q, q̇) near the move's path."""
    rng = np.random.default_rng(8)
    reference = PointToPoint(model, *MOVES[model.mechanism.name], 0.4)
    for t in rng.uniform(0.05, 0.35, count):
        wanted = reference.at(t)
        yield t, wanted.q + 0.05 * rng.normal(size=model.n), wanted.v + rng.normal(size=model.n)


@every_move
def test_the_laws_are_their_formulas(models, name):
    """Each law against D, C and g of the reduced model."""
    model = models[name]
    for t, q, v in states(model):
        terms = model.terms(q, v)
        for law_class in LAWS:
            law = law_for(model, law_class)
            wanted = law.reference.at(t)
            e, e_dot = wanted.q - q, wanted.v - v
            feedback = law.K_p @ e + law.K_v @ e_dot
            expected = {
                ComputedTorque: terms.D @ (wanted.a + feedback) + terms.C @ v + terms.g,
                PDPlus: terms.D @ wanted.a + terms.C @ wanted.v + terms.g + feedback,
                PDOnlineGravity: feedback + terms.g,
            }[law_class]
            np.testing.assert_allclose(
                law.torque(t, Measurement(q), v), expected, rtol=0, atol=1e-10 * np.abs(expected).max()
            )
            np.testing.assert_allclose(law.torque(t, Measurement(q, terms.q_free), v), expected, rtol=1e-9)


@every_move
def test_computed_torque_stays_on_the_reference(models, name):
    """Started on a smooth reference, it is followed to 1e-7 rad at a relative tolerance of 1e-10."""
    model = models[name]
    law = law_for(model, ComputedTorque)
    start = MOVES[name][0]
    motion = ccpin.simulate(model, law, start, duration=0.5, rtol=1e-10, atol=1e-12, sample_period=5e-3)
    assert motion.status == "finished"
    errors = [np.abs(law.error(t, q)).max() for t, q in zip(motion.t, motion.q, strict=True)]
    assert max(errors) <= 1e-7
    np.testing.assert_allclose(motion.q[-1], MOVES[name][1], atol=1e-7)


@every_move
def test_the_error_under_computed_torque_is_linear(models, name):
    """From a displaced start e follows the matrix exponential of ë + K_v ė + K_p e = 0."""
    model = models[name]
    law = law_for(model, ComputedTorque)
    n, rng = model.n, np.random.default_rng(4)
    e0, de0 = 0.1 * rng.normal(size=n), rng.normal(size=n)
    motion = ccpin.simulate(
        model, law, MOVES[name][0] - e0, -de0, duration=0.3, rtol=1e-10, atol=1e-12, sample_period=0.02
    )
    matrix = np.block([[np.zeros((n, n)), np.eye(n)], [-law.K_p, -law.K_v]])
    for t, q, v in zip(motion.t, motion.q, motion.v, strict=True):
        expected = expm(t * matrix) @ np.concatenate([e0, de0])
        found = np.concatenate([law.error(t, q), law.reference.at(t).v - v])
        np.testing.assert_allclose(found, expected, atol=1e-7)


@every_move
def test_lyapunov_rate_of_pd_plus(models, name):
    """d𝒱/dt = −ėᵀK_v ė along the closed loop with a moving reference, by differences along the flow."""
    model = models[name]
    law = law_for(model, PDPlus)
    for t, q, v in states(model):
        a = model.forward_dynamics(q, v, law.torque(t, model.at(q), v))

        def value(s, t=t, q=q, v=v, a=a):
            return law.lyapunov(t + s, q + s * v + 0.5 * s * s * a, v + s * a)

        e_dot = law.reference.at(t).v - v
        assert derivative(value, 1e-4) == pytest.approx(-e_dot @ law.K_v @ e_dot, rel=1e-6)


@pytest.mark.parametrize(("name", "gains", "duration"), [("rpdr", (11.0, 0.65), 1.5), ("delta", (300.0, 25.0), 1.5)])
def test_pd_plus_decays_from_a_displaced_start(models, name, gains, duration):
    """The error dies out along and after the move, and 𝒱 never grows."""
    model = models[name]
    law = PDPlus(model, PointToPoint(model, *MOVES[name], 0.4), [gains[0]] * model.n, [gains[1]] * model.n)
    start = MOVES[name][0] + 0.1
    motion = ccpin.simulate(model, law, start, duration=duration, rtol=1e-8, atol=1e-10, sample_period=0.01)
    samples = list(zip(motion.t, motion.q, motion.v, motion.q_free, strict=True))
    lyapunov = np.array([law.lyapunov(*sample) for sample in samples])
    assert np.diff(lyapunov).max() < 1e-7 * lyapunov[0]
    assert np.abs(law.error(0.0, start)).max() == pytest.approx(0.1)
    assert np.abs(law.error(motion.t[-1], motion.q[-1])).max() < 1e-5


def test_pd_plus_at_a_set_point_is_full_gravity_compensation(models):
    """With q_d constant PD+ and PD with on-line gravity are (30)."""
    model = models["rpdr"]
    full = PDFullGravity(model, GOAL, [11.0, 9.0], K_V)
    for law_class in (PDPlus, PDOnlineGravity):
        law = law_class(model, Hold(model, GOAL), [11.0, 9.0], K_V)
        for t, q, v in states(model):
            state = model.at(q)
            np.testing.assert_allclose(law.torque(t, state, v), full.torque(t, state, v), atol=1e-12)


@pytest.mark.parametrize("law_class", LAWS)
def test_motors_elsewhere_get_the_same_motion(models, law_class):
    """With the motors on dependent joints the acceleration under a law is the same."""
    elsewhere = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"]))
    direct, other = law_for(models["rpdr"], law_class), law_for(elsewhere, law_class)
    for t, q, v in states(models["rpdr"]):
        expected = models["rpdr"].forward_dynamics(q, v, direct.torque(t, models["rpdr"].at(q), v))
        found = elsewhere.forward_dynamics(q, v, other.torque(t, elsewhere.at(q), v))
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("law_class", LAWS)
def test_sigma_errors_enter_where_the_model_does(models, law_class):
    """The law at σ(q) ⊕ δ is its formula with the paper's closed forms at the wrong configuration."""
    model = models["rpdr"]
    law = law_for(model, law_class)
    delta = np.array([0.0, 0.02, 0.0, -0.03])
    wrong_law = WithSigmaError(law, delta)
    for t, q, v in states(model):
        wrong = rpdr.sigma(q, 1.0) + delta[SIGMA_ORDER]
        mass, coriolis, gravity = rpdr.reduced_terms(wrong, v)
        wanted = law.reference.at(t)
        feedback = law.K_p @ (wanted.q - q) + law.K_v @ (wanted.v - v)
        expected = {
            ComputedTorque: mass @ (wanted.a + feedback) + coriolis @ v + gravity,
            PDPlus: mass @ wanted.a + coriolis @ wanted.v + gravity + feedback,
            PDOnlineGravity: feedback + gravity,
        }[law_class]
        np.testing.assert_allclose(wrong_law.torque(t, Measurement(q), v), expected, rtol=1e-9, atol=1e-9)
        right = WithSigmaError(law, np.zeros(4)).torque(t, Measurement(q), v)
        np.testing.assert_allclose(right, law.torque(t, Measurement(q), v), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("law_class", LAWS)
def test_laws_remember_nothing(models, law_class):
    """Called in any order, from any configuration, a law gives the same torques."""
    model = models["delta"]
    law = law_for(model, law_class)
    samples = list(states(model))
    first = [law.torque(t, Measurement(q), v) for t, q, v in samples]
    near = model.sigma(samples[0][1])
    again = [law.torque(t, Measurement(q, near), v) for t, q, v in reversed(samples)][::-1]
    np.testing.assert_allclose(first, again, rtol=1e-9)


def test_brakes_take_energy_out(models):
    """Braking is gravity compensation and damping: the power on top of gravity is negative, and zero at rest."""
    model = models["delta"]
    for law_class in LAWS:
        law = law_for(model, law_class)
        for _, q, v in states(model):
            here = model.at(q)
            extra = law.brake(v, here) - model.gravity(q)
            assert v @ extra < 0
            np.testing.assert_allclose(law.brake(np.zeros(3), here), model.gravity(q), atol=1e-12)


def test_what_cannot_be_tracked_is_refused(models):
    """Too few motors, an independent ball joint, bad gains and bad offsets."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint1"]))
    with pytest.raises(UnsupportedMechanismError, match="motors"):
        PDPlus(model, Hold(model, MOVES["rpdr"][1]), [1.0, 1.0], [1.0, 1.0])
    ball = ball_joint()
    with pytest.raises(UnsupportedMechanismError, match="spherical joint 'shoulder'"):
        ComputedTorque(ball, Hold(ball, [0.0, 0.0, 0.0, 1.0]), [1.0] * 3, [1.0] * 3)
    with pytest.raises(InvalidInputError, match="K_p"):
        ComputedTorque(models["rpdr"], Hold(models["rpdr"], MOVES["rpdr"][1]), [1.0, -1.0], [1.0, 1.0])
    with pytest.raises(InvalidInputError, match="offset"):
        WithSigmaError(law_for(models["rpdr"], PDPlus), [0.1])
    with pytest.raises(InvalidInputError, match="v has shape"):
        law_for(models["rpdr"], PDPlus).torque(0.0, models["rpdr"].at(MOVES["rpdr"][1]), [0.0])
