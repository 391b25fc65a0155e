"""Closure forces in physical units, against Pinocchio's contacts, equal power and equilibrium."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ccpin
from ccpin.errors import DifferentSubjectsError
from ccpin.simulation import closure_forces, joint_forces
from ccpin.simulation.events.samples import SAMPLED
from ccpin.simulation.results.forces import closure_forces_at
from tests.oracles import descriptor, rpdr
from tests.support.paper import GOAL, K_P, K_V, START
from tests.support.strategies import mechanisms

seeds = st.integers(0, 2**32 - 1)
MODES = {"rpdr": (-2.0, -1.9), "delta": (0.1, -0.1, 0.3), "stewart": None, "hexa": None, "planar_3rrr": None}


def as_points(name):
    """A mechanism of the zoo whose closures are points alone, which is what Pinocchio's 3-row contacts are."""
    description = ccpin.load(name).description
    closures = tuple(replace(closure, kind="spherical") for closure in description.closures)
    return ccpin.load(replace(description, closures=closures))


def states(model, count=3):
    """Random states about the reference or the middle of the workspace."""
    rng = np.random.default_rng(11)
    middle = MODES[model.mechanism.name]
    middle = model.alpha(model.mechanism.q_reference) if middle is None else np.array(middle)
    for _ in range(count):
        q = middle + 0.05 * rng.normal(size=model.n)
        yield q, rng.normal(size=model.n), rng.normal(scale=3.0, size=model.n_actuated), model.sigma(q)


def in_plane(loop_normal, vector):
    """A vector's part in a planar loop's plane (all of it for a spatial loop)."""
    return vector if loop_normal is None else vector - (vector @ loop_normal) * loop_normal


@pytest.mark.parametrize("name", sorted(MODES))
def test_forces_are_those_of_pinocchios_contacts(name):
    """The force on end A is the world-axes multiplier of a tight proximal solve of 3-row contacts, to 1e-8."""
    mechanism = as_points(name)
    model = ccpin.ReducedModel(mechanism)
    for q, v, u, q_free in states(model):
        found = closure_forces_at(model, q, v, u, q_free)
        v_free = model.rho(q_free) @ v
        tau = model.at(q, q_free).joint_efforts(u)
        expected = descriptor.pinocchio(mechanism.description, mechanism.pin_model, q_free, v_free, tau).multipliers
        for loop, closure, force in zip(mechanism.constraints().loops, found, expected.reshape(-1, 3), strict=True):
            wanted = in_plane(loop.normal, force)
            np.testing.assert_allclose(closure.force[0], wanted, rtol=0, atol=1e-8 * max(1.0, np.abs(wanted).max()))
            assert np.abs(closure.moment).max() == 0.0


@pytest.mark.parametrize("name", ["rpdr", "four_bar", "slider_crank", "planar_3rrr", "bennett", "sarrus", "delta"])
def test_what_is_determined(name):
    """A planar loop leaves its normal force undetermined, an overconstrained linkage more, point loops nothing."""
    model = ccpin.ReducedModel(ccpin.load(name))
    q_free = model.mechanism.q_reference
    closures = closure_forces_at(model, model.alpha(q_free), np.zeros(model.n), np.zeros(model.n_actuated))
    for closure in closures:
        force, moment = closure.determined[0, :3], closure.determined[0, 3:]
        if name == "delta":
            assert closure.determined.all()
        elif name in ("bennett", "sarrus"):
            assert not force.all() or not moment.all()
        else:
            assert force.tolist() == [True, False, True]
            assert moment.tolist() == [False, True, False]
            assert closure.force[0, 1] == 0.0
            assert "force y" in closure.peak().undetermined


def end_jacobians(mechanism, closure, q_free):
    """Pinocchio's Jacobians of both closure ends, the moment's arm for B moved to A's closure point."""
    model, data = mechanism.pin_model, mechanism.pin_model.createData()
    pin.computeJointJacobians(model, data, q_free)
    pin.updateFramePlacements(model, data)
    jacobians, points = [], []
    for link, placement in ((closure.link_a, closure.placement_a), (closure.link_b, closure.placement_b)):
        frame = model.getFrameId(link)
        jacobian = np.array(pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED))
        arm = data.oMf[frame].rotation @ placement[:3, 3]
        points.append(data.oMf[frame].translation + arm)
        jacobian[:3] -= pin.skew(arm) @ jacobian[3:]
        jacobians.append(jacobian)
    jacobians[1][:3] -= pin.skew(points[0] - points[1]) @ jacobians[1][3:]
    return jacobians[0], jacobians[1], points[0]


class State(NamedTuple):
    """A random mechanism at its reference with a random velocity and random efforts."""

    mechanism: ccpin.Mechanism
    model: ccpin.ReducedModel
    v: np.ndarray
    u: np.ndarray

    @property
    def v_free(self):
        return self.model.rho(self.mechanism.q_reference) @ self.v

    @property
    def tau(self):
        q_free = self.mechanism.q_reference
        return self.model.at(self.model.alpha(q_free), q_free).joint_efforts(self.u)

    def still(self):
        """A motion of one sample."""
        simulator = ccpin.Simulator(self.model, lambda t, q, v: self.u, friction={})
        simulator.reset(self.model.alpha(self.mechanism.q_reference), self.v, near=self.mechanism.q_reference)
        motion = simulator.run(1e-9, sample_period=1e-9)
        samples = {name: getattr(motion, name)[:1] for name in SAMPLED}
        return motion._replace(**samples)


def state(description, seed):
    mechanism = ccpin.load(description, free=["all"])
    model = ccpin.ReducedModel(mechanism)
    rng = np.random.default_rng(seed)
    v, u = rng.normal(size=model.n), rng.normal(size=model.n_actuated)
    return State(mechanism, model, v / max(1.0, np.linalg.norm(model.rho(mechanism.q_reference) @ v)), u)


@settings(max_examples=15)
@given(mechanisms(), seeds)
def test_wrenches_do_the_constraints_work(drawn, seed):
    """Σ (J_A − J_B)ᵀ wrench is the generalized force φ_q′ᵀλ of the descriptor form, closures of every kind."""
    at = state(drawn.description, seed)
    assume(at.model.parametrization.rcond(at.mechanism.q_reference) > 1e-3)
    mechanism, q_free = at.mechanism, at.mechanism.q_reference
    total = np.zeros(mechanism.n_free)
    for closure, wrench in zip(mechanism.closures, closure_forces(at.model, at.still()), strict=True):
        j_a, j_b, point = end_jacobians(mechanism, closure, q_free)
        np.testing.assert_allclose(wrench.point[0], point, atol=1e-12)
        total += (j_a - j_b).T @ np.concatenate([wrench.force[0], wrench.moment[0]])
    expected = descriptor.direct(mechanism.description, mechanism.pin_model, q_free, at.v_free, at.tau).force
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-7 * max(1.0, np.abs(expected).max()))


def check_free_directions(at):
    """Along its own motion a joint carries its motor's effort less its rotor's inertia times acceleration."""
    model, q_free = at.mechanism.pin_model, at.mechanism.q_reference
    data = model.createData()
    pin.computeJointJacobians(model, data, q_free)
    motion = descriptor.direct(at.mechanism.description, model, q_free, at.v_free, at.tau)
    expected = at.tau - model.armature * motion.a_free
    forces = joint_forces(at.model, at.still())
    assert [force.name for force in forces] == list(model.names)[1:]
    for force in forces:
        joint = model.joints[model.getJointId(force.name)]
        own = slice(joint.idx_v, joint.idx_v + joint.nv)
        columns = pin.getJointJacobian(model, data, joint.id, pin.LOCAL_WORLD_ALIGNED)[:, own]
        found = columns.T @ np.concatenate([force.force[0], force.moment[0]])
        scale = max(1.0, np.abs(expected).max(), np.abs(force.force).max(), np.abs(force.moment).max())
        np.testing.assert_allclose(found, expected[own], rtol=0, atol=1e-7 * scale)
        if joint.nv == 1:
            axis = columns[:3, 0] if at.mechanism.tree.joint(force.name).kind.name == "prismatic" else columns[3:, 0]
            np.testing.assert_allclose(force.axis[0], axis, atol=1e-12)


@settings(max_examples=15)
@given(mechanisms(), seeds)
def test_joints_carry_their_motors_effort(drawn, seed):
    """Newton and Euler against the descriptor form on random mechanisms: trees, loops and joints of every kind."""
    at = state(drawn.description, seed)
    assume(at.model.parametrization.rcond(at.mechanism.q_reference) > 1e-3)
    check_free_directions(at)


@pytest.mark.parametrize("name", ["rpdr", "slider_crank", "planar_3rrr", "delta", "stewart", "hexa", "bennett"])
def test_joints_of_the_zoo_carry_their_motors_effort(name):
    """The same on the zoo, rotor inertia included."""
    check_free_directions(state(ccpin.load(name).description, 3))


def test_joints_that_only_measure_carry_nothing():
    """The Delta's platform hangs on six joints that stand for a free body: the last passes no wrench at all."""
    at = state(ccpin.load("delta").description, 5)
    last = next(force for force in joint_forces(at.model, at.still()) if force.name == "platform_yaw")
    assert np.abs(last.force).max() < 1e-10
    assert np.abs(last.moment).max() < 1e-10
    assert last.determined.all()


def test_the_base_carries_the_weight_of_a_robot_at_rest():
    """The RPDR held still: its two base bearings carry its weight between them, and nothing sideways."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    q_free = model.mechanism.q_reference
    at = State(model.mechanism, model, np.zeros(2), model.gravity(model.alpha(q_free), q_free))
    base = [force for force in joint_forces(model, at.still()) if force.name in ("joint1", "joint2")]
    weight = rpdr.GRAVITY * (rpdr.M1 + rpdr.M2 + rpdr.M3 + rpdr.M4)
    np.testing.assert_allclose(sum(force.force[0] for force in base), [0.0, 0.0, weight], atol=1e-10)
    assert "force y" in base[0].peak().undetermined


def test_the_rods_of_a_delta_at_rest_carry_the_platform():
    """At rest the six rods' forces on the platform add up to its weight, upwards."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    q_free = model.mechanism.q_reference
    q = model.alpha(q_free)
    at_rest = closure_forces_at(model, q, np.zeros(3), model.gravity(q, q_free), q_free)
    upward = sum(closure.force[0] for closure in at_rest)
    links = {link.name: link for link in model.mechanism.description.links}
    weight = 9.81 * links["platform"].inertia.mass
    carried = {closure.link_a for closure in model.mechanism.closures}
    sign = 1.0 if carried == {"platform"} else -1.0
    np.testing.assert_allclose(sign * upward, [0.0, 0.0, weight], atol=1e-9 * weight)


def test_a_motion_has_its_peaks():
    """Histories have a sample's shape, agree with single states, and their peaks are the largest samples."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    trajectory = ccpin.simulate(model, law, np.radians([-120.0, -130.0]), duration=0.2, sample_period=5e-3)
    (history,) = closure_forces(model, trajectory)
    assert history.force.shape == history.moment.shape == (len(trajectory.t), 3)
    k = 17
    (single,) = closure_forces_at(model, trajectory.q[k], trajectory.v[k], trajectory.u[k], trajectory.q_free[k])
    np.testing.assert_allclose(history.force[k], single.force[0], rtol=1e-9)
    peak = history.peak()
    sizes = np.linalg.norm(history.force, axis=1)
    assert peak.force == pytest.approx(sizes.max())
    assert peak.force_time == trajectory.t[sizes.argmax()]
    assert peak.radial == pytest.approx(peak.force)
    assert peak.axial == pytest.approx(0.0, abs=1e-12)


def test_another_models_trajectory_is_refused():
    """A motion of the RPDR says nothing about a four-bar."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    trajectory = ccpin.simulate(model, None, GOAL, duration=0.01)
    with pytest.raises(DifferentSubjectsError, match="closures or independent"):
        closure_forces(ccpin.ReducedModel(ccpin.load("four_bar")), trajectory)


def test_friction_is_counted(rpdr_model):
    """After a motion with friction |force| is |λ| of the descriptor form (19), f beside u, by the closed forms."""
    friction = {"joint1": (0.2, 0.02), "joint2": (0.15, 0.0), "joint3": (0.03, 0.002), "joint4": (0.0, 0.003)}
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    motion = ccpin.simulate(rpdr_model, law, START, duration=0.2, friction=friction, sample_period=0.02)
    (found,) = closure_forces(rpdr_model, motion)
    order = [rpdr_model.mechanism.tree.names.index(name) for name in rpdr.FREE]
    sizes, without = [], []
    for q_free, v, u, f in zip(motion.q_free[:, order], motion.v, motion.u, motion.friction[:, order], strict=True):
        v_free = rpdr.rho(q_free) @ v
        jacobian = rpdr.psi_jacobian(q_free)[:2]
        matrix = np.block([[rpdr.mass_matrix(q_free), -jacobian.T], [jacobian, np.zeros((2, 2))]])
        rest = rpdr.coriolis_matrix(q_free, v_free) @ v_free + rpdr.gravity(q_free) - [*u, 0.0, 0.0]
        turning = rpdr.psi_jacobian_rate(q_free, v_free)[:2] @ v_free
        sizes.append(np.linalg.norm(np.linalg.solve(matrix, np.concatenate([f - rest, -turning]))[4:]))
        without.append(np.linalg.norm(np.linalg.solve(matrix, np.concatenate([-rest, -turning]))[4:]))
        coulomb, viscous = np.array([friction[name] for name in rpdr.FREE]).T
        sliding = np.abs(v_free) > 1e-6
        assert f[sliding] == pytest.approx((-coulomb * np.sign(v_free) - viscous * v_free)[sliding], abs=1e-10)
    assert np.linalg.norm(found.force, axis=1) == pytest.approx(sizes, abs=1e-8)
    assert np.abs(np.subtract(without, sizes)).max() > 0.1
