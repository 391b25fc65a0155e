"""Stribeck's friction: hunting against a motion put together mode by mode, rest, slip, energy, and the core."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ccpin
from ccpin.control.references import Waypoints
from ccpin.control.tracking import ComputedTorque
from ccpin.errors import InvalidInputError
from ccpin.simulation.plant.friction import joint_friction
from ccpin.simulation.plant.stick_slip import friction_force
from tests.support.agreement import reference_model
from tests.support.backends import same_on_both
from tests.support.carriage import carriage

COULOMB, VISCOUS, BREAKAWAY, SPEED = 1.0, 0.05, 1.6, 0.05
STIFFNESS, DRAWN, LONG = 160.0, 0.1, 1.9
LAW = (COULOMB, VISCOUS, BREAKAWAY, SPEED)
EVERY = {
    "joint1": (0.03, 0.002, 0.05, 0.3),
    "joint2": (0.02, 0.001, 0.02, 0.1),
    "joint3": (0.01, 0.003, 0.03, 0.2),
    "joint4": (0.0, 0.0, 0.015, 1.0),
}
SWUNG = np.radians([-82.180, -97.823]) + np.radians([25.0, 10.0])


def hunting(until):
    """A mass of 1 kg on a spring whose end is drawn at constant speed: instants at which it slips and halts, q there.

    It sticks till the spring has the breakaway level, then slips, one way only, till it stands.
    """
    t, q, found = 0.0, 0.0, []
    while (begin := q / DRAWN + BREAKAWAY / STIFFNESS / DRAWN) < until:

        def slipping(t, y):
            level = COULOMB + (BREAKAWAY - COULOMB) * np.exp(-((y[1] / SPEED) ** 2))
            return [y[1], STIFFNESS * (DRAWN * t - y[0]) - VISCOUS * y[1] - level]

        def standing(t, y):
            return y[1] if t > begin + 1e-2 else 1.0

        standing.terminal = True
        run = solve_ivp(slipping, (begin, begin + 5.0), [q, 0.0], "DOP853", rtol=1e-11, atol=1e-13, events=standing)
        t, q = run.t[-1], run.y[0, -1]
        found.append((begin, t, q))
    return np.array(found)


@same_on_both
def test_a_mass_on_a_drawn_spring_hunts():
    """Instants and places of rest are those of the motion put together mode by mode, and it is periodic."""
    wanted = hunting(LONG)
    assert len(wanted) >= 4
    spring = lambda t, q, v: np.array([STIFFNESS * (DRAWN * t - q[0])])  # noqa: E731
    options = {"duration": LONG, "sample_period": 1e-2, "rtol": 1e-9, "atol": 1e-11, "friction": {"x": LAW}}
    motion = ccpin.simulate(carriage(), spring, [0.0], **options)
    assert motion.status == "finished"
    resting = motion.v[:, 0] == 0.0
    for (begin, halt, q), (further, *_) in itertools.pairwise(wanted):
        assert not resting[(motion.t > begin + 0.01) & (motion.t < halt)].any()
        still = (motion.t > halt + 1e-3) & (motion.t < further - 1e-3)
        assert still.any()
        assert resting[still].all()
        np.testing.assert_allclose(motion.q[still, 0], q, rtol=0, atol=1e-6)
    travelled = np.diff(wanted[:, 2])
    np.testing.assert_allclose(travelled[1:], travelled[1], rtol=1e-6)  # a limit cycle
    coulomb = ccpin.simulate(carriage(), spring, [0.0], **options | {"friction": {"x": (COULOMB, VISCOUS)}})
    assert (coulomb.v[coulomb.t > 0.3, 0] > 0.0).all()  # which Coulomb's level alone has not


@pytest.mark.parametrize("share", [0.95, 1.05])
def test_it_rests_under_less_than_breakaway_and_slips_under_more(share):
    """Above Coulomb's level and below breakaway it does not move by a bit; let go it slides on under less."""
    push = share * BREAKAWAY
    motion = ccpin.simulate(carriage(), lambda t, q, v: np.array([push]), [0.0], duration=0.5, friction={"x": LAW})
    if share < 1.0:
        assert not motion.q.any()
        assert motion.friction.sum(axis=1) == pytest.approx(-push, abs=1e-12)
        return
    assert (np.diff(motion.v[:, 0]) > 0.0).all()
    assert motion.a[0, 0] == pytest.approx(push - BREAKAWAY, rel=1e-6)
    level = COULOMB + (BREAKAWAY - COULOMB) * np.exp(-((motion.v[:, 0] / SPEED) ** 2))
    assert motion.a[:, 0] == pytest.approx(push - level - VISCOUS * motion.v[:, 0], abs=1e-9)


@same_on_both
def test_energy_lost_is_its_work(rpdr_model):
    """Of all four joints, through halts: f·q̇′ ≤ 0 at every sample, E(0) − E(t) = −∫ Σ f_j q̇′_j dt, f_j by its law."""
    motion = ccpin.simulate(rpdr_model, None, SWUNG, duration=3.0, friction=EVERY, rtol=1e-8, atol=1e-10)
    rates, names = motion.v_free, rpdr_model.mechanism.joints.names
    c, b, s, v_s = np.array([EVERY[name] for name in names]).T
    power = rates**2 @ b + (np.abs(rates) * (c + (s - c) * np.exp(-((rates / v_s) ** 2)))).sum(axis=1)
    told = -(motion.friction * rates).sum(axis=1)
    assert told.min() >= 0.0
    np.testing.assert_allclose(told, power, rtol=0, atol=1e-6)
    energy = [sum(rpdr_model.energy(motion.q[k], motion.v[k], motion.q_free[k])) for k in (0, -1)]
    assert energy[0] - energy[1] > 0.05
    assert energy[0] - energy[1] == pytest.approx(np.trapezoid(power, motion.t), rel=1e-4)
    assert (motion.v[-1] == 0.0).all()


@pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")
@pytest.mark.parametrize(("kind", "method"), [("free", "RK45"), pytest.param("path", "DOP853", marks=pytest.mark.slow)])
def test_the_core_has_the_references_steps(rpdr_model, kind, method):
    """Samples and evaluations of a run through halts and breaking loose."""
    path = Waypoints(rpdr_model, [0.0, 0.06, 0.15], [SWUNG, SWUNG + 0.15, SWUNG])
    law = ComputedTorque(rpdr_model, path, [100.0, 90.0], [20.0, 19.0]) if kind == "path" else None
    slow = reference_model(rpdr_model.mechanism, rpdr_model.gravity_vector)
    options = {"duration": 0.15, "sample_period": 0.01, "method": method, "friction": EVERY}
    ours, theirs = (ccpin.simulate(one, law, SWUNG, **options) for one in (rpdr_model, slow))
    assert ours.notes[0] == "stepped by the compiled core"
    assert (ours.status, ours.evaluations) == (theirs.status, theirs.evaluations)
    assert np.array_equal(ours.v == 0.0, theirs.v == 0.0)
    for field, allowed in (("q", 1e-9), ("v", 1e-8), ("friction", 1e-8)):
        np.testing.assert_allclose(getattr(ours, field), getattr(theirs, field), rtol=0, atol=allowed, err_msg=field)


def test_equal_levels_are_coulombs(rpdr_model):
    """s = c is the motion without the effect, bit for bit; a fall of 0.86 (s − c)/v_s at most."""
    plain = {name: levels[:2] for name, levels in EVERY.items()}
    flat = {name: (c, b, c, 0.3) for name, (c, b) in plain.items()}
    one, other = (ccpin.simulate(rpdr_model, None, SWUNG, duration=0.1, friction=each) for each in (plain, flat))
    np.testing.assert_array_equal(one.q, other.q)
    found = joint_friction(rpdr_model, EVERY)
    rates = np.linspace(0.0, 2.0, 4001)[:, None] * np.ones(4)
    steepest = np.abs(np.diff(found.level(rates), axis=0)).max(axis=0) / (rates[1, 0] - rates[0, 0])
    bound = np.sqrt(2.0 / np.e) * (found.breakaway - found.coulomb) / found.stribeck_speed
    assert (steepest <= bound * (1.0 + 1e-9)).all()
    assert steepest[0] == pytest.approx(bound[0], rel=1e-2)


def test_what_a_description_states_is_what_simulations_take(rpdr_model):
    """Joints' breakaway levels and Stribeck speeds; four arrays are those of the independent joints."""
    stated = {
        name: dict(zip(("friction", "breakaway", "stribeck_speed"), (c, s, w), strict=True))
        for name, (c, _, s, w) in EVERY.items()
    }
    mechanism = ccpin.load("rpdr", joints=stated)
    found, told = (
        joint_friction(mechanism),
        joint_friction(mechanism, {n: (c, 0.0, s, w) for n, (c, _, s, w) in EVERY.items()}),
    )
    for name in ("coulomb", "viscous", "breakaway", "stribeck_speed"):
        at = [found.names.index(each) for each in told.names if each != "joint2"]
        to = [k for k, each in enumerate(told.names) if each != "joint2"]
        np.testing.assert_array_equal(getattr(found, name)[at], getattr(told, name)[to])
    four = joint_friction(mechanism, (0.1, 0.0, [0.2, 0.3], 0.5))
    assert four.names == mechanism.independent
    np.testing.assert_array_equal(four.breakaway, [0.2, 0.3])
    held = friction_force(
        rpdr_model, {"joint1": (0.1, 0.0, 50.0, 0.1), "joint2": (0.1, 0.0, 50.0, 0.1)}, SWUNG, [0.0, 0.0], [0.0, 0.0]
    )
    assert held.generalized == pytest.approx(rpdr_model.gravity(SWUNG), abs=1e-12)


@pytest.mark.parametrize(
    ("friction", "words"),
    [
        ({"joint1": (0.2, 0.0, 0.1, 0.1)}, "breakaway must not be below coulomb"),
        ({"joint1": (0.2, 0.0, 0.3, 0.0)}, "the Stribeck speed positive"),
        ({"joint1": (0.2, 0.0, 0.3)}, "or four"),
        ((0.1, 0.0, [0.2], 0.1), "breakaway has shape"),
    ],
)
def test_bad_stribeck_friction_is_named(rpdr_model, friction, words):
    with pytest.raises(InvalidInputError, match=words):
        joint_friction(rpdr_model, friction)
