"""Enclosures of mechanisms with every joint kind, redundant rows and motors elsewhere, against integrators and twins.

A twin is the same mechanism written with revolute and prismatic joints: its boxes hold the same exact motion.
"""

from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.control import Measurement
from ccpin.control.control_law import NoTorque
from ccpin.description import Joint, Link
from ccpin.errors import CcpinError, UnsupportedMechanismError
from tests.support.ball_joint import ball_joint
from tests.support.long_cases import later
from tests.support.paper import GOAL, K_P, K_V, START
from tests.support.strategies import DOF, JOINING, Growth

flint = pytest.importorskip("flint")

from ccpin.validated import certify_move, enclose, enclose_set  # noqa: E402
from ccpin.validated.arithmetic.balls import around, ball  # noqa: E402
from ccpin.validated.arithmetic.series import values  # noqa: E402
from ccpin.validated.model.closed_loop import recorded_loop  # noqa: E402
from tests.support.recorded import (  # noqa: E402
    MECHANISMS,
    X,
    Y,
    Z,
    ball_and_universal,
    balls,
    gear_train,
    numbers,
    planar_platform,
    random_state,
    with_kinds,
    x_rate,
)

FINE = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13}
QUICK = {"order": 14, "tolerance": 1e-14, "pieces": 4}
LARGE = ("many redundant", "balls of a Stewart platform")


pytestmark = pytest.mark.usefixtures("precise")


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=[pytest.mark.slow] * (name in LARGE)) for name in MECHANISMS],
)
def test_recorded_dynamics(name):
    """The tape's (ẋ, q̈) and energies are the reduced model's at random closed states."""
    model = ccpin.ReducedModel(MECHANISMS[name]())
    state, v = random_state(model)
    loop = recorded_loop(model, None, state.q_free)
    start = balls(loop.own.numbers(state.q_free), v)
    accelerated = state.forward_dynamics(v, np.zeros(model.n_actuated))
    expected = np.concatenate([x_rate(loop, state, v), accelerated])
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(numbers(values(loop.equations.field, start)), expected, rtol=0, atol=1e-12 * scale)
    np.testing.assert_allclose(numbers(values(loop.equations.energies, start)), state.energy(v), rtol=1e-12)
    np.testing.assert_allclose(numbers(values(loop.equations.closure, start)), 0.0, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seeds", [(1, 9, 12, 14, 32, 36), pytest.param(range(120), marks=pytest.mark.slow)], ids=len)
def test_random_mechanisms_of_every_kind(seeds):
    """The same of random trees of every joint kind and closure kind, with components as coordinates."""
    seen = set()
    for seed in seeds:
        rng = np.random.default_rng(seed)
        growth = Growth(rng)
        arms = [growth.grow("base", rng.choice(list(DOF), rng.integers(1, 4)).tolist()) for _ in range(2)]
        growth.close(rng.choice(JOINING), *arms)
        try:
            model = ccpin.ReducedModel(ccpin.load(growth.drawn().description))
            state, v = random_state(model, seed, 0.02)
            loop = recorded_loop(model, None, state.q_free)
        except CcpinError:
            continue
        found = numbers(values(loop.equations.field, balls(loop.own.numbers(state.q_free), v)))
        accelerated = state.forward_dynamics(v, np.zeros(model.n_actuated))
        expected = np.concatenate([x_rate(loop, state, v), accelerated])
        scale = max(1.0, np.abs(expected).max()) / state.rcond
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * scale)
        seen |= {joint.kind.name for joint in loop.own.joints} | {part.component for part in model.coordinates.parts}
    assert seen >= {*DOF, "tx", "rx", "rz"}


def law_of(model, start, offset=0.05):
    """PD with simple gravity compensation towards a set point near a start."""
    goal = model.coordinates.integrate(start, np.full(model.n, offset))
    return ccpin.control.PDSimpleGravity(model, goal, np.full(model.n, 5.0), np.full(model.n, 0.5))


def assert_encloses(model, law, state, v, duration, **options):
    """The enclosure is proven, thin, and holds what an integrator computes; returned."""
    found = enclose(model, law, state.q, v, duration, near=state.q_free, **QUICK | options)
    sample = ccpin.simulate(
        model,
        law or NoTorque(model),
        state,
        v,
        duration=duration,
        method="DOP853",
        rtol=1e-12,
        atol=1e-13,
    )
    assert found.verdict == "proven", found.reason
    assert all(found.contains(*at_t, tolerance=1e-9) for at_t in zip(sample.t, sample.q_free, sample.v, strict=True))
    wrong = sample.q_free[-1] + 1e-5 * np.sign(sample.q_free[-1])
    assert not found.contains(duration, wrong, sample.v[-1], tolerance=1e-9)
    assert max(found.q_free_radius[-1].max(), found.v_radius[-1].max()) < 1e-6
    return found


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=() if name in ("ball and universal", "floating", "geared") else pytest.mark.slow)
        for name in MECHANISMS
    ],
)
def test_encloses_what_an_integrator_computes(name):
    """Free motions of every kind of joint; the energy's ball stays at its start where nothing rubs."""
    model = ccpin.ReducedModel(MECHANISMS[name]())
    state, v = random_state(model)
    found = assert_encloses(model, None, state, v, 0.01 if "balls" in name or "many" in name else 0.03)
    if name not in ("geared", "ball and universal"):
        assert found.energy(found.times[-1]).contains(found.energy(0.0).mid())
    redundant = model.mechanism.constraints().size > model.mechanism.n_free - model.n
    assert np.all(found.left_open < 1e-13)
    assert np.all(found.left_open > 0.0) == redundant


def meet(first, second, places, others, duration, slack=0.0):
    """Whether two enclosures hold a common motion in some of their numbers, at all of many times."""
    for t in np.linspace(0.0, duration, 11):
        one, two = first.inputs(t), second.inputs(t)
        pairs = [*zip(places, others, strict=True)]
        pairs += [(first.loop.equations.n_x + k, second.loop.equations.n_x + k) for k in range(first.loop.equations.n)]
        if not all(around(one[a], ball(slack)).overlaps(two[b]) for a, b in pairs):
            return False
    return True


@pytest.mark.parametrize(
    "kinds", later({f"joint{k}": "continuous" for k in range(1, 5)}, {"joint3": "continuous", "joint4": "continuous"})
)
def test_continuous_joints_move_as_revolute_ones(rpdr_model, kinds):
    """The paper's move on circles: all boxes meet those in angles (starts are rounded); other gains' do not."""
    twin = ccpin.ReducedModel(ccpin.load(with_kinds("rpdr", **kinds)))
    circles = "joint1" in kinds
    point = on_circles if circles else np.array
    plain = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    law = ccpin.control.PDSimpleGravity(twin, point(GOAL), K_P, K_V)
    expected = enclose(rpdr_model, plain, START, [1.0, -2.0], 0.01, **QUICK)
    found = enclose(twin, law, point(START), [1.0, -2.0], 0.01, **QUICK)
    assert found.verdict == "proven"
    everywhere = range(4), range(4)
    assert meet(found, expected, *everywhere, 0.01, slack=1e-14 if circles else 0.0)
    other = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P * (1 + 1e-7), K_V)
    assert not meet(
        found, enclose(rpdr_model, other, START, [1.0, -2.0], 0.01, **QUICK), *everywhere, 0.01, slack=1e-14
    )


def test_a_ball_joint_moves_as_three_revolute_ones():
    """The spatial four-bar with its ball written as three turns about axes through one point."""
    described = ball_and_universal()
    ball_joint_there = next(j for j in described.joints if j.kind == "spherical")
    links = (*described.links, Link("first"), Link("second"))
    turns = [
        Joint("turn_x", "revolute", ball_joint_there.parent, "first", ball_joint_there.placement, X),
        Joint("turn_y", "revolute", "first", "second", axis=Y),
        Joint("turn_z", "revolute", "second", ball_joint_there.child, axis=Z),
    ]
    joints = [j for j in described.joints if j is not ball_joint_there]
    twin = ccpin.load(replace(described, links=links, joints=(*joints, *turns)), independent=["crank"])
    models = [ccpin.ReducedModel(m) for m in (ccpin.load(described), twin)]
    first, second = (enclose(m, None, m.alpha(m.mechanism.q_reference), [2.0], 0.03, **QUICK) for m in models)
    assert first.verdict == second.verdict == "proven"
    places = (
        [_place(e.loop, m, name) for name in ("crank", "rocker")] for e, m in zip((first, second), models, strict=True)
    )
    assert meet(first, second, *places, 0.03)


def test_a_planar_joint_moves_as_two_slides_and_a_turn():
    """The 3-RRR's motors, its platform on one joint or on three."""
    twin, model = (ccpin.ReducedModel(ccpin.load(file)) for file in (planar_platform(), "planar_3rrr"))
    q = model.alpha(model.mechanism.q_reference) + 0.01
    first, second = (enclose(m, law_of(m, q), q, [0.5, -0.2, 0.1], 0.01, **QUICK) for m in (twin, model))
    assert first.verdict == second.verdict == "proven"
    motors = ([_place(e.loop, m, f"motor{k}") for k in (1, 2, 3)] for e, m in ((first, twin), (second, model)))
    assert meet(first, second, *motors, 0.01)


def _place(loop, model, name):
    return loop.own.joints[model.mechanism.tree.joint(name).number - 1].x.start


def test_a_geared_wheel_turns_on():
    """Three to one through several turns: the wheel's angle is three times the crank's, whole turns included."""
    model = ccpin.ReducedModel(ccpin.load(gear_train()))
    found = enclose(model, None, [0.2], [15.0], 0.5, **QUICK)
    assert found.verdict == "proven"
    crank, wheel, _ = found.inputs(0.5)
    assert wheel > 2 * np.pi
    assert (wheel - 3 * crank).contains(0)
    sample = ccpin.simulate(model, NoTorque(model), [0.2], [15.0], duration=0.5, **FINE)
    assert all(found.contains(*at_t, tolerance=1e-8) for at_t in zip(sample.t, sample.q_free, sample.v, strict=True))


def test_rows_left_out_are_bounded_along_the_motion():
    """`left_open` lies above what the rows are at many times: of the energies in their place, which are not small."""
    from ccpin.validated.flow.motion_claim import left_open

    model = ccpin.ReducedModel(ccpin.load("bennett"))
    state, v = random_state(model)
    found = enclose(model, None, state.q, v, 0.05, near=state.q_free, **QUICK)
    loop = replace(found.loop.equations, left_out=found.loop.equations.energies)
    for step, begin in zip(found.steps, found.times[:-1], strict=True):
        largest = max(
            abs(float(x.mid()))
            for t in np.linspace(0, step.length, 9)
            for x in values(loop.energies, found.inputs(begin + t))
        )
        assert largest <= left_open(loop, step) < 2 * largest
    rows = model.mechanism.constraints()
    assert len(found.loop.equations.left_out.outputs) == rows.size - (model.mechanism.n_free - model.n)
    assert np.abs(rows.residual(found.at(0.05).q_free)).max() < 1e-14


def test_motors_elsewhere(rpdr_model):
    """With motors on the passive joints the law's force is the same: boxes meet; u itself is what the library has."""
    twin = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"]))
    laws = [ccpin.control.PDSimpleGravity(m, GOAL, K_P, K_V) for m in (rpdr_model, twin)]
    first, second = (
        enclose(m, law, START, None, 0.02, **QUICK) for m, law in zip((rpdr_model, twin), laws, strict=True)
    )
    assert meet(first, second, range(4), range(4), 0.02)
    sample = ccpin.simulate(twin, laws[1], START, duration=0.02, **FINE)
    assert all(second.contains(*at_t, tolerance=1e-9) for at_t in zip(sample.t, sample.q_free, sample.v, strict=True))


@pytest.mark.slow
def test_efforts_held_elsewhere():
    """The law read at 1 kHz by motors on the passive joints: starts stepped one by one stay in the tube."""
    model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"]))
    law = ccpin.control.PDSimpleGravity(model, GOAL, K_P, K_V)
    spread, period = np.array([2e-4, 2e-4, 2e-3, 2e-3]), 2.0**-10
    options = {"order": 12, "tolerance": 1e-13, "pieces": 2, "cells": 1}
    found = enclose_set(model, law, START, None, 2 * period, spread=(spread[0], spread[2]), period=period, **options)
    assert found.verdict == "proven"
    (tube,), largest = found.tubes, 0.0
    for signs in np.random.default_rng(5).choice([-1.0, 1.0], (6, 4)):
        q, v = np.split(np.append(START, [0.0, 0.0]) + spread * signs, 2)
        for half in range(4):
            if half % 2 == 0:
                u = law.torque(0.0, Measurement(q), v)
            held = ccpin.control.TorqueFunction(lambda t, q, v, u=u: u, ())
            motion = ccpin.simulate(model, held, q, v, duration=0.5 * period, **FINE)
            q, v = motion.q[-1], motion.v[-1]
            if half % 2 == 0:
                place = np.abs(tube.coordinates((half + 1) * 0.5 * period, q, v, u)).max()
                assert place <= 1.0 + 1e-6
                largest = max(largest, place)
    assert largest > 0.7


def test_motors_that_lose_their_grip():
    """A crank driven by its rocker: nothing is claimed at the dead point, where ρᵀSᵀ vanishes."""
    model = ccpin.ReducedModel(ccpin.load("four_bar", actuated=["rocker"], independent=["crank"]))
    q = model.alpha(model.mechanism.q_reference)
    angles = q + np.linspace(0.0, 2 * np.pi, 200)[:, None]
    speeds = [model.rho(model.sigma(angle))[model.mechanism.tree.joint("rocker").v][0, 0] for angle in angles]
    dead = angles[np.argmax(np.diff(np.sign(speeds)) != 0), 0]
    law = ccpin.control.PDSimpleGravity(model, [dead + 0.3], 5.0, 0.5)
    found = enclose(model, law, [dead - 0.2], [4.0], 0.5, **QUICK)
    assert found.verdict == "undecided"
    assert "motors" in found.reason
    assert found.at(found.times[-1]).q_free[0] < dead + 0.04


def on_circles(q):
    """(cosine, sine) of each angle."""
    return np.ravel(np.column_stack([np.cos(q), np.sin(q)]))


def paper_law_on_circles():
    """The RPDR of continuous joints under the paper's law."""
    twin = ccpin.ReducedModel(ccpin.load(with_kinds("rpdr", **{f"joint{k}": "continuous" for k in range(1, 5)})))
    return twin, ccpin.control.PDSimpleGravity(twin, on_circles(GOAL), K_P, K_V)


@pytest.mark.slow
def test_the_certified_move_on_circles():
    """The paper's move of continuous joints into B₂."""
    twin, law = paper_law_on_circles()
    move = certify_move(twin, law, on_circles(START), arrival=2.9, **QUICK | {"pieces": 8})
    assert move.verdict == "proven"


@pytest.mark.slow
def test_sets_of_starts_on_circles(rpdr_model):
    """Tubes of continuous joints are those of the revolute ones."""
    twin, law = paper_law_on_circles()
    plain = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    options = {"spread": (1e-3, 0.01), "cells": 2, "order": 16, "tolerance": 1e-14, "pieces": 4}
    sets = [
        enclose_set(m, w, q, None, 0.01, **options)
        for m, w, q in ((twin, law, on_circles(START)), (rpdr_model, plain, START))
    ]
    assert {found.verdict for found in sets} == {"proven"}
    for t in (0.0, 0.005, 0.01):
        (a, reach), (b, other) = (found.tubes[0].box(t) for found in sets)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12)
        np.testing.assert_allclose(reach, other, rtol=1e-2)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "ball and universal",
        pytest.param("redundant", marks=pytest.mark.slow),
        pytest.param("single turn", marks=pytest.mark.slow),
        pytest.param("ball with a spring", marks=pytest.mark.slow),
    ],
)
def test_sets_of_starts(name):
    """Tubes of mechanisms with ball joints, and with redundant rows: starts simulated one by one stay inside."""
    model = ccpin.ReducedModel(MECHANISMS[name]())
    state, v = random_state(model)
    found = enclose_set(model, None, state.q, v, 0.01, spread=(1e-3, 1e-2), near=state.q_free, cells=2, **QUICK)
    assert found.verdict == "proven"
    largest = 0.0
    for signs in ([1.0, 1.0], [1.0, -1.0], [-1.0, 0.3]):
        start = state.q + 1e-3 * signs[0], v + 1e-2 * signs[1]
        motion = ccpin.simulate(model, NoTorque(model), *start, duration=0.01, **FINE)
        for t, q, speed in zip(motion.t, motion.q, motion.v, strict=True):
            assert found.contains(t, q, speed, 1e-6)
        largest = max(largest, np.abs(found.tubes[0].coordinates(0.01, q, speed)).max())
    assert largest > 0.7


def test_an_angle_half_a_turn_from_its_goal():
    """Where q̃ jumps on the circle nothing is claimed."""
    model = ccpin.ReducedModel(ccpin.load(with_kinds("slider_crank", crank="continuous")))
    law = ccpin.control.PDSimpleGravity(model, [1.0, 0.0], 1e-3, 1e-3)
    found = enclose(model, law, [np.cos(3.0), np.sin(3.0)], [10.0], 0.1, **QUICK)
    assert found.verdict == "undecided"
    assert "half a turn" in found.reason
    assert 3.0 < found.inputs(found.times[-1])[found.loop.equations.independent[0]] < np.pi


def test_what_is_refused(rpdr_model):
    """Sets on a whole ball, and other laws: each by name."""
    model = ball_joint()
    q = model.alpha(model.mechanism.q_reference)
    with pytest.raises(UnsupportedMechanismError, match="components"):
        enclose_set(model, None, q, None, 0.01, spread=1e-3)
    with pytest.raises(UnsupportedMechanismError, match="TorqueFunction"):
        enclose(rpdr_model, ccpin.control.TorqueFunction(lambda t, q, v: q), START, None, 0.01)
