"""Springs, dampers, rotor inertias and gears: the reduced dynamics against MuJoCo's and against what energy says."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import ccpin
from ccpin.description.mjcf.reader import read_mjcf
from ccpin.errors import UnsupportedMechanismError
from ccpin.native import kernel
from ccpin.native.specification import specification
from tests.oracles import descriptor
from tests.oracles.finite_differences import derivative

ARM = """
<mujoco><compiler angle="radian"/><worldbody>
  <body name="a"><joint name="j1" axis="0 1 0" {j1}/><geom type="capsule" fromto="0 0 0 0.4 0 0.1" size="0.03"/>
    <body name="b" pos="0.4 0 0.1"><joint name="j2" type="slide" axis="1 0 1" {j2}/><geom size="0.06" pos="0.1 0.05 0"/>
      <body name="c" pos="0.2 0 0"><joint name="j3" type="ball" {j3}/>
        <geom type="box" size="0.05 0.1 0.2" pos="0 0.1 0.2"/>
      </body></body></body>
  <body name="p" pos="0 1 0"><joint name="k1" axis="1 0 0"/><geom size="0.1" pos="0 0 0.2"/></body>
  <body name="s" pos="0 2 0"><joint name="k2" axis="1 0 0"/><geom size="0.1" pos="0 0 0.2"/></body>
</worldbody><equality><joint joint1="k1" joint2="k2"/></equality>
<actuator>{actuator}</actuator></mujoco>
"""
"""An open arm beside a coupled pair, which makes it a mechanism with a loop."""

FOUR_BAR = """
<mujoco><compiler angle="radian"/><option gravity="1 0.5 -9"/><worldbody>
  <body name="crank"><joint name="a" axis="0 1 0" damping="0.3" armature="0.02"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.02"/>
    <body name="coupler" pos="0 0 0.3"><joint name="b" axis="0 1 0" stiffness="6" springref="0.4" damping="0.05"/>
      <geom type="capsule" fromto="0 0 0 0.7 0 0.1" size="0.02"/></body></body>
  <body name="rocker" pos="0.7 0 0"><joint name="c" axis="0 1 0" damping="0.2" stiffness="3"/>
    <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.02"/></body>
</worldbody><equality><connect body1="coupler" body2="rocker" anchor="0.7 0 0.1"/></equality>
<actuator><motor name="m" joint="a" gear="20" ctrlrange="-2 3"/></actuator></mujoco>
"""


def read(text):
    return read_mjcf(text.encode(), None)


def arm(actuator="", **joints):
    """The arm's text; joints' attributes as keywords."""
    return ARM.format(**{"j1": "", "j2": "", "j3": "", **joints}, actuator=actuator)


def mujoco_state(text, mechanism, q_free, v_free, ctrl=()):
    """MuJoCo's model and data at ccpin's q′ (quaternions turned round) and q̇′, joint by joint of the same name."""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    for joint in mechanism.tree.joints:
        q, v = model.joint(joint.name).qposadr[0], model.joint(joint.name).dofadr[0]
        value = q_free[joint.q]
        data.qpos[q : q + joint.kind.nq] = np.roll(value, 1) if joint.kind.nq == 4 else value
        data.qvel[v : v + joint.kind.nv] = v_free[joint.v]
    data.ctrl[:] = ctrl
    mujoco.mj_forward(model, data)
    return model, data


def by_joint(mechanism, model, values):
    """MuJoCo's array over its dofs in the order of q̇′."""
    out = np.zeros(mechanism.n_free)
    for joint in mechanism.tree.joints:
        start = model.joint(joint.name).dofadr[0]
        out[joint.v] = values[start : start + joint.kind.nv]
    return out


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
    found = model.forward_dynamics_derivatives(q, v, u)
    expected = (
        derivative(lambda s: model.forward_dynamics(q + s, v, u)),
        derivative(lambda s: model.forward_dynamics(q, v + s, u)),
        derivative(lambda s: model.forward_dynamics(q, v, u + s)),
    )
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours[:, 0], theirs, rtol=1e-8)
    a = np.array([0.8])
    found = model.inverse_dynamics_derivatives(q, v, a)
    expected = (
        derivative(lambda s: model.inverse_dynamics(q + s, v, a)),
        derivative(lambda s: model.inverse_dynamics(q, v + s, a)),
        derivative(lambda s: model.inverse_dynamics(q, v, a + s)),
    )
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_allclose(ours[:, 0], theirs, rtol=1e-8)


@pytest.mark.parametrize("field", ["stiffness", "damping"])
def test_the_core_declines_what_it_does_not_know(rpdr, field):
    """Springs, dampers and gears make the compiled core decline rather than leave them out."""
    joints = tuple(
        replace(joint, **{field: 0.1}) if joint.kind == "revolute" else joint for joint in rpdr.description.joints
    )
    changed = ccpin.load(replace(rpdr.description, joints=joints))
    assert kernel(changed) is None
    with pytest.raises(UnsupportedMechanismError, match="springs" if field == "stiffness" else "dampers"):
        specification(changed)


def test_the_core_declines_gears():
    """A geared motor's mechanism is the reference's to compute."""
    assert kernel(ccpin.load(read(FOUR_BAR))) is None
