"""The servo loops of MJCF files, played as a law, are MuJoCo's."""

import numpy as np
import pytest

import ccpin
from ccpin.control import Servos
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from tests.support.forces import FOUR_BAR, arm, by_joint, mujoco_state, read

SERVOS = {
    "position": ('<position joint="j1" kp="30" kv="2" gear="3"/>', [0.4]),
    "velocity": ('<velocity joint="j1" kv="5"/>', [-1.0]),
    "general": ('<general joint="j1" gear="2" gainprm="4" biastype="affine" biasprm="1 -2 -3"/>', [0.7]),
    "bounded": ('<position joint="j1" kp="500" forcerange="-3 3"/>', [1.0]),
    "bounded input": ('<position joint="j1" kp="30" gear="2" ctrlrange="-0.2 0.1"/>', [0.9]),
    "motor beside": ('<motor joint="j2" gear="2" ctrlrange="-1 1"/><position joint="j1" kp="9"/>', [4.0, 0.3]),
}


@pytest.mark.parametrize("name", SERVOS)
def test_accelerations_are_mujocos(name):
    """q̈ under the file's own loops and bounds is MuJoCo's under the same ctrl, to 1e-8."""
    actuator, ctrl = SERVOS[name]
    text = arm(actuator)
    mechanism = ccpin.load(read(text))
    model, rng = ccpin.ReducedModel(mechanism), np.random.default_rng(2)
    q = model.coordinates.integrate(model.alpha(mechanism.q_reference), 0.4 * rng.normal(size=model.n))
    state, v = model.at(q), rng.normal(size=model.n)
    u = Servos(model, ctrl).torque(0.0, model.at(q), v)
    simulated, data = mujoco_state(text, mechanism, state.q_free, state.v_free(v), ctrl)
    ours = state.a_free(v, state.forward_dynamics(v, u))
    theirs = by_joint(mechanism, simulated, data.qacc_smooth)
    chain = [i for joint in ("j1", "j2", "j3") for i in range(*mechanism.tree.joint(joint).v.indices(99))]
    np.testing.assert_allclose(ours[chain], theirs[chain], rtol=1e-8, atol=1e-8)


def test_a_closed_chain_follows_its_position_servo():
    """The four-bar's crank goes where its servo is told, but for the load over the servo's stiffness."""
    servo = '<position joint="a" kp="400" kv="20"/>'
    text = FOUR_BAR.replace('<motor name="m" joint="a" gear="20" ctrlrange="-2 3"/>', servo)
    model = ccpin.ReducedModel(ccpin.load(read(text)))
    q = model.alpha(model.mechanism.q_reference)
    run = ccpin.simulate(model, Servos(model, lambda t: q + 0.3), q, duration=3.0, sample_period=0.1)
    load = model.gravity(run.q[-1], run.q_free[-1])
    np.testing.assert_allclose(run.q[-1], q + 0.3 - load / 400, atol=1e-5)


def test_what_is_no_such_loop_is_refused():
    """Loops with a state, and inputs of the wrong size."""
    model = ccpin.ReducedModel(ccpin.load(read(arm('<intvelocity joint="j1" kp="5" actrange="-1 1"/>'))))
    with pytest.raises(UnsupportedMechanismError, match="intvelocity"):
        Servos(model, [0.0])
    with pytest.raises(InvalidInputError, match="inputs has shape"):
        Servos(ccpin.load("rpdr"), [0.0])
