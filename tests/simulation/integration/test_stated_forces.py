"""Runs with what files state: dampers, springs, friction, geared motors and wrenches on links."""

import numpy as np
import pytest
from scipy.integrate import simpson

import ccpin
from ccpin.control import ComputedTorque, PDFullGravity, PDPlus, PDSimpleGravity, PointToPoint, Sampling
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.dynamics import Wrench
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import body_motion
from ccpin.simulation import closure_forces, joint_forces
from ccpin.simulation.plant.friction import joint_friction
from ccpin.simulation.results.forces import closure_forces_at
from tests.support.backends import same_on_both
from tests.support.long_cases import later

STATED = {"crank": {"damping": 0.002}, "rocker": {"stiffness": 0.8, "spring_reference": 0.5}}


def model_of(**joints):
    return ccpin.ReducedModel(ccpin.load("four_bar", joints=joints))


def start(model):
    return model.alpha(model.mechanism.q_reference) + 0.4


def test_energy_is_kept_by_springs():
    """With springs and without dampers T + V is constant along free motion, springs' energy included."""
    model = model_of(rocker=STATED["rocker"])
    run = ccpin.simulate(model, None, start(model), duration=0.4, rtol=1e-10, atol=1e-12, sample_period=0.02)
    energy = [sum(model.energy(*row)) for row in zip(run.q, run.v, run.q_free, strict=True)]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)
    plain = model_of()
    without = [sum(plain.energy(*row)) for row in zip(run.q, run.v, run.q_free, strict=True)]
    assert np.ptp(without) > 1e-3


@pytest.mark.parametrize("law", [PDSimpleGravity, pytest.param(PDFullGravity, marks=pytest.mark.slow)])
def test_set_point_laws_hold_springs(law):
    """PD with gravity compensation reaches its goal exactly with springs and a gear: g is the whole potential's."""
    model = ccpin.ReducedModel(ccpin.load("four_bar", joints=STATED, motors={"crank": {"gear": -20}}))
    goal = start(model) + 0.2
    run = ccpin.simulate(model, law(model, goal, [4.0], [0.4]), start(model), duration=3.0, sample_period=0.1)
    np.testing.assert_allclose(run.q[-1], goal, atol=1e-6)
    held = model.at(run.q[-1], run.q_free[-1]).generalized_force(run.u[-1])
    np.testing.assert_allclose(held, model.gravity(run.q[-1], run.q_free[-1]), atol=1e-5)


def test_friction_of_the_file_is_the_default():
    """Stated Coulomb levels rub in every run unless others, or none, are given."""
    model, bare = model_of(crank={"friction": 5.0}), model_of()
    held = ccpin.simulate(model, None, start(model), duration=0.2, sample_period=0.05)
    np.testing.assert_array_equal(held.q[-1], held.q[0])
    free = ccpin.simulate(model, None, start(model), duration=0.2, sample_period=0.05, friction={})
    expected = ccpin.simulate(bare, None, start(model), duration=0.2, sample_period=0.05)
    np.testing.assert_allclose(free.q[-1], expected.q[-1], rtol=1e-7)
    given = joint_friction(model)
    assert (given.names, given.coulomb.tolist(), given.viscous.tolist()) == (("crank",), [5.0], [0.0])


@same_on_both
def test_a_constant_wrench_is_a_potential():
    """Under a constant force on a link T + V − F·x is constant, as is the power of a function of time."""
    model, force = model_of(), np.array([0.6, 0.0, -0.2])
    frame = model.mechanism.tree.attachments["coupler"]
    options = {"duration": 0.3, "rtol": 1e-10, "atol": 1e-12, "sample_period": 0.01, "max_step": 5e-4}
    run = ccpin.simulate(model, None, start(model), wrenches={"coupler": [*force, 0, 0, 0]}, **options)

    def total(q, v, q_free):
        from ccpin.kinematics.points import joint_poses

        x = (joint_poses(model.free_system.scratch, q_free)[frame.joint] @ frame.placement)[:3, 3]
        return sum(model.energy(q, v, q_free)) - force @ x

    energy = [total(*row) for row in zip(run.q, run.v, run.q_free, strict=True)]
    np.testing.assert_allclose(energy, energy[0], atol=1e-9)
    told = ccpin.simulate(model, None, start(model), wrenches=lambda *_: {"coupler": [*force, 0, 0, 0]}, **options)
    np.testing.assert_allclose(told.q, run.q, rtol=0, atol=1e-12)


def test_friction_holds_against_a_wrench():
    """A joint at rest takes a wrench's load up to its level, and moves beyond it."""
    model = model_of(crank={"friction": 1.0})
    rest = ccpin.simulate(model, None, start(model), duration=0.1, wrenches={"coupler": [2.0, 0, 0, 0, 0, 0]})
    np.testing.assert_array_equal(rest.q[-1], rest.q[0])
    moves = ccpin.simulate(model, None, start(model), duration=0.1, wrenches={"coupler": [200.0, 0, 0, 0, 0, 0]})
    assert abs(moves.q[-1] - moves.q[0]).max() > 0.01


@pytest.mark.parametrize("sampling", [None, Sampling(0.01, saturation=2.0)])
def test_a_law_with_u_of_the_wrong_size_is_told(sampling):
    """The error says the law's shape, the right one and the motors; one number will do for one motor."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    q = model.alpha(model.mechanism.q_reference)
    with pytest.raises(
        InvalidInputError, match=r"the law returned u of shape \(3,\); it must be \(2,\).*joint1, joint2"
    ):
        ccpin.simulate(model, lambda t, q, v: [1, 2, 3], q, duration=0.1, sampling=sampling)
    one = model_of()
    run = ccpin.simulate(one, lambda t, q, v: 0.1, start(one), duration=0.01, sampling=sampling)
    assert run.u.shape[1] == 1


@same_on_both
@pytest.mark.parametrize("sample_period", later(1e-4, 2e-5))
def test_theorem_3_holds_with_springs_and_gears(sample_period):
    """A rigorous level for g = ∂V/∂q of gravity and springs; from within 𝒱 falls at the rate −q̇ᵀ(K_v + damping)q̇."""
    model = ccpin.ReducedModel(ccpin.load("four_bar", joints=STATED, motors={"crank": {"gear": -20}}))
    goal = start(model)
    certificate = certify_law(PDSimpleGravity(model, goal, [4.0], [0.4]))
    assert certificate.rigorous
    assert certificate.beta >= abs(model.gravity_derivative(goal)[0, 0])
    law = certificate.law
    run = ccpin.simulate(model, law, goal + 0.3, duration=0.02, sample_period=sample_period, rtol=1e-10, atol=1e-12)
    value = [law.lyapunov(*row) for row in zip(run.q, run.v, run.q_free, strict=True)]
    assert value[0] < certificate.level
    rate = [v @ (law.K_v + model.at(q, near).damping) @ v for q, v, near in zip(run.q, run.v, run.q_free, strict=True)]
    np.testing.assert_allclose(value[0] - value[-1], simpson(rate, x=run.t), rtol=1e-6)


def test_joints_carry_motor_spring_and_damper():
    """Along its axis a joint passes gear·u − k(θ − θ₀) − b θ̇, less what accelerates its rotor."""
    model = ccpin.ReducedModel(ccpin.load("four_bar", joints=STATED, motors={"crank": {"gear": -20}}))
    run = ccpin.simulate(model, lambda t, q, v: [0.02], start(model), duration=0.1, sample_period=0.02)
    motion = {joint.name: joint for joint in joint_forces(model, run)}
    for row, (state, v, u) in enumerate(run.states(model)):
        a_free = state.a_free(v, state.forward_dynamics(v, u))
        joints, v_free = model.mechanism.joints, state.v_free(v)
        expected = (
            state.joint_efforts(u)
            - joints.stiffness * (state.q_free - joints.spring_reference)
            - joints.damping * v_free
            - joints.armature * a_free
        )
        for k, name in enumerate(joints.names):
            along = motion[name].moment[row] @ motion[name].axis[row]
            np.testing.assert_allclose(along, expected[k], atol=1e-9)


@pytest.mark.parametrize("gear", [1.0, 5.0])
def test_tracking_laws_leave_their_error_equations(gear):
    """Computed torque leaves ë + K_v ė + K_p e = 0, PD+ D ë + C ė + (K_v + damping) ė + K_p e = 0, springs or not."""
    model = ccpin.ReducedModel(ccpin.load("four_bar", joints=STATED, motors={"crank": {"gear": gear}}))
    q0 = start(model)
    reference = PointToPoint(model, q0, q0 + 0.5, 0.4)
    state, v = model.at(q0 + 0.1), np.array([0.8])
    wanted = reference.at(0.15)
    e, e_dot = wanted.q - state.q, wanted.v - v
    for law in (ComputedTorque(model, reference, [30.0], [9.0]), PDPlus(model, reference, [3.0], [0.7])):
        a = state.forward_dynamics(v, law.torque(0.15, state, v))
        e_ddot = wanted.a - a
        if isinstance(law, ComputedTorque):
            left = e_ddot + law.K_v @ e_dot + law.K_p @ e
        else:
            left = state.D @ e_ddot + (state.C(v) + law.K_v + state.damping) @ e_dot + law.K_p @ e
        np.testing.assert_allclose(left, 0.0, atol=1e-9)


def test_bearings_carry_a_wrench():
    """Under a wrench on a link the world's joints and closures carry the momentum's change, the weight and the wrench.

    The free directions' moments are motors', springs' and dampers' as before.
    """
    model = ccpin.ReducedModel(ccpin.load("four_bar", joints=STATED))
    push = {"coupler": Wrench([3.0, 0.5, -2.0], [0.1, 0.2, 0.3], [0.05, 0.01, 0.0])}
    run = ccpin.simulate(model, None, start(model), duration=0.05, sample_period=0.01, wrenches=push)
    bearings = {joint.name: joint for joint in joint_forces(model, run, push)}
    still = {joint.name: joint for joint in joint_forces(model, run)}
    assert abs(bearings["crank"].force - still["crank"].force).max() > 0.1
    total = bearings["crank"].force + bearings["rocker"].force
    masses = model.mechanism.tree.model.inertias
    weight = sum(body.mass for body in masses) * model.gravity_vector
    for row, (state, v, u) in enumerate(run.states(model)):
        a_free = state.a_free(v, state.forward_dynamics(v, u, push))
        motion = body_motion(model.free_system.scratch, state.q_free, state.v_free(v), a_free)
        change = sum(body.mass * motion.accelerations[k] for k, body in enumerate(masses) if k)
        np.testing.assert_allclose(total[row] + weight + push["coupler"].force, change, atol=1e-9)
        joints = model.mechanism.joints
        passive = joints.stiffness * (state.q_free - joints.spring_reference) + joints.damping * state.v_free(v)
        for k, name in enumerate(joints.names):
            along = bearings[name].moment[row] @ bearings[name].axis[row]
            np.testing.assert_allclose(along, -passive[k] - joints.armature[k] * a_free[k], atol=1e-9)
    closing = closure_forces(model, run, lambda t, state, v: push)[0]
    state, v, u = next(iter(run.states(model)))
    one = closure_forces_at(model, state, v, u, wrenches=push)[0]
    np.testing.assert_allclose(closing.force[0], one.force[0])
