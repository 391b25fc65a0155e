"""Recorded mechanisms beside those of `test_joints`: what their dynamics rest on, by the model's own figures."""

from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.control.control_law import NoTorque
from ccpin.errors import DifferentSubjectsError, UnsupportedMechanismError
from tests.support.ball_joint import ball_joint
from tests.support.linkages import rssr
from tests.support.paper import GOAL, K_P, K_V

flint = pytest.importorskip("flint")

from ccpin.programs.recording import ball_joints, recorded_coordinates, recorded_tree  # noqa: E402
from ccpin.programs.recording.recorded_laws import require_sampled  # noqa: E402
from ccpin.programs.recording.recorded_mechanism import _unit_lengths  # noqa: E402
from ccpin.programs.tape import Tape  # noqa: E402
from ccpin.validated.arithmetic.balls import ball  # noqa: E402
from ccpin.validated.arithmetic.programs import in_balls  # noqa: E402
from ccpin.validated.arithmetic.series import gradients, values  # noqa: E402
from ccpin.validated.loop_equations import _is_upright, too_far_turned  # noqa: E402
from ccpin.validated.model import configurations  # noqa: E402
from ccpin.validated.model.closed_loop import _upright, recorded_loop  # noqa: E402
from tests.support.recorded import (  # noqa: E402
    MECHANISMS,
    balls,
    geared,
    numbers,
    random_state,
    with_kinds,
    x_rate,
)
from tests.support.strategies import Growth  # noqa: E402

pytestmark = pytest.mark.usefixtures("precise")


def compare(model, controller=None, seed=1, tolerance=1e-10):
    """The recorded (ẋ, q̈), energies and closure against the model's."""
    state, v = random_state(model, seed)
    loop = recorded_loop(model, controller, state.q_free)
    start = balls(loop.own.numbers(state.q_free), v)
    u = np.zeros(model.n_actuated) if controller is None else controller.torque(0.0, state, v)
    expected = np.concatenate([x_rate(loop, state, v), state.forward_dynamics(v, u)])
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(numbers(values(loop.equations.field, start)), expected, rtol=0, atol=tolerance * scale)
    np.testing.assert_allclose(numbers(values(loop.equations.energies, start)), state.energy(v), rtol=1e-10)
    np.testing.assert_allclose(numbers(values(loop.equations.closure, start)), 0.0, rtol=0, atol=1e-12)
    return loop, state, v


def test_a_single_turn_of_a_ball_as_a_coordinate():
    model = ccpin.ReducedModel(ccpin.load(rssr(), free=["all"], independent=["crank", "ball:rx"]))
    compare(model)


def curved(power=3, reference=0.2, kind="revolute", **of_wheel):
    """Gears of a polynomial of that degree."""
    return geared((0.1, 3.0, 0.2, 0.05)[: power + 1], kind, (reference, -0.1), **of_wheel)


def test_couplings_of_higher_degree():
    compare(ccpin.ReducedModel(ccpin.load(curved())))


def test_a_geared_wheel_some_turns_on():
    """Of a continuous joint the row is less whole turns: it vanishes at angles three turns on, counted from there."""
    model = ccpin.ReducedModel(ccpin.load(curved(1, 1.5, "continuous")))
    state = model.at([2.4 * np.pi])
    loop = recorded_loop(model, None, state.q_free)
    x = loop.own.numbers(state.q_free)
    assert abs(float(values(loop.equations.closure, balls(x, [0.0]))[0].mid())) < 1e-9
    later = recorded_loop(model, None, state.q_free)
    assert abs(later.own.near[1] - x[1]) < 1e-12


def test_rotors_and_springs_of_joints_that_depend():
    """Rotors, dampers and two springs on the passive joints of the RPDR, under a law that computes their pull."""
    stated = {"armature": 0.02, "damping": 0.3, "stiffness": 1.7, "spring_reference": 0.2}
    model = ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint3": stated, "joint4": {**stated, "stiffness": 0.9}}))
    compare(model, ccpin.control.PDFullGravity(model, GOAL, K_P, K_V))
    compare(model, None, 3)  # whose law cancels no spring
    lagging = ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint3": stated}))
    compare(lagging, None, 2)
    compare(lagging, NoTorque(lagging))


def test_slides_on_bodies_that_turn():
    """A slide carried round by a crank, which a link holds back."""
    growth = Growth(np.random.default_rng(7), True)
    growth.close("revolute", growth.grow("base", ["revolute", "prismatic"]), growth.grow("base", ["revolute"]))
    compare(ccpin.ReducedModel(ccpin.load(growth.drawn().description)))


@pytest.mark.parametrize("name", ["ball, independent", "ball, dependent", "floating", "planar", "single turn"])
def test_there_are_as_many_equations_as_numbers_that_depend(name):
    model = ccpin.ReducedModel(MECHANISMS[name]())
    loop = recorded_loop(model, None)
    assert (
        len(loop.equations.closure.outputs)
        == len(loop.equations.dependent)
        == loop.equations.n_x - len(loop.equations.independent)
    )


def test_plain_angles_are_no_circles(rpdr_model):
    """Nor are whole balls."""
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    loop = recorded_loop(rpdr_model, law)
    assert loop.equations.wrapped == ()
    for model, scalar, circles in (
        (ball_joint(), False, ()),
        (ccpin.ReducedModel(ccpin.load(with_kinds("slider_crank", crank="continuous"))), True, (0,)),
        (rpdr_model, True, ()),
    ):
        told = recorded_coordinates.layout_of(model.coordinates, recorded_tree.exact_joints(model.mechanism.tree))
        assert (told.scalar, told.circles) == (scalar, circles)


def test_laws_of_other_mechanisms_are_refused(rpdr_model):
    """Closures for both, masses for the one that computes with them."""
    heavier = ccpin.ReducedModel(ccpin.load("rpdr", joints={"joint1": {"armature": 0.1}}))
    other = ccpin.ReducedModel(ccpin.load(with_kinds("rpdr", joint3="continuous")))
    recorded_loop(rpdr_model, ccpin.control.PDSimpleGravity(heavier, GOAL, K_P, K_V))
    with pytest.raises(DifferentSubjectsError):
        recorded_loop(rpdr_model, ccpin.control.PDFullGravity(heavier, GOAL, K_P, K_V))
    for law in (ccpin.control.PDSimpleGravity, ccpin.control.PDFullGravity):
        with pytest.raises(DifferentSubjectsError):
            recorded_loop(rpdr_model, law(other, GOAL, K_P, K_V))


def test_only_the_law_with_constant_gravity_is_sampled(rpdr_model):
    assert require_sampled(ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)).kind == "pd"
    for law in (None, NoTorque(rpdr_model), ccpin.control.PDFullGravity(rpdr_model, GOAL, K_P, K_V), 7):
        with pytest.raises(UnsupportedMechanismError, match="sampled"):
            require_sampled(law)


def test_laws_that_are_not_known_are_refused(rpdr_model):
    """Ones that say nothing of themselves, that follow a motion, that compute more."""
    moving = ccpin.control.PointToPoint(rpdr_model, GOAL, GOAL + 0.1, 1.0)
    held = ccpin.control.Hold(rpdr_model, GOAL)
    for law in (
        Silent(), ccpin.control.PDOnlineGravity(rpdr_model, moving, K_P, K_V),
        ccpin.control.ComputedTorque(rpdr_model, held, 9.0, 6.0),
    ):  # fmt: skip
        with pytest.raises(UnsupportedMechanismError, match="know"):
            recorded_loop(rpdr_model, law)


class Silent(ccpin.control.ControlLaw):
    """A law that says nothing of itself."""

    def torque(self, t, state, v):
        return np.zeros(2)


def test_numbers_of_unit_length():
    """Of the quaternions that depend alone: ½(|p|² − 1)."""
    joint = SimpleNamespace(kind=SimpleNamespace(unit=4), x=slice(1, 6))
    tape = Tape(7)
    x = np.array(tape.inputs, dtype=object)
    (length,) = values(in_balls(tape, _unit_lengths((joint,), x, (5,))), balls([0.0, 7.0, 1.0, 2.0, 3.0, 4.0, 9.0]))
    assert float(length) == 14.5
    assert _unit_lengths((joint,), x, (4, 6)) == []
    assert _unit_lengths((SimpleNamespace(kind=SimpleNamespace(unit=2), x=slice(1, 6)),), x, (5,)) == []


def part(joint, component=None, wraps=False, whole=None, slides=(False,), first=0, size=1):
    start = joint.v.start + first
    return SimpleNamespace(
        v_free=slice(start, start + size), component=component, kind=joint.kind, wraps=wraps, whole=whole, slides=slides
    )


def test_where_coordinates_stand():
    """In the numbers and in q̇′; which are circles, and whether their rates are q̇."""
    kind = SimpleNamespace(unit=4, components=("tx", "ty", "tz", "rx", "ry", "rz"))
    floating = SimpleNamespace(x=slice(2, 9), v=slice(2, 8), kind=kind, turning_axes=True)
    plain = SimpleNamespace(x=slice(0, 2), v=slice(0, 2), kind=SimpleNamespace(unit=0), turning_axes=False)
    turning = SimpleNamespace(x=slice(9, 10), v=slice(8, 9), kind=SimpleNamespace(unit=2), turning_axes=False)
    joints = (plain, floating, turning)

    def told(*parts):
        return recorded_coordinates.layout_of(SimpleNamespace(parts=parts), joints)

    assert told(part(plain, first=1)) == ((1,), (1,), True, ())
    assert told(part(plain, first=0, size=2)) == ((0, 1), (0, 1), True, ())
    assert told(part(turning, wraps=True), part(plain, wraps=True)) == ((9, 0), (8, 0), True, (0, 1))
    assert told(part(plain), part(turning, whole=1)) == ((0, 9), (0, 8), True, (1,))
    assert told(part(floating, whole=1)) == (tuple(range(2, 9)), tuple(range(2, 8)), False, ())
    assert told(part(floating, whole=1), part(plain)).scalar is False
    assert told(part(floating, component="tx", slides=(True,))) == ((2,), (-1 - 2,), True, ())
    turns = told(part(floating, component="rx"), part(plain), part(floating, component="rz"))
    assert turns == ((10, 0, 11), (-11, 0, -12), True, ())
    assert told(part(plain), part(plain, first=1)).places == (0, 1)
    later = SimpleNamespace(x=slice(3, 7), v=slice(4, 8), kind=SimpleNamespace(unit=0), turning_axes=False)
    assert recorded_coordinates._windows(part(later, first=1, size=2), later) == ([4, 5], [5, 6])


def test_turns_of_several_balls_stand_one_after_the_other():
    """After the joints' numbers, each of its own ball and axis."""
    kind = SimpleNamespace(unit=4)
    joints = tuple(
        SimpleNamespace(x=slice(4 * k, 4 * k + 4), v=slice(3 * k, 3 * k + 3), q=slice(4 * k, 4 * k + 4), kind=kind)
        for k in (0, 1)
    )
    parts = [part(joints[1], component="rz"), part(joints[0], component="ry", first=0), part(joints[0], slides=(True,))]
    coordinates = SimpleNamespace(parts=parts, q_reference=np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.6, 0.0, 0.8]))
    found = ball_joints.turns_of(coordinates, joints, np.ones(8))
    assert [(turn.axis, turn.place) for turn in found] == [(2, 8), (1, 9)]
    np.testing.assert_allclose(found[0].ball.reference, [0.0, 0.6, 0.0, 0.8])


@pytest.mark.parametrize("kind", ["PDSimpleGravity", "PDFullGravity"])
def test_laws_with_motors_elsewhere(kind):
    """Q̈ under motors on the passive joints, and more motors than coordinates, is what the law's u makes of it."""
    for actuated in (["joint3", "joint4"], ["joint1", "joint3", "joint4"]):
        model = ccpin.ReducedModel(ccpin.load("rpdr", actuated=actuated, independent=["joint1", "joint2"]))
        law = getattr(ccpin.control, kind)(model, GOAL, K_P, K_V)
        compare(model, law)


def test_the_lyapunov_function_and_held_efforts(rpdr_model):
    """𝒱 + V(q_d), and u(q, q̇) of a sampled law, whose state holds the efforts."""
    K_p, K_v = np.array([[11.0, 2.0], [2.0, 9.0]]), np.array([[0.7, 0.1], [0.1, 0.6]])
    law = ccpin.control.PDSimpleGravity(rpdr_model, GOAL, K_p, K_v)
    loop, state, v = compare(rpdr_model, law)
    told = numbers(values(loop.equations.lyapunov, balls(loop.own.numbers(state.q_free), v)))[0]
    potential = rpdr_model.energy(law.q_d, np.zeros(2), law.q_free_d).potential
    assert told == pytest.approx(law.lyapunov(state.q, v, state.q_free) + potential, abs=1e-10)
    held = recorded_loop(rpdr_model, law, state.q_free, held=True)
    u = law.torque(0.0, state, v)
    start = [*balls(held.own.numbers(state.q_free), v), ball(0), ball(0)]
    np.testing.assert_allclose(numbers(values(held.equations.efforts, start)), u, atol=1e-11)
    other = np.array([0.3, -0.2])
    rates = numbers(values(held.equations.field, [*start[:-2], *balls(other)]))
    np.testing.assert_allclose(rates[-4:-2], state.forward_dynamics(v, other), atol=1e-9)
    np.testing.assert_array_equal(rates[-2:], 0.0)
    drift = numbers(values(held.equations.drift, [*start[:-2], *balls(other)]))
    np.testing.assert_allclose(drift[:4], state.rho @ v, atol=1e-12)
    np.testing.assert_array_equal(drift[4:], 0.0)
    slopes = [numbers(row) for row in gradients(held.equations.efforts, start)]
    np.testing.assert_allclose(np.take(slopes, [0, 2, 4, 5], axis=1), np.hstack([-K_p, -K_v]), rtol=1e-14)
    elsewhere = ccpin.ReducedModel(ccpin.load("rpdr", actuated=["joint3", "joint4"], independent=["joint1", "joint2"]))
    law = ccpin.control.PDSimpleGravity(elsewhere, GOAL, K_P, K_V)
    at_start = elsewhere.at(GOAL)
    held = recorded_loop(elsewhere, law, at_start.q_free, held=True)
    rates = numbers(values(held.equations.field, balls(held.own.numbers(at_start.q_free), [0.3, 0.1], other)))
    np.testing.assert_allclose(rates[4:6], at_start.forward_dynamics(np.array([0.3, 0.1]), other), atol=1e-8)


def test_angles_on_circles_that_a_law_reads():
    """Goals on circles are counted in the turn that is nearest, and asked to be less than half a turn away."""
    model = ccpin.ReducedModel(ccpin.load(with_kinds("slider_crank", crank="continuous")))
    law = ccpin.control.PDSimpleGravity(model, [np.cos(1.0), np.sin(1.0)], 2.0, 0.5)
    loop, state, v = compare(model, law)
    (angle,) = loop.equations.wrapped
    assert angle.place == loop.equations.independent[0]
    assert float(angle.target) == pytest.approx(1.0, abs=1e-15)
    x = loop.own.numbers(state.q_free)
    for off, told in ((3.1, True), (-3.1, True), (3.2, False), (-3.2, False)):
        x[angle.place] = 1.0 + off
        assert (too_far_turned(loop.equations, balls(x, v)) == "") is told


def test_goals_are_counted_in_the_turn_that_is_nearest():
    """Of −3 rad, seen from 3 rad, one turn on; from −2.9 as it is."""
    model = ccpin.ReducedModel(ccpin.load(with_kinds("slider_crank", crank="continuous")))
    law = ccpin.control.PDSimpleGravity(model, [np.cos(-3.0), np.sin(-3.0)], 2.0, 0.5)
    for near, target in ((3.0, 2.0 * np.pi - 3.0), (-2.9, -3.0)):
        loop = recorded_loop(model, law, model.at([np.cos(near), np.sin(near)]).q_free)
        assert float(loop.equations.wrapped[0].target) == pytest.approx(target, abs=1e-14)


def test_balls_that_are_turned_too_far():
    """Less than half a turn from the reference: w > 0, all over a box, of every ball."""
    joint = SimpleNamespace(x=slice(1, 5), number=1)
    turned = ball_joints.ball_at(joint, np.array([0.0, 0.6, 0.0, 0.8]) * 2.0, np.array([9.0, 0.0, -0.6, 0.0, -0.8]))
    np.testing.assert_allclose(numbers(_upright(turned).reference), [0.0, -0.6, 0.0, -0.8])
    straight = ball_joints.ball_at(joint, np.array([0.0, 0.6, 0.0, 0.8]), np.array([9.0, 0.0, 0.6, 0.0, 0.8]))
    np.testing.assert_allclose(numbers(_upright(straight).reference), [0.0, 0.6, 0.0, 0.8])
    across = ball_joints.ball_at(joint, np.array([0.0, 0.6, 0.0, 0.8]), np.array([9.0, 1.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(numbers(_upright(across).reference), [0.0, 0.6, 0.0, 0.8])
    box = [ball(0), ball(0), ball(0.6), ball(0), ball(0.8)]
    turned, straight = _upright(turned), _upright(straight)
    assert (turned.place, straight.place) == (1, 1)
    assert _is_upright(straight, box)
    assert not _is_upright(turned, box)
    assert not _is_upright(straight, [ball(0), ball(0), ball(0), ball(0), ball(0)])
    assert _is_upright(straight, [*box[:4], flint.arb(0.8, 1.2)])
    assert not _is_upright(straight, [*box[:4], flint.arb(0.8, 1.3)])
    loop = SimpleNamespace(wrapped=(), upright=(straight, turned))
    assert "half a turn" in too_far_turned(loop, box)
    assert too_far_turned(SimpleNamespace(wrapped=(), upright=(straight,)), box) == ""
    angles = tuple(SimpleNamespace(target=ball(0), place=k) for k in (0, 1))
    loop = SimpleNamespace(wrapped=angles, upright=())
    assert "half a turn" in too_far_turned(loop, [ball(0), ball(4)])
    assert too_far_turned(loop, [ball(0), ball(-3)]) == ""


def test_turns_are_unwound_to_the_nearest():
    for angle, near, expected in ((0.5, 0.6, 0.5), (0.5, 7.0, 0.5 + 2 * np.pi), (-3.0, 9.0, -3.0 + 4 * np.pi)):
        assert float(configurations.unwound(ball(angle), near)) == pytest.approx(expected, rel=1e-14)


def test_points_of_circles_and_quaternions():
    kind = SimpleNamespace(nq=3, unit=2)
    slide, angle = configurations.on_manifold(kind, balls([0.7, 3.0, 4.0]))
    assert float(slide) == 0.7
    assert float(angle) == pytest.approx(np.arctan2(4.0, 3.0))
    kind = SimpleNamespace(nq=5, unit=4)
    held = numbers(configurations.on_manifold(kind, balls([0.7, 1.0, 2.0, 3.0, 4.0])))
    np.testing.assert_allclose(held, [0.7, *(np.arange(1, 5) / np.sqrt(30.0))])


def test_configurations_of_numbers(rpdr_model):
    """Of a circle's angle cosine and sine; angles come back in the turn they are near."""
    model = ccpin.ReducedModel(ccpin.load(with_kinds("slider_crank", crank="continuous")))
    loop = recorded_loop(model, None)
    q_free = model.mechanism.q_reference
    x = loop.own.numbers(q_free)
    np.testing.assert_allclose(numbers(configurations.configuration(loop.own.joints, balls(x))), q_free, atol=1e-15)
    near = x + np.where(np.arange(len(x)) == loop.own.joints[0].x.start, 4 * np.pi, 0.0)
    turned = recorded_coordinates.numbers_of(loop.own.joints, q_free, near)
    np.testing.assert_allclose(turned, near, atol=1e-12)
    one = (SimpleNamespace(q=slice(0, 2), x=slice(0, 1), kind=SimpleNamespace(unit=2)),)
    for near_one in (3.1 + 4 * np.pi, 3.4 + 4 * np.pi, 4 * np.pi - 0.04):
        told = recorded_coordinates.numbers_of(one, np.array([np.cos(3.1), np.sin(3.1)]), np.array([near_one]))[0]
        assert abs(told - near_one) <= np.pi
        assert np.cos(told - 3.1) == pytest.approx(1.0)
    loop = recorded_loop(rpdr_model, None)
    x = loop.own.numbers(rpdr_model.mechanism.q_reference)
    np.testing.assert_array_equal(numbers(configurations.configuration(loop.own.joints, balls(x))), x)


def test_rotations_are_exact():
    """A quarter turn of doubles is one; a general rotation that of a unit quaternion, within rounding."""
    quarter = np.array([[1e-15, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert recorded_tree._exact_rotation(quarter)[0, 0] == 0
    tilted = np.array([[np.cos(0.3), -np.sin(0.3), 0.0], [np.sin(0.3), np.cos(0.3), 0.0], [0.0, 0.0, 1.0]])
    for off, snapped in ((0.96e-14, True), (1.04e-14, False)):
        near = np.array([[0.0, -1.0, 0.0], [1.0, off, 0.0], [0.0, 0.0, 1.0]])
        assert (recorded_tree._exact_rotation(near)[1, 1] == 0) is snapped
    small = np.array([[1.0, -1e-12, 0.0], [1e-12, 1.0, 0.0], [0.0, 0.0, 1.0]])
    for matrix in (tilted, tilted[:, [1, 2, 0]], small):
        exact = recorded_tree._exact_rotation(matrix)
        assert (exact @ exact.T == np.eye(3, dtype=int)).all()
        np.testing.assert_allclose(np.array([[float(x) for x in row] for row in exact]), matrix, atol=1e-15)
    assert recorded_tree._exact_rotation(small)[1, 0] != 0
    placement = np.eye(4)
    placement[:3, :3], placement[:3, 3] = tilted, [1.0, 2.0, 3.0]
    exact = recorded_tree.exact_placement(placement)
    assert list(exact[:3, 3]) == [1, 2, 3]
    assert (exact[:3, :3] == recorded_tree._exact_rotation(tilted)).all()
