"""Wrenches on links: against MuJoCo's applied forces, the descriptor form, virtual power, and differences."""

import mujoco
import numpy as np
import pinocchio as pin
import pytest

import ccpin
from ccpin.dynamics import Wrench, linearize
from ccpin.errors import InvalidInputError
from tests.oracles import descriptor
from tests.oracles.finite_differences import derivative
from tests.support.forces import FOUR_BAR, arm, by_joint, mujoco_state, read

TWO = {"coupler": [3.0, -1.0, 7.0, 0.2, 0.9, -0.4], "rocker": Wrench([0.5, 2.0, -4.0], point=[0.1, -0.2, 0.3])}


@pytest.fixture(scope="module")
def model():
    return ccpin.ReducedModel(ccpin.load(read(FOUR_BAR)))


@pytest.fixture(scope="module")
def spatial():
    """An arm with a slide and a ball joint, on coordinates that are no plain numbers."""
    loaded = ccpin.load(read(arm(j3='stiffness="1"')), independent=["j1", "j2", "j3", "k1"])
    return ccpin.ReducedModel(loaded)


@pytest.fixture(scope="module")
def base():
    """The installed four-bar on a floating base."""
    return ccpin.ReducedModel(ccpin.load("four_bar", floating_base=True))


def somewhere(model, seed=1):
    rng = np.random.default_rng(seed)
    q = model.coordinates.integrate(model.alpha(model.mechanism.q_reference), 0.3 * rng.normal(size=model.n))
    return q, rng.normal(size=model.n), rng.normal(size=model.n_actuated)


def test_against_mujoco_on_an_open_chain():
    """Jᵀw is MuJoCo's mj_applyFT, and q̈ what its xfrc_applied gives, at a point of each link."""
    text = arm(j1='damping="1"')
    mechanism = ccpin.load(read(text))
    model = ccpin.ReducedModel(mechanism)
    q, v, _ = somewhere(model)
    u = np.zeros(model.n_actuated)
    state = model.at(q)
    wrenches = {"c": Wrench([1.0, 2.0, -3.0], [0.4, 0.5, 0.6], [0.1, 0.2, -0.3]), "a": [0.0, 4.0, 1.0, 0.1, 0.0, 0.2]}
    simulated, data = mujoco_state(text, mechanism, state.q_free, state.v_free(v))
    applied = np.zeros(simulated.nv)
    for link, wrench in (("c", wrenches["c"]), ("a", Wrench([0, 4, 1], [0.1, 0, 0.2]))):
        body = data.body(link)
        point = body.xpos + body.xmat.reshape(3, 3) @ np.array(wrench.point, dtype=float)
        force, moment = np.array(wrench.force, dtype=float), np.array(wrench.moment, dtype=float)
        mujoco.mj_applyFT(simulated, data, force, moment, point, body.id, applied)
    np.testing.assert_allclose(state.joint_loads(wrenches), by_joint(mechanism, simulated, applied), atol=1e-12)
    data.qfrc_applied[:] = applied
    mujoco.mj_forward(simulated, data)
    a_free = state.a_free(v, state.forward_dynamics(v, u, wrenches))
    chain = [i for name in ("j1", "j2", "j3") for i in range(*mechanism.tree.joint(name).v.indices(99))]
    theirs = by_joint(mechanism, simulated, data.qacc_smooth)
    np.testing.assert_allclose(a_free[chain], theirs[chain], rtol=1e-8, atol=1e-8)


def test_against_the_descriptor_form(model):
    """q̈′ and φ_q′ᵀλ solve (19) with Jᵀw among the loads."""
    q, v, u = somewhere(model)
    state, mechanism = model.at(q), model.mechanism
    passive = np.array([0.3, 0.05, 0.2]) * state.v_free(v) + model.free_system.springs.force(state.q_free)
    load = state.joint_efforts(u) + state.joint_loads(TWO) - passive
    expected = descriptor.direct(mechanism.description, mechanism.pin_model, state.q_free, state.v_free(v), load)
    a = state.forward_dynamics(v, u, TWO)
    np.testing.assert_allclose(state.a_free(v, a), expected.a_free, rtol=1e-9, atol=1e-9)
    force = mechanism.constraints().value(state.q_free).jacobian.T @ state.constraint_forces(v, u, TWO)
    np.testing.assert_allclose(force, expected.force, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(state.inverse_dynamics(v, a, TWO), u, rtol=1e-9)
    np.testing.assert_allclose(state.tau(v, a, TWO), state.generalized_force(u), rtol=1e-9)


@pytest.mark.parametrize("name", ["model", "spatial", "base"])
def test_power_of_a_wrench(name, request):
    """q̇ᵀρᵀJᵀw = F·v_P + M·ω, link by link."""
    model = request.getfixturevalue(name)
    q, v, _ = somewhere(model)
    state, tree = model.at(q), model.mechanism.tree
    data = model.free_system.model.createData()
    pin.forwardKinematics(model.free_system.model, data, state.q_free, state.v_free(v))
    for link, at in tree.attachments.items():
        wrench = Wrench([1.0, -2.0, 0.5], [0.3, 0.1, -0.7], [0.2, 0.3, -0.1])
        power = v @ state.rho.T @ state.joint_loads({link: wrench})
        pose = data.oMi[at.joint] * pin.SE3(np.array(at.placement))
        twist = pin.getVelocity(model.free_system.model, data, at.joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
        arm = pose.act(np.array(wrench.point)) - data.oMi[at.joint].translation
        speed = twist.linear + np.cross(twist.angular, arm)
        expected = wrench.force @ speed + wrench.moment @ twist.angular
        np.testing.assert_allclose(power, expected, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("name", ["model", "spatial", "base"])
def test_derivatives_with_wrenches_are_exact(name, request):
    """∂q̈ and ∂τ with wrenches that stay constant in world axes, against sixth-order differences."""
    model = request.getfixturevalue(name)
    q, v, u = somewhere(model)
    links = list(model.mechanism.tree.attachments)
    wrenches = {
        links[-1]: Wrench([1.0, -2.0, 0.5], [0.3, 0.1, -0.7], [0.2, 0.3, -0.1]),
        links[-2]: [3.0, -1.0, 7.0, 0.2, 0.9, -0.4],
    }
    near = model.at(q).q_free
    u = u if model.n_actuated else np.zeros(0)

    def along(function):
        return np.transpose(
            [
                derivative(lambda s, k=k: function(model.coordinates.integrate(q, s * np.eye(model.n)[k])))
                for k in range(model.n)
            ]
        )

    found = model.forward_dynamics_derivatives(q, v, u, wrenches=wrenches)
    expected = along(lambda at: model.forward_dynamics(at, v, u, near, wrenches))
    np.testing.assert_allclose(found.da_dq, expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
    a = np.linspace(-1, 1, model.n)
    found = model.generalized_force_derivatives(q, v, a, wrenches=wrenches)
    expected = along(lambda at: model.at(at, near).tau(v, a, wrenches))
    np.testing.assert_allclose(found.dtau_dq, expected, rtol=1e-7, atol=1e-7 * np.abs(expected).max())
    linear = linearize(model, q, u, v, wrenches=wrenches)
    slopes = model.forward_dynamics_derivatives(q, v, u, wrenches=wrenches)
    np.testing.assert_array_equal(linear.A[model.n :, : model.n], slopes.da_dq)


@pytest.mark.parametrize(
    ("wrenches", "word"),
    [
        ({"copler": np.zeros(6)}, "did you mean 'coupler'"),
        ({"coupler": np.zeros(3)}, "the wrench on 'coupler' has shape"),
        ({"coupler": Wrench([1.0, np.nan, 0.0])}, "force of the wrench on 'coupler'"),
        (np.zeros(6), "mapping of link names"),
    ],
)
def test_what_is_no_wrench_is_refused(model, wrenches, word):
    """Errors name the link and say what would be right."""
    q, v, u = somewhere(model)
    with pytest.raises(InvalidInputError, match=word):
        model.forward_dynamics(q, v, u, wrenches=wrenches)


def test_a_wrench_on_what_the_world_carries_moves_nothing(model):
    """The world's own links do not move."""
    q, v, u = somewhere(model)
    pushed = model.forward_dynamics(q, v, u, wrenches={"world": [1, 2, 3, 4, 5, 6]})
    np.testing.assert_allclose(pushed, model.forward_dynamics(q, v, u), rtol=1e-12)
