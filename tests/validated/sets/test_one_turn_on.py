"""A move on a continuous joint may arrive one turn on: 𝒱 < 0 refutes only where 𝒱 is one function of the state."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("flint")

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.validated import certify_move
from ccpin.validated.model.closed_loop import recorded_loop
from ccpin.validated.sets.arrival import single_valued

GOAL, START = 3.316125578789226, 3.316125578789226 - (np.pi - 0.3)
K_P, K_V = 0.003, 0.01


def on_circle(angle):
    """A continuous joint's q."""
    return np.array([np.cos(angle), np.sin(angle)])


def turning_crank():
    """The four-bar's crank as a continuous joint, under gains too weak to hold it back from going round."""
    described = ccpin.load("four_bar").description
    crank, *others = described.joints
    crank = replace(crank, kind="continuous", lower=-np.inf, upper=np.inf)
    model = ccpin.ReducedModel(ccpin.load(replace(described, joints=(crank, *others))))
    return model, PDSimpleGravity(model, on_circle(GOAL), [K_P], [K_V])


def test_a_move_that_arrives_one_turn_on_is_not_refuted():
    """𝒱 is below 0 at the start, yet the motion comes to rest at q_d, by simulation: q̃ jumps by 2π."""
    model, law = turning_crank()
    assert law.lyapunov(on_circle(START), np.zeros(1)) < -0.05
    motion = ccpin.simulate(model, law, on_circle(START), duration=30.0)
    assert np.abs(law.error(motion.q[-1])).max() < 1e-6
    turned = np.unwrap(np.arctan2(motion.q[:, 1], motion.q[:, 0]))
    assert abs(turned[-1] - turned[0]) > np.pi
    move = certify_move(model, law, on_circle(START), arrival=1e-3, duration=1e-3, order=8, tolerance=1e-9)
    assert move.verdict == "undecided"


def test_where_the_lyapunov_function_is_one_function():
    """Plain revolute joints: yes. Circles: without gravity at q_d and coupled gains. Springs: where y does not turn."""
    model, law = turning_crank()
    assert not single_valued(recorded_loop(model, law), law)
    weightless = ccpin.ReducedModel(model.mechanism, gravity=[0.0, 0.0, 0.0])
    law = PDSimpleGravity(weightless, on_circle(GOAL), [K_P], [K_V])
    assert single_valued(recorded_loop(weightless, law), law)
    described = ccpin.load("rpdr").description
    joints = tuple(replace(j, kind="continuous", lower=-np.inf, upper=np.inf) for j in described.joints)
    circles = ccpin.ReducedModel(ccpin.load(replace(described, joints=joints)), gravity=[0.0, 0.0, 0.0])
    goal = circles.alpha(circles.mechanism.q_reference)
    for coupling, expected in ((0.0, True), (0.1, False)):
        law = PDSimpleGravity(circles, goal, [[1.0, coupling], [coupling, 1.0]], [1.0, 1.0])
        assert single_valued(recorded_loop(circles, law), law) is expected
    described = ccpin.load("four_bar").description
    for sprung, expected in ((None, True), ("crank", True), ("rocker", False)):
        joints = tuple(replace(j, stiffness=0.1) if j.name == sprung else j for j in described.joints)
        model = ccpin.ReducedModel(ccpin.load(replace(described, joints=joints)))
        law = PDSimpleGravity(model, model.alpha(model.mechanism.q_reference), [K_P], [K_V])
        assert single_valued(recorded_loop(model, law), law) is expected
