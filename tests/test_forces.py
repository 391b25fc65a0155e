"""Closure forces in physical units, against Pinocchio's contacts, equal power and equilibrium."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import ccpin
from ccpin.errors import InvalidInputError, SingularConfigurationError
from ccpin.forces import closure_forces, closure_wrench
from oracles import descriptor
from strategies import mechanisms

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
        found = closure_wrench(model, q, v, u, q_free)
        v_free = model.rho(q_free) @ v
        tau = mechanism.actuation.T @ u
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
    closures = closure_wrench(model, model.alpha(q_free), np.zeros(model.n), np.zeros(model.n_actuated))
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


@settings(max_examples=60)
@given(mechanisms(), st.integers(0, 2**32 - 1))
def test_wrenches_do_the_constraints_work(drawn, seed):
    """Σ (J_A − J_B)ᵀ wrench is the generalized force φ_q′ᵀλ of the descriptor form, closures of every kind."""
    mechanism = ccpin.load(drawn.description)
    model = ccpin.ReducedModel(mechanism)
    q_free = mechanism.q_reference
    assume(model.parametrization.rcond(q_free) > 1e-3)
    rng = np.random.default_rng(seed)
    v, u = rng.normal(size=model.n), rng.normal(size=model.n_actuated)
    v = v / max(1.0, np.linalg.norm(model.rho(q_free) @ v))
    try:
        found = closure_wrench(model, model.alpha(q_free), v, u, q_free)
    except SingularConfigurationError:
        assume(False)
    total = np.zeros(mechanism.n_free)
    for closure, wrench in zip(mechanism.closures, found, strict=True):
        j_a, j_b, point = end_jacobians(mechanism, closure, q_free)
        np.testing.assert_allclose(wrench.point[0], point, atol=1e-12)
        total += (j_a - j_b).T @ np.concatenate([wrench.force[0], wrench.moment[0]])
    tau, v_free = mechanism.actuation.T @ u, model.rho(q_free) @ v
    expected = descriptor.direct(mechanism.description, mechanism.pin_model, q_free, v_free, tau).force
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-7 * max(1.0, np.abs(expected).max()))


def test_the_rods_of_a_delta_at_rest_carry_the_platform():
    """At rest the six rods' forces on the platform add up to its weight, upwards."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    q_free = model.mechanism.q_reference
    q = model.alpha(q_free)
    at_rest = closure_wrench(model, q, np.zeros(3), model.gravity(q, q_free), q_free)
    upward = sum(closure.force[0] for closure in at_rest)
    links = {link.name: link for link in model.mechanism.description.links}
    weight = 9.81 * links["platform"].inertia.mass
    carried = {closure.link_a for closure in model.mechanism.closures}
    sign = 1.0 if carried == {"platform"} else -1.0
    np.testing.assert_allclose(sign * upward, [0.0, 0.0, weight], atol=1e-9 * weight)


def test_a_motion_has_its_peaks():
    """Histories have a sample's shape, agree with single states, and their peaks are the largest samples."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    goal = np.radians([-90.0, -100.0])
    law = ccpin.control.PDSimpleGravity(model, goal, [11.0, 11.0], [0.65, 0.6])
    trajectory = ccpin.simulate(model, law, np.radians([-120.0, -130.0]), duration=0.2, sample_period=5e-3)
    (history,) = closure_forces(model, trajectory)
    assert history.force.shape == history.moment.shape == (len(trajectory.t), 3)
    k = 17
    (single,) = closure_wrench(model, trajectory.q[k], trajectory.v[k], trajectory.u[k], trajectory.q_free[k])
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
    trajectory = ccpin.simulate(model, None, np.radians([-90.0, -100.0]), duration=0.01)
    with pytest.raises(InvalidInputError, match="this model has"):
        closure_forces(ccpin.ReducedModel(ccpin.load("four_bar")), trajectory)
