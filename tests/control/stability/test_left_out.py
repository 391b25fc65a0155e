"""What a mechanism states and the equations leave out: claims about motions name it, and say no more than is true."""

import numpy as np
import pytest

import ccpin
from ccpin import simulate
from ccpin.control import ComputedTorque, PDSimpleGravity, certify_tracking
from ccpin.control.references import PointToPoint
from ccpin.control.stability.set_point.theorem3 import certify_law
from ccpin.mechanism.assumptions import limits_left_out, mass_assumed, massless, rubbing, without_dry_friction
from tests.support.paper import GOAL, K_P, K_V


@pytest.fixture(scope="module")
def rough():
    """The RPDR with dry friction on its first and on a passive joint."""
    return ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint1": {"friction": 0.4}, "joint3": {"friction": 0.02}}))


@pytest.mark.slow
def test_set_points_with_dry_friction_are_where_motions_come_to_rest(rough):
    """A motion rests beside q_d, inside of 𝒬, where friction can hold ∇U; the certificate says that and no more."""
    law = PDSimpleGravity(rough, GOAL, K_P, K_V)
    certificate = certify_law(law, max_depth=10, budget=200)
    assert certificate.verdict == "proven"
    assert "dry friction of joint1, joint3" in certificate.reason
    assert "comes to rest" in certificate.reason
    assert "converges" not in certificate.reason
    start = GOAL + [0.12, -0.05]
    assert certificate.contains(start)
    motion = simulate(rough, law, start, duration=4.0)
    end = motion.q[-1]
    assert np.abs(end - GOAL).max() > 1e-3
    assert np.abs(motion.v[-1]).max() < 1e-6
    assert certificate.contains(end)
    state = rough.at(end, law.near)
    slope = state.g - law.gravity_d - law.K_p @ (GOAL - end)
    held = np.abs(state.reference.rho).T @ rough.mechanism.joints.friction
    assert np.all(np.abs(slope) <= held + 1e-6)


def test_an_unstable_set_point_may_be_held_by_dry_friction(rough):
    """What is refuted is stability without it: friction may hold a set point up that would fall."""
    upright, mode = np.radians([90.0, 90.0]), np.radians([90.0, -30.0, 90.0, 30.0])
    certificate = certify_law(PDSimpleGravity(rough, upright, [0.5, 0.5], K_V, mode), max_depth=2, budget=5)
    assert certificate.verdict == "refuted"
    assert "not stable" in certificate.reason
    assert "without the dry friction of joint1, joint3" in certificate.reason


def test_without_dry_friction_they_converge(rpdr_model):
    """The words of Theorem 3 itself, and the limits that the file states."""
    certificate = certify_law(PDSimpleGravity(rpdr_model, GOAL, K_P, K_V), max_depth=8, budget=60)
    assert "converges" in certificate.reason
    assert certificate.assumes == limits_left_out(rpdr_model.mechanism)
    assert [told.split(" joint")[0] for told in certificate.assumes] == [
        "the limits of the efforts of the motors on",
        "the limits of the positions of",
        "the limits of the speeds of",
    ]


def test_that_motions_move_mass_is_shown_or_said():
    """Bodies with mass and inertia make D positive definite; where some have none it is an assumption by name."""
    assert massless(ccpin.load("rpdr")) == ()
    assert mass_assumed(ccpin.load("rpdr")) == ()
    assert "platform_x" in massless(ccpin.load("delta"))
    model = ccpin.ReducedModel(ccpin.load("delta"))
    certificate = certify_law(
        PDSimpleGravity(model, np.zeros(3), np.full(3, 30.0), np.full(3, 4.0)), max_depth=0, budget=1
    )
    assert "every motion moves mass" in certificate.assumes[-1]


def test_tracking_names_the_friction_that_its_bound_leaves_out(rough):
    """A file's dry friction is no part of f̄ unless the caller makes it one."""
    reference = PointToPoint(rough, GOAL, GOAL + [0.05, 0.05], 0.5)
    law = ComputedTorque(rough, reference, [400.0] * 2, [40.0] * 2)
    certificate = certify_tracking(law, 1e-5, cells=16)
    assert "without the dry friction of joint1, joint3" in certificate.reason
    assert certificate.assumes == limits_left_out(rough.mechanism)


@pytest.mark.slow
def test_moves_name_the_friction_that_they_leave_out(rough):
    """A validated motion is of the smooth equations."""
    validated = pytest.importorskip("ccpin.validated")
    law = PDSimpleGravity(rough, GOAL, K_P, K_V)
    move = validated.certify_move(rough, law, GOAL, np.zeros(2), arrival=1.0, duration=0.01)
    assert move.assumes == limits_left_out(rough.mechanism)
    enclosure = validated.enclose(rough, law, GOAL, np.zeros(2), duration=0.01)
    tubes = validated.enclose_set(rough, law, GOAL, np.zeros(2), spread=1e-6, duration=0.01)
    for reason in (move.reason, enclosure.reason, tubes.reason):
        assert "without the dry friction of joint1, joint3" in reason


def test_nothing_is_left_out_of_what_states_nothing():
    """No friction, no words."""
    mechanism = ccpin.load("rpdr")
    assert rubbing(mechanism) == ()
    assert without_dry_friction(mechanism) == ""
