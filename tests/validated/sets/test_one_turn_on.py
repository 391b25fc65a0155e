"""A move on a continuous joint may arrive one turn on: 𝒱 < 0 refutes only where 𝒱 is one function of the state."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("flint")

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.validated import certify_move
from ccpin.validated.model.closed_loop import recorded_loop
from ccpin.validated.sets.arrival_reading import single_valued
from tests.support.parabola import KnownLoop

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
    motion = ccpin.simulate(model, law, on_circle(START), duration=30.0, sample_period=0.02)
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


@pytest.mark.parametrize(
    ("steps", "unit", "independent", "stiffness", "held"),
    [
        (["rz"], 0, (0,), 1.0, True), (["rz"], 0, (1,), 1.0, False), (["rz"], 2, (0,), 1.0, False),
        (["tz"], 0, (1,), 1.0, True), (["rz"], 2, (1,), 0.0, True), (["tx", "rz"], 2, (1,), 1.0, False),
    ],
)  # fmt: skip
def test_springs_that_make_another_energy_one_turn_on(steps, unit, independent, stiffness, held):
    """A joint that turns and has one: only where it is a coordinate that is a plain number."""
    joint = SimpleNamespace(number=1, kind=SimpleNamespace(steps=steps, unit=unit), x=slice(0, 1))
    stated = [SimpleNamespace(stated=SimpleNamespace(stiffness=stiffness))]
    tree = SimpleNamespace(tree=SimpleNamespace(joints=stated))
    law = SimpleNamespace(model=SimpleNamespace(mechanism=tree))
    known = KnownLoop(joints=(joint,), independent=independent, wrapped=(), upright=())
    assert single_valued(known, law) is held
    known.upright = (1,)
    assert not single_valued(known, law)


@pytest.mark.parametrize(("gravity", "coupling", "held"), [(0.0, 0.0, True), (0.5, 0.0, False), (0.0, 0.5, False)])
def test_angles_whose_errors_jump_half_a_turn_away(gravity, coupling, held):
    """Of either angle; what neither gravity nor a gain couples does not jump."""
    law = SimpleNamespace(
        model=SimpleNamespace(mechanism=SimpleNamespace(tree=SimpleNamespace(joints=()))),
        gravity_d=np.array([0.5, gravity, 0.0]),
        K_p=np.array([[1.0, coupling, 0.25], [coupling, 1.0, 0.0], [0.25, 0.0, 1.0]]),
    )
    for places in ((4,), (4, 5), (5, 4)):
        wrapped = tuple(SimpleNamespace(place=k) for k in places)
        known = KnownLoop(joints=(), independent=(3, 4, 5), wrapped=wrapped, upright=())
        assert single_valued(known, law) is (held and 5 not in places)
