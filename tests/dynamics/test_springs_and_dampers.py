"""Springs, dampers, rotor inertias and gears: the reduced dynamics against MuJoCo's and against what energy says."""

import numpy as np
import pytest

import ccpin
from ccpin.errors import UnsupportedMechanismError
from ccpin.native import kernel
from ccpin.native.specification import specification
from tests.oracles import descriptor
from tests.oracles.finite_differences import derivative
from tests.support.forces import FOUR_BAR, arm, by_joint, mujoco_state, read


def mujoco_acceleration(text, u, seed=0):
    """q̈′ of ccpin and of MuJoCo without its soft constraints, at a random closed state."""
    mechanism = ccpin.load(read(text))
    model = ccpin.ReducedModel(mechanism)
    rng = np.random.default_rng(seed)
    q = model.coordinates.integrate(model.alpha(mechanism.q_reference), 0.4 * rng.normal(size=model.n))
    state, v = model.at(q), rng.normal(size=model.n)
    a_free = state.a_free(v, state.forward_dynamics(v, u))
    simulated, data = mujoco_state(text, mechanism, state.q_free, state.v_free(v), u)
    return mechanism, a_free, by_joint(mechanism, simulated, data.qacc_smooth)


OPEN = {
    "nothing": arm(),
    "damping": arm(j1='damping="0.7"', j2='damping="3"', j3='damping="0.2"'),
    "springs": arm(j1='stiffness="5" springref="0.3"', j2='stiffness="40" springref="-0.1" ref="0.05"'),
    "a ball's spring": arm(j3='stiffness="2.5"'),
    "rotors": arm(j1='armature="0.4"', j2='armature="2"', j3='armature="0.05"'),
    "a motor": arm('<motor joint="j1" ctrlrange="-9 9"/>'),
    "gears": arm('<motor joint="j1" gear="50"/><motor joint="j2" gear="-3"/>'),
    "gains": arm('<general joint="j2" gear="7" gainprm="11"/><motor joint="j1" gear="2"/>'),
    "defaults": arm('<motor joint="j1"/>').replace("<worldbody>", '<default><position gear="6"/></default><worldbody>'),
    "a motor's own rotor": arm('<motor joint="j1" gear="4" armature="0.03" damping="0.2"/>'),
    "all": arm(
        '<motor joint="j2" gear="8"/><motor joint="j1" gear="0.1"/>',
        j1='damping="0.4" stiffness="3" springref="1" armature="0.1" frictionloss="0"',
        j2='damping="2" stiffness="30"',
        j3='damping="0.1" stiffness="1.5" armature="0.02"',
    ),
}


@pytest.mark.parametrize("name", OPEN)
def test_accelerations_are_mujocos_on_an_open_chain(name):
    """q̈ of an arm with springs, dampers, rotors and geared motors is MuJoCo's, to 1e-8."""
    motors = read(OPEN[name]).motors
    u = np.array([1.3, -0.4])[: len(motors)] if motors else np.zeros(ccpin.load(read(OPEN[name])).n)
    if not motors:
        mechanism = ccpin.load(read(OPEN[name]))
        model = ccpin.ReducedModel(mechanism)
        state, v = model.at(model.alpha(mechanism.q_reference)), np.linspace(0.5, 1, model.n)
        simulated, data = mujoco_state(OPEN[name], mechanism, state.q_free, state.v_free(v))
        ours = state.a_free(v, state.forward_dynamics(v, u))
        theirs = by_joint(mechanism, simulated, data.qacc_smooth)
    else:
        mechanism, ours, theirs = mujoco_acceleration(OPEN[name], u)
    chain = [i for name in ("j1", "j2", "j3") for i in range(*mechanism.tree.joint(name).v.indices(99))]
    np.testing.assert_allclose(ours[chain], theirs[chain], rtol=1e-8, atol=1e-8)


def test_a_free_body_with_damping_is_mujocos():
    """q̈ of a damped body without joints: MuJoCo's, whose linear velocities are in world axes; its armature is noted."""
    free = (
        '<body name="f"><joint name="f" type="free" {}/><geom type="box" size="0.05 0.1 0.2" pos="0 0.1 0.2"/></body>'
    )
    text = arm().replace("</worldbody>", free.format('damping="0.7"') + "</worldbody>")
    mechanism = ccpin.load(read(text))
    model, rng = ccpin.ReducedModel(mechanism), np.random.default_rng(5)
    q = model.coordinates.integrate(model.alpha(mechanism.q_reference), 0.7 * rng.normal(size=model.n))
    state, v = model.at(q), rng.normal(size=model.n)
    simulated, data = mujoco_state(text, mechanism, state.q_free, state.v_free(v))
    joint = mechanism.tree.joint("f")
    linear, omega = state.v_free(v)[joint.v][:3], state.v_free(v)[joint.v][3:]
    ours = state.a_free(v, state.forward_dynamics(v, np.zeros(model.n_actuated)))[joint.v]
    ours[:3] = joint.kind.rotation(state.q_free[joint.q]) @ (ours[:3] + np.cross(omega, linear))
    theirs = by_joint(mechanism, simulated, data.qacc_smooth)[joint.v]
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    heavy = read(text.replace('damping="0.7"', 'armature="0.3"'))
    assert "armature of joint 'f', which moves freely" in " ".join(heavy.notes)


def test_accelerations_on_a_closed_chain():
    """On a four-bar q̈′ solves the descriptor form (19) with MuJoCo's own passive and actuator forces as its load."""
    mechanism = ccpin.load(read(FOUR_BAR))
    model = ccpin.ReducedModel(mechanism)
    q, v, u = model.alpha(mechanism.q_reference) + 0.3, np.array([1.7]), np.array([0.4])
    state = model.at(q)
    simulated, data = mujoco_state(FOUR_BAR, mechanism, state.q_free, state.v_free(v), u)
    load = by_joint(mechanism, simulated, data.qfrc_passive + data.qfrc_actuator)
    expected = descriptor.direct(mechanism.description, mechanism.pin_model, state.q_free, state.v_free(v), load)
    ours = state.a_free(v, state.forward_dynamics(v, u))
    np.testing.assert_allclose(ours, expected.a_free, rtol=1e-8, atol=1e-8)
    force = mechanism.constraints().value(state.q_free).jacobian.T @ state.constraint_forces(v, u)
    np.testing.assert_allclose(force, expected.force, rtol=1e-8, atol=1e-8)


def test_a_gear_scales_what_u_does():
    """q̈ of gear 50 under u is that of gear 1 under 50 u; inverse dynamics gives u back."""
    plain = FOUR_BAR.replace('gear="20"', "")
    one, geared = (ccpin.ReducedModel(ccpin.load(read(text))) for text in (plain, FOUR_BAR))
    q, v = one.alpha(one.mechanism.q_reference) + 0.2, np.array([0.7])
    expected = one.forward_dynamics(q, v, [20 * 0.3])
    np.testing.assert_allclose(geared.forward_dynamics(q, v, [0.3]), expected, rtol=1e-12)
    np.testing.assert_allclose(geared.inverse_dynamics(q, v, expected), [0.3], rtol=1e-9)
    np.testing.assert_array_equal(geared.mechanism.motors.limits, [[-2, 3]])
    np.testing.assert_array_equal(geared.mechanism.motors.gears, [20])


@pytest.fixture(scope="module")
def model():
    return ccpin.ReducedModel(ccpin.load(read(FOUR_BAR)))


def test_g_is_the_gradient_of_the_potential(model):
    """g = ∂V/∂q and ∂g/∂q its derivative, springs included."""
    q = model.alpha(model.mechanism.q_reference) + 0.3
    slope = derivative(lambda s: model.energy(q + s, [0.0]).potential)
    np.testing.assert_allclose(model.gravity(q), slope, rtol=1e-9)
    np.testing.assert_allclose(model.gravity_derivative(q)[0], derivative(lambda s: model.gravity(q + s)), rtol=1e-8)
    state = model.at(q)
    weight = state.rho.T @ model.free_system.weight(state.q_free)
    assert abs(weight - state.g).max() > 0.1


def test_a_balls_spring_is_conservative():
    """The moment k log R of a ball joint's spring is the gradient of ½k|log R|² along right increments."""
    mechanism = ccpin.load(read(arm(j3='stiffness="2.5"')), independent=["j1", "j2", "j3", "k1"])
    model = ccpin.ReducedModel(mechanism)
    rng = np.random.default_rng(3)
    q = model.coordinates.integrate(model.alpha(mechanism.q_reference), 0.8 * rng.normal(size=model.n))

    def moved(k, s):
        return model.coordinates.integrate(q, s * np.eye(model.n)[k])

    slope = [derivative(lambda s, k=k: model.energy(moved(k, s), np.zeros(model.n)).potential) for k in range(model.n)]
    np.testing.assert_allclose(model.gravity(q), slope, rtol=1e-8, atol=1e-9)
    columns = [derivative(lambda s, k=k: model.gravity(moved(k, s))) for k in range(model.n)]
    np.testing.assert_allclose(model.gravity_derivative(q), np.transpose(columns), rtol=1e-7, atol=1e-8)


def test_damping_takes_the_power_it_should(model):
    """d/dt (T + V) = −q̇ᵀ(ρᵀBρ)q̇ along free motion, and D q̈ + C q̇ + ρᵀBρ q̇ + g = ρᵀSᵀu."""
    q, v, u = model.alpha(model.mechanism.q_reference) + 0.3, np.array([1.7]), np.array([0.2])
    state = model.at(q)
    damping = state.rho.T @ np.diag([0.3, 0.05, 0.2]) @ state.rho
    np.testing.assert_allclose(state.damping, damping, rtol=1e-12)
    a = state.forward_dynamics(v, u)
    left = state.D @ a + state.C(v) @ v + state.damping @ v + state.g
    np.testing.assert_allclose(left, state.generalized_force(u), rtol=1e-10)
    np.testing.assert_allclose(state.tau(v, a), left, rtol=1e-10)
    run = ccpin.simulate(model, None, q, v, duration=0.5, rtol=1e-10, atol=1e-12, sample_period=1e-3)
    energy = [sum(model.energy(*row)) for row in zip(run.q, run.v, run.q_free, strict=True)]
    power = [v @ model.at(q, near).damping @ v for q, v, near in zip(run.q, run.v, run.q_free, strict=True)]
    lost = np.trapezoid(power, run.t)
    np.testing.assert_allclose(energy[0] - energy[-1], lost, rtol=1e-5)


def test_a_mechanism_without_dampers_has_no_damping(rpdr_model):
    """ρᵀBρ is the zero matrix where nothing damps."""
    state = rpdr_model.at(rpdr_model.alpha(rpdr_model.mechanism.q_reference))
    assert state.damping.shape == (rpdr_model.n, rpdr_model.n)
    assert not state.damping.any()


def test_derivatives_are_exact(model):
    """∂q̈ and ∂u with springs, dampers and gears against sixth-order differences."""
    q, v, u = model.alpha(model.mechanism.q_reference) + 0.3, np.array([1.7]), np.array([0.2])
    a = np.array([0.8])
    for last, function, found in (
        (u, model.forward_dynamics, model.forward_dynamics_derivatives(q, v, u)),
        (a, model.inverse_dynamics, model.inverse_dynamics_derivatives(q, v, a)),
    ):
        expected = (
            derivative(lambda s: function(q + s, v, last)),  # noqa: B023 - called at once
            derivative(lambda s: function(q, v + s, last)),  # noqa: B023
            derivative(lambda s: function(q, v, last + s)),  # noqa: B023
        )
        for ours, theirs in zip(found, expected, strict=True):
            np.testing.assert_allclose(ours[:, 0], theirs, rtol=1e-8)


def test_the_core_declines_a_balls_spring():
    """What the compiled core was not written for is the reference's to compute, not left out."""
    mechanism = ccpin.load(read(arm(j3='stiffness="2.5"')))
    assert kernel(mechanism) is None
    with pytest.raises(UnsupportedMechanismError, match="the spring of 'j3', a ball joint"):
        specification(mechanism)
