"""Every mechanism of the zoo against its closed form: counts, σ, ρ and ρ̇, and a move under PD control."""

from functools import cache
from importlib import import_module

import numpy as np
import pinocchio as pin
import pytest

import ccpin
from tests.oracles import bennett, delta, four_bar, sarrus, slider_crank
from tests.oracles.geometry import wrap
from tests.support.long_cases import later

ZOO = ("four_bar", "slider_crank", "planar_3rrr", "delta", "stewart", "hexa", "bennett", "sarrus")
FOURTH_ORDER = {-2: (1.0, -1.0), -1: (-8.0, 16.0), 0: (0.0, -30.0), 1: (8.0, 16.0), 2: (-1.0, -1.0)}  # /12

every_mechanism = pytest.mark.parametrize("name", ZOO)


@cache
def reduced_model(name):
    return ccpin.ReducedModel(ccpin.load(name))


def oracle_of(name):
    return import_module(f"oracles.{name}")


def vector(mechanism, displacements):
    """Displacements by joint name as a configuration of the free system, every joint named once."""
    names = list(mechanism.pin_model.names)[1:]
    assert sorted(names) == sorted(displacements)
    q_free = np.empty(mechanism.nq)
    for name, index in zip(names, list(mechanism.pin_model.idx_qs)[1:], strict=True):
        q_free[index] = displacements[name]
    return q_free


def select(mechanism, displacements):
    return np.array([displacements[name] for name in mechanism.independent])


def difference(a, b):
    """Difference a − b with angles compared modulo 2π (slides move far less than π metres)."""
    return wrap(a - b)


def motion_along(mechanism, oracle, p, direction):
    """q′, q̇′, q̈′ of the closed form along p + s·direction at s = 0, by fourth-order differences."""
    step = 1e-3
    q_free = vector(mechanism, oracle.configuration(p))
    v_free, a_free = np.zeros(mechanism.nq), np.zeros(mechanism.nq)
    for k, (first, second) in FOURTH_ORDER.items():
        moved = vector(mechanism, oracle.configuration(p + k * step * direction))
        v_free += first * difference(moved, q_free) / (12.0 * step)
        a_free += second * difference(moved, q_free) / (12.0 * step**2)
    return q_free, v_free, a_free


@every_mechanism
def test_counts(name):
    """n′, n and the independent joints are those of the geometry, whatever the number of closure rows."""
    mechanism, oracle = reduced_model(name).mechanism, oracle_of(name)
    assert mechanism.n_free == oracle.N_FREE
    assert mechanism.n == oracle.N_FREE - oracle.RANK == len(oracle.INDEPENDENT) == len(oracle.BOX)
    assert mechanism.mobility.rank == oracle.RANK
    assert mechanism.mobility.idle == ()
    assert sorted(mechanism.independent) == sorted(mechanism.actuated) == sorted(oracle.INDEPENDENT)


@every_mechanism
def test_another_reader_sees_the_same_tree(name):
    """Pinocchio's own URDF parser skips the loops and finds the same open tree, motor inertia aside."""
    mechanism = reduced_model(name).mechanism
    ours, theirs = mechanism.pin_model, pin.buildModelFromUrdf(str(mechanism.description.source))
    order = [list(theirs.names).index(joint) - 1 for joint in list(ours.names)[1:]]
    q_theirs = np.empty(theirs.nq)
    q_theirs[order] = mechanism.q_reference
    mass = pin.crba(ours, ours.createData(), mechanism.q_reference) - np.diag(ours.armature)
    expected = pin.crba(theirs, theirs.createData(), q_theirs)[np.ix_(order, order)]
    np.testing.assert_allclose(mass, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("points", later(100, 500))
@every_mechanism
def test_sigma_is_the_closed_form(name, points):
    """σ from the reference equals the geometric solution in the file's assembly mode, all over its box."""
    model, oracle = reduced_model(name), oracle_of(name)
    rng = np.random.default_rng(7)
    for p in rng.uniform(*oracle.BOX.T, (points, len(oracle.BOX))):
        displacements = oracle.configuration(p)
        found = model.sigma(select(model.mechanism, displacements))
        expected = vector(model.mechanism, displacements)
        np.testing.assert_allclose(difference(found, expected), 0.0, rtol=0, atol=1e-10)


@every_mechanism
def test_velocity_and_acceleration_maps(name):
    """q̇′ = ρ q̇ and q̈′ = ρ q̈ + ρ̇ q̇ along curves of the closed form."""
    model, oracle = reduced_model(name), oracle_of(name)
    rng = np.random.default_rng(8)
    rows = [list(model.mechanism.pin_model.names).index(joint) - 1 for joint in model.mechanism.independent]
    for p in rng.uniform(*oracle.BOX.T, (5, len(oracle.BOX))):
        direction = rng.normal(size=len(p)) * np.ptp(oracle.BOX, axis=1) / 4.0
        q_free, v_free, a_free = motion_along(model.mechanism, oracle, p, direction)
        rho, rho_dot = model.rho(q_free), model.rho_dot(q_free, v_free)
        np.testing.assert_allclose(rho @ v_free[rows], v_free, rtol=0, atol=1e-8)
        np.testing.assert_allclose(rho @ a_free[rows] + rho_dot @ v_free[rows], a_free, rtol=0, atol=1e-6)


@every_mechanism
def test_set_point_control(name):
    """PD with simple gravity compensation drives the closed mechanism to its goal within a second.

    K_p = 900 D(q_d) and K_v = 60 D(q_d) give critical damping at 30 rad/s, stiffer than gravity everywhere; a
    linear system would have less than 1e-11 of its initial error left after 1 s.
    """
    model, oracle = reduced_model(name), oracle_of(name)
    goal = select(model.mechanism, oracle.configuration(oracle.BOX @ [0.3, 0.7]))
    start = model.alpha(model.mechanism.q_reference)
    inertia = model.terms(goal, np.zeros_like(goal)).D
    controller = ccpin.control.PDSimpleGravity(model, goal, 900.0 * inertia, 60.0 * inertia)
    trajectory = ccpin.simulate(model, controller, start, duration=1.0)
    assert trajectory.t[-1] == pytest.approx(1.0), trajectory.message
    assert np.max(trajectory.closure_error) <= 1e-10
    assert np.linalg.norm(trajectory.q[-1] - goal) <= 1e-4 * np.linalg.norm(start - goal)


def test_four_bar_of_the_textbook():
    """Norton's worked example: crank at 40°, coupler at 20.30° and rocker at 57.33° in the open mode."""
    angles = np.rad2deg(four_bar.coupler_and_rocker(np.deg2rad(40.0)))
    np.testing.assert_allclose(angles, [20.30, 57.33], rtol=0, atol=6e-3)


def test_slider_crank_of_the_textbook():
    """Norton's worked example: crank at 60°, rod at 152.91° − 180° and slider at 126.84 mm."""
    solution = slider_crank.sigma(np.deg2rad(60.0))
    assert np.rad2deg(solution["rod"] + solution["crank"]) == pytest.approx(152.91 - 180.0, abs=6e-3)
    assert solution["slider"] == pytest.approx(0.12684, abs=6e-6)


def test_delta_of_the_report():
    """Williams' examples: arms (47.5, −11.6, 21.4)° reach (0.3, 0.5, −1.1) m, arms at −20.5° reach z = −0.9 m.

    His first motor stands on −y, ours on +x; his angles are printed to 0.05°.
    """
    x, y, z = delta.forward(np.deg2rad([47.5, -11.6, 21.4]))
    np.testing.assert_allclose([y, -x, z], [0.3, 0.5, -1.1], rtol=0, atol=1e-3)
    np.testing.assert_allclose(delta.forward(np.deg2rad([-20.5] * 3)), [0.0, 0.0, -0.9], rtol=0, atol=1e-3)


def test_bennett_lengths_and_twists():
    """Bennett's condition a/sin α = b/sin β holds, and θ₁ = 90° gives θ₂ = 120°."""
    (a, b), (alpha, beta) = bennett.LENGTHS, bennett.TWISTS
    assert a / np.sin(alpha) == pytest.approx(b / np.sin(beta), rel=1e-15)
    assert bennett.sigma(np.pi / 2.0)["joint2"] == pytest.approx(2.0 * np.pi / 3.0, rel=1e-15)


def test_sarrus_platform_moves_straight():
    """The platform rises on the vertical line through its hinge, level, to 2 l sin θ."""
    model = reduced_model("sarrus")
    tree = model.mechanism.pin_model
    data = tree.createData()
    joint = tree.getJointId("platform_a")
    for lower in np.linspace(*sarrus.BOX[0], 9):
        pin.forwardKinematics(tree, data, model.sigma(np.array([lower])))
        placement = data.oMi[joint]
        expected = [sarrus.HALF_WIDTH, 0.0, sarrus.height(lower)]
        np.testing.assert_allclose(placement.translation, expected, rtol=0, atol=1e-12)
        np.testing.assert_allclose(placement.rotation, np.eye(3), rtol=0, atol=1e-12)
