"""References: their derivatives, their ends, and that they stay where q lives."""

import inspect
from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import ccpin
from ccpin import EndEffector
from ccpin.control import ComputedTorque, Hold, PointToPoint, Waypoints, through_points
from ccpin.errors import InvalidInputError, UnreachableTargetError, UnsupportedMechanismError
from tests.oracles import rpdr
from tests.oracles.finite_differences import derivative
from tests.support.ball_joint import ball_joint
from tests.support.paper import GOAL, START

A, B = START, GOAL
TIMES = [0.0, 0.3, 0.5, 1.1]
WAYPOINTS = np.array([START, *np.radians([[-120.0, -140.0], [-110.0, -115.0]]), GOAL])


@pytest.fixture(scope="module")
def on_circles():
    """The RPDR with joints that turn for ever: q holds (cosine, sine) pairs."""
    description = ccpin.load("rpdr").description
    joints = tuple(
        replace(joint, kind="continuous") if joint.kind == "revolute" else joint for joint in description.joints
    )
    return ccpin.ReducedModel(ccpin.load(replace(description, joints=joints)))


def circles(angles):
    return np.column_stack([np.cos(angles), np.sin(angles)]).ravel()


def check_rates(reference, coordinates, times):
    """The velocity is the rate of q_d, the acceleration that of the velocity, by finite differences to 1e-6."""
    for t in times:
        state = reference.at(t)
        rate = derivative(lambda s, t=t, q=state.q: coordinates.difference(q, reference.at(t + s).q), 1e-4)
        acceleration = derivative(lambda s, t=t: reference.at(t + s).v, 1e-4)
        np.testing.assert_allclose(rate, state.v, rtol=0, atol=1e-6 * max(1.0, np.abs(state.v).max()))
        np.testing.assert_allclose(acceleration, state.a, rtol=0, atol=1e-6 * max(1.0, np.abs(state.a).max()))


@pytest.mark.parametrize(
    "make",
    [
        lambda m: PointToPoint(m, A, B, 0.8),
        lambda m: Waypoints(m, TIMES, WAYPOINTS),
        lambda m: Waypoints(m, TIMES, WAYPOINTS, degree=3),
    ],
)
def test_velocity_and_acceleration_are_derivatives(model, make):
    """At times away from a cubic spline's knots, where its third derivative jumps."""
    reference = make(model)
    check_rates(reference, model.coordinates, np.linspace(0.04, 0.96, 11) * reference.duration)


def test_point_to_point_is_the_quintic(model):
    """q = a + (b − a)(10x³ − 15x⁴ + 6x⁵), with the peaks 15|Δ|/8T and 10|Δ|/√3T²."""
    duration = 0.8
    reference, line = PointToPoint(model, A, B, duration), B - A
    for x in (0.1, 0.37, 0.5, 0.93):
        expected = A + line * (10 * x**3 - 15 * x**4 + 6 * x**5)
        np.testing.assert_allclose(reference.at(x * duration).q, expected, atol=1e-14)
    shares = np.append(np.linspace(0.0, 1.0, 2_001), 0.5 - 3**0.5 / 6)  # the last: where q̈ is largest
    states = [reference.at(x * duration) for x in shares]
    np.testing.assert_allclose(np.max([s.v for s in states], axis=0), 15 * line / (8 * duration), rtol=1e-9)
    np.testing.assert_allclose(np.max([s.a for s in states], axis=0), 10 * line / (3**0.5 * duration**2), rtol=1e-8)


def test_ends_are_at_rest_and_held(model):
    """Before the start and after the end q_d is constant; velocity and acceleration vanish at the ends."""
    for reference in (PointToPoint(model, A, B, 0.8), Waypoints(model, TIMES, WAYPOINTS)):
        for t, q in ((-1.0, A), (0.0, A), (reference.duration, B), (reference.duration + 3.0, B)):
            state = reference.at(t)
            np.testing.assert_allclose(state.q, q, atol=1e-14)
            np.testing.assert_allclose(np.concatenate([state.v, state.a]), 0.0, atol=1e-10)
    hold = Hold(model, B).at(2.0)
    np.testing.assert_array_equal(hold.q, B)
    assert not hold.v.any()
    assert not hold.a.any()


@pytest.mark.parametrize(("degree", "smooth"), [(3, 2), (5, 4)])
def test_splines_pass_through_and_are_smooth(model, degree, smooth):
    """Every waypoint is met, and derivatives up to the second are continuous there."""
    reference = Waypoints(model, TIMES, WAYPOINTS, degree)
    for t, q in zip(TIMES, WAYPOINTS, strict=True):
        np.testing.assert_allclose(reference.at(t).q, q, atol=1e-13)
    for t in TIMES[1:-1]:
        before, after = reference.at(t - 1e-9), reference.at(t + 1e-9)
        for left, right in zip(before, after, strict=True):
            np.testing.assert_allclose(left, right, atol=1e-5)
    jump = np.abs(reference.at(1e-9).a).max()
    assert jump < 1e-4 if smooth == 4 else jump > 1.0


def test_a_spline_of_two_waypoints_is_the_quintic(model):
    """Rest to rest through nothing, degree 5 has no other choice."""
    spline, quintic = Waypoints(model, [0.0, 0.8], [A, B]), PointToPoint(model, A, B, 0.8)
    for t in np.linspace(0.0, 0.8, 9):
        for found, expected in zip(spline.at(t), quintic.at(t), strict=True):
            np.testing.assert_allclose(found, expected, atol=1e-10)


def test_degree_three_is_the_clamped_cubic_spline(model):
    """The same curve as SciPy's own CubicSpline with zero end slopes."""
    spline, cubic = Waypoints(model, TIMES, WAYPOINTS, degree=3), CubicSpline(TIMES, WAYPOINTS, bc_type="clamped")
    for t in np.linspace(0.0, 1.09, 9):
        expected = (cubic(t), cubic(t, 1), cubic(t, 2))
        for found, wanted in zip(spline.at(t), expected, strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-10)


def test_circles_are_followed_as_angles(model, on_circles):
    """On (cosine, sine) coordinates the references are those of the angles, through ±180° too."""
    angles = np.radians([[170.0, 10.0], [-170.0, 20.0], [-150.0, 0.0]])
    spline = Waypoints(on_circles, [0.0, 0.5, 1.0], [circles(row) for row in angles])
    unwrapped = Waypoints(model, [0.0, 0.5, 1.0], np.radians([[170.0, 10.0], [190.0, 20.0], [210.0, 0.0]]))
    straight = PointToPoint(on_circles, circles(angles[0]), circles(angles[1]), 1.0)
    plain = PointToPoint(model, np.radians([170.0, 10.0]), np.radians([190.0, 20.0]), 1.0)
    for t in (0.0, 0.3, 0.5, 0.8, 1.0):
        for found, expected in ((spline.at(t), unwrapped.at(t)), (straight.at(t), plain.at(t))):
            np.testing.assert_allclose(found.q, circles(expected.q), atol=1e-12)
            np.testing.assert_allclose([found.v, found.a], [expected.v, expected.a], atol=1e-9)


def test_quaternions_are_followed_along_the_geodesic():
    """Point to point on a ball joint: unit quaternions, and body rates that are their derivatives."""
    on_a_sphere = ball_joint()
    start, goal = np.array([0.0, 0.0, 0.0, 1.0]), np.array([0.5, -0.5, 0.1, 0.7])
    reference = PointToPoint(on_a_sphere, start, goal / np.linalg.norm(goal), 1.5)
    for t in (0.2, 0.7, 1.3):
        assert np.linalg.norm(reference.at(t).q) == pytest.approx(1.0, abs=1e-14)
    check_rates(reference, on_a_sphere.coordinates, (0.2, 0.7, 1.3))
    with pytest.raises(UnsupportedMechanismError, match="spherical joint 'shoulder'"):
        Waypoints(on_a_sphere, [0.0, 1.0], [start, start])


def test_end_effector_points_are_met(model):
    """A spline through tool points brings the tool there, on the branch of the reference (tip by closed form)."""
    end_effector = EndEffector(model, "link3", (rpdr.A3, 0.0, 0.0))
    points = [(0.20, 0.0, -0.45), (0.10, 0.0, -0.40), (0.1524, 0.0, -0.50)]
    reference = through_points(end_effector, [0.0, 0.5, 1.0], points)
    for t, (x, _, z) in zip([0.0, 0.5, 1.0], points, strict=True):
        q1, _, q3, _ = rpdr.sigma(reference.at(t).q, 1.0)
        tip = rpdr.A1 * np.array([np.cos(q1), np.sin(q1)]) + rpdr.A3 * np.array([np.cos(q1 + q3), np.sin(q1 + q3)])
        np.testing.assert_allclose(tip, [x, z], atol=1e-10)
    with pytest.raises(UnreachableTargetError):
        through_points(end_effector, [0.0, 1.0], [points[0], (2.0, 0.0, 0.0)])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0.0, 1.0], [A]), "2 times and 1 waypoints"),
        (([0.0, 0.0], [A, B]), "increase"),
        (([0.5, 1.0], [A, B]), "begin at 0"),
        (([0.0], [A]), "at least two"),
        (([0.0, 1.0], [A, B], 4), "degree"),
        (([0.0, 1.0], [[0.0], [1.0]]), "shape"),
    ],
)
def test_bad_splines_are_refused(model, arguments, words):
    """Times, waypoints and degree are checked."""
    with pytest.raises(InvalidInputError, match=words):
        Waypoints(model, *arguments)


def test_bad_durations_are_refused(model):
    """A motion takes time."""
    for duration in (0.0, -1.0, np.nan):
        with pytest.raises(InvalidInputError, match="duration"):
            PointToPoint(model, A, B, duration)


def test_a_model_that_comes_last_is_told_of(model):
    """The order is in the message, as it is where something else begins."""
    for arguments in ((A, B, 1.0, model), (A, model, B, 1.0)):
        with pytest.raises(InvalidInputError, match=r"PointToPoint\(model, q_start, q_goal, duration\) begins with"):
            PointToPoint(*arguments)


def test_the_docstrings_example_runs(model):
    """Its lines as they stand; the efforts are those of the law that follows the motion exactly."""
    lines = inspect.cleandoc(PointToPoint.__doc__).partition("::")[2].splitlines()
    scope = {"PointToPoint": PointToPoint, "model": model}
    exec("\n".join(line.strip() for line in lines), scope)
    law = ComputedTorque(model, scope["reference"], 100.0, 20.0)
    wanted = scope["wanted"]
    assert scope["u"] == pytest.approx(law.torque(0.2, model.at(wanted.q), wanted.v))
