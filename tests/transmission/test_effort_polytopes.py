"""What motors give at the joints against linear programs, closed forms and definitions."""

import numpy as np
import pytest
from scipy.optimize import linprog, minimize_scalar

from ccpin.errors import InvalidInputError
from ccpin.simulation import MotorModel
from ccpin.transmission import Swing, Transmission, compare, motor_loads, survey
from tests.support.linkage_models import FORMS, loaded, places, transmission_of


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("count", [10, pytest.param(1000, marks=pytest.mark.slow)])
def test_vertices_are_what_linear_programs_find(name, count):
    """Efforts: max d·τ over τ = Jᵀu, |u| ≤ e, J the closed form's; speeds: over |J q̇| ≤ w."""
    found, form, rng = transmission_of(name), FORMS[name], np.random.default_rng(1)
    n = found.n
    effort, speed = rng.uniform(5, 50, n), rng.uniform(1, 20, n)
    for q in places(name, rng, count):
        J, posture, way = form.jacobian(q), found.at(q), rng.normal(size=n)
        efforts, speeds = posture.torque_polytope(effort=effort, friction=0.0), posture.speed_polytope(speed=speed)
        best = linprog(-J @ way, bounds=np.stack([-effort, effort], axis=1))
        assert efforts.support(way) == pytest.approx(-best.fun, rel=1e-10)
        fastest = linprog(-way, A_ub=np.vstack([J, -J]), b_ub=np.tile(speed, 2), bounds=[(None, None)] * n)
        assert speeds.support(way) == pytest.approx(-fastest.fun, rel=1e-8)
        assert (efforts.vertices @ way).max() == pytest.approx(-best.fun, rel=1e-10)
        assert (speeds.vertices @ way).max() == pytest.approx(-fastest.fun, rel=1e-8)
        corner = efforts.vertices[np.argmax(efforts.vertices @ way)]
        assert efforts.contains(corner * (1 - 1e-9))
        assert not efforts.contains(corner * (1 + 1e-6))


def test_corners_of_a_polygon_go_round():
    """The shoelace formula over them gives the area that the determinant gives."""
    polygon = transmission_of("ankle").at([0.3, -0.1]).torque_polytope()
    x, y = polygon.vertices.T
    assert 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1)) == pytest.approx(polygon.volume, rel=1e-12)
    assert polygon.volume == pytest.approx(
        80.0**2 * abs(np.linalg.det(FORMS["ankle"].jacobian([0.3, -0.1]))), rel=1e-10
    )


def test_the_largest_box_is_the_largest():
    """Of all quotients of two sides; of a shape by its corners; and its corners are inside."""
    rng = np.random.default_rng(2)
    for q in places("ankle", rng, 10):
        polygon = transmission_of("ankle").at(q).torque_polytope(effort=rng.uniform(10, 40, 2))
        asked = np.abs(np.linalg.inv(FORMS["ankle"].jacobian(q).T))

        def area(log_ratio, asked=asked, room=polygon.upper):
            shape = np.array([np.exp(log_ratio), 1.0])
            return -np.prod(shape * (room / (asked @ shape)).min())

        best = min(minimize_scalar(area, bounds=(k, k + 1), method="bounded", options={"xatol": 1e-9}).fun
                   for k in range(-4, 4))  # fmt: skip
        box = polygon.largest_box()
        assert np.prod(box) == pytest.approx(-best, rel=1e-6)
        shaped = polygon.largest_box([2.0, 1.0])
        assert shaped[0] == pytest.approx(2 * shaped[1])
        for corners in (box, shaped):
            signs = np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
            assert all(polygon.contains(s * corners) for s in signs)
            assert not all(polygon.contains(1.0001 * s * corners) for s in signs)


def test_the_largest_ellipse_touches_every_side():
    """Of a parallelogram it touches each side in its middle (John): inside, and the support is that of the side."""
    polygon = transmission_of("ankle").at([0.2, 0.1]).torque_polytope(effort=[10.0, 30.0])
    ellipse = polygon.largest_ellipsoid()
    for normal, bound in zip(polygon.inverse, polygon.upper, strict=True):
        assert np.linalg.norm(ellipse.map.T @ normal) == pytest.approx(bound, rel=1e-12)
    assert ellipse.volume * 4 == pytest.approx(polygon.volume, rel=1e-12)


def test_which_motor_is_first_at_its_limit():
    """Along each side's normal way; the scale puts that motor on its bound, and no other beyond."""
    polygon = transmission_of("ankle").at([0.2, 0.1]).torque_polytope(effort=[10.0, 30.0])
    for way in ([1.0, 0.0], [0.0, 1.0], [-1.0, 2.0]):
        first = polygon.first_at_limit(way)
        used = np.abs(polygon.inverse @ (first.scale * np.array(way))) / polygon.upper
        assert used.max() == pytest.approx(1.0)
        assert polygon.motors[int(np.argmax(used))] == first.motor


def test_a_torque_speed_line_and_friction_move_the_bounds():
    """A DC motor gives e(1 − w/w₀) driving and e braking; friction opposes motion, and at rest both ways."""
    found, line = transmission_of("knee"), MotorModel(speeds=(0.0, 20.0), efforts=(30.0, 0.0))
    posture = found.at([0.2])
    (ratio,) = posture.jacobian[0]
    w = ratio * 5.0
    moving = posture.torque_polytope([5.0], effort=100.0, motors=line, friction=2.0)
    assert moving.upper[0] == pytest.approx(30.0 * (1 - w / 20.0) - 2.0)
    assert moving.lower[0] == pytest.approx(-30.0 - 2.0)
    back = posture.torque_polytope([-5.0], effort=100.0, motors=line, friction=2.0)
    assert (back.lower[0], back.upper[0]) == pytest.approx((-moving.upper[0], -moving.lower[0]))
    rest = posture.torque_polytope(effort=10.0, friction=2.0)
    assert (rest.lower[0], rest.upper[0]) == (-8.0, 8.0)
    stuck = posture.torque_polytope(effort=1.0, friction=2.0)
    assert (stuck.lower[0], stuck.upper[0]) == (0.0, 0.0)


def test_limits_are_the_files_behind_their_gears():
    """40 N m each of the ankle's file; unstated ones are asked for."""
    polygon = transmission_of("ankle").reference.torque_polytope()
    assert polygon.upper.tolist() == [40.0, 40.0]
    assert transmission_of("ankle").reference.speed_polytope().upper.tolist() == [15.0, 15.0]
    with pytest.raises(InvalidInputError, match="give speed="):
        transmission_of("neck").reference.speed_polytope()
    with pytest.raises(InvalidInputError, match="effort"):
        transmission_of("neck").reference.torque_polytope(effort=-1.0)


def test_efforts_are_counted_behind_the_gears():
    """Of either sign: u of ±2 behind 5 is ±10 at the joint, and what is simulated is the same motion."""
    plain, (motor,) = transmission_of("knee"), transmission_of("knee").motors
    geared = Transmission(loaded("knee", motors={motor: {"gear": -5.0, "lower": -2.0, "upper": 1.0}}))
    polygon = geared.reference.torque_polytope()
    assert (polygon.lower[0], polygon.upper[0]) == (-5.0, 10.0)
    np.testing.assert_array_equal(polygon.map, plain.reference.torque_polytope().map)
    made = [compare(t, Swing(t, [0.2], 2.0), samples=21, bandwidth=5.0) for t in (plain, geared)]
    np.testing.assert_allclose(made[1].deviation, made[0].deviation, rtol=0, atol=1e-7)
    np.testing.assert_allclose(made[1].exact, made[0].exact, rtol=0, atol=1e-10)


def test_loads_of_a_swing():
    """RMS, peaks and the motor nearest to its limit, from inverse dynamics at the same instants."""
    found = transmission_of("ankle")
    swing = Swing(found, [0.2, 0.1], 2.0, cycles=2)
    assert swing.duration == pytest.approx(1.0)
    loads = motor_loads(found, swing, samples=401)
    t = np.linspace(0.0, 1.0, 401)
    model = found.joint_model
    states = [swing.at(x) for x in t]
    u = np.array([model.inverse_dynamics(s.q, s.v, s.a) for s in states])
    np.testing.assert_allclose(loads.peak_effort, np.abs(u).max(axis=0), rtol=1e-9)
    np.testing.assert_allclose(loads.rms_effort, np.sqrt((u[:-1] ** 2).mean(axis=0)), rtol=1e-9)  # periodic: trapezoid
    assert loads.first == found.motors[int(np.argmax(np.abs(u).max(axis=0)))]
    np.testing.assert_allclose(loads.used, loads.peak_effort / 40.0, rtol=1e-12)


def test_a_survey_covers_the_range():
    """The file's limits, sampled; the least and largest felt inertias are those of its postures."""
    found = survey(transmission_of("ankle"), [-0.3, -0.2], [0.3, 0.2], count=3)
    assert (len(found.postures), found.missed) == (9, 0)
    form = FORMS["ankle"]
    expected = [0.02 * form.jacobian(p.q_joint).T @ form.jacobian(p.q_joint) for p in found.postures]
    np.testing.assert_allclose(found.rotor_inertias, expected, rtol=0, atol=1e-10)
    assert found.rcond == min(p.rcond for p in found.postures)
    stated = survey(transmission_of("ankle"), count=3)
    limits = [loaded("ankle").tree.joint(joint).stated for joint in ("pitch", "roll")]
    assert stated.upper.tolist() == [limit.upper for limit in limits]
    with pytest.raises(InvalidInputError, match="above"):
        survey(transmission_of("ankle"), [0.1, 0.1], [0.0, 0.0])
