"""Runs with dry friction in the compiled core: the reference's, closed forms', and what Coulomb's law says."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ccpin
from ccpin.control import PDSimpleGravity
from ccpin.control.control_law import HeldEffort
from ccpin.control.references import Waypoints
from ccpin.control.sampling import Sampling
from ccpin.control.tracking import ComputedTorque, PDOnlineGravity
from ccpin.kinematics.coordinates import component_names
from ccpin.simulation import Budget, Contact, Limits, Settling
from ccpin.simulation.integration.core_numbers import TABLEAUX, constant_law
from ccpin.simulation.integration.core_runs import _PLAIN
from ccpin.simulation.integration.run import Run
from ccpin.simulation.plant.friction import joint_friction
from ccpin.simulation.plant.stick_slip import StickSlip, friction_force
from tests.support.agreement import reference_model
from tests.support.alarms import alarm
from tests.support.carriage import carriage
from tests.support.held_loads import share_of_levels

pytestmark = pytest.mark.skipif(ccpin.backend().name != "native", reason="the compiled core is not in use")

CORE = "stepped by the compiled core"
EVERY = {"joint1": (0.03, 0.002), "joint2": (0.02, 0.001), "joint3": (0.01, 0.003), "joint4": (0.015, 0.0)}
HANGING = np.radians([-82.180, -97.823])
SWUNG = HANGING + np.radians([25.0, 10.0])
START, GOAL = np.radians((-118.0, -62.0)), np.radians((-108.0, -72.0))


def law_of(model, kind):
    """No torque, a set point, or a path there and back."""
    way = Waypoints(model, [0.0, 0.06, 0.15], [START, GOAL, START])
    return {
        "free": lambda: None,
        "set point": lambda: PDSimpleGravity(model, GOAL, 11.0, 0.6),
        "path": lambda: ComputedTorque(model, way, [100.0, 90.0], [20.0, 19.0]),
    }[kind]()


def both(model, law, q, **options):
    """The core's run and that of NumPy alone; the core took every step of it."""
    slow = reference_model(model.mechanism, model.gravity_vector)
    ours, theirs = (ccpin.simulate(one, law, q, **options) for one in (model, slow))
    assert ours.notes[0] == CORE
    assert (ours.status, ours.message, ours.evaluations) == (theirs.status, theirs.message, theirs.evaluations)
    np.testing.assert_allclose(ours.t, theirs.t, rtol=0, atol=1e-8)  # where it settles is a sample, too
    return ours, theirs


def assert_same(ours, theirs, tolerance=1e-9):
    """q to the tolerance, q̇ and q̈ to that times what events 1e-10 s apart make of it, and who is at rest."""
    for field, allowed in (("q", 1), ("q_free", 1), ("v", 10), ("a", 1e3), ("u", 1e2), ("friction", 10)):
        expected = getattr(theirs, field)
        scale = tolerance * allowed * max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(getattr(ours, field), expected, rtol=0, atol=scale, err_msg=field)
    assert np.array_equal(ours.v == 0, theirs.v == 0)


SLOW = [("free", "RK45"), ("path", "DOP853"), ("set point", "RK45"), ("set point", "DOP853")]


@pytest.mark.parametrize(
    ("kind", "method"),
    [("free", "DOP853"), ("path", "RK45"), *(pytest.param(*each, marks=pytest.mark.slow) for each in SLOW)],
)
def test_friction_of_all_joints(rpdr_model, kind, method):
    """Of driven and of passive ones, through halts and breaking loose: the reference's samples and evaluations."""
    q = SWUNG if kind == "free" else START
    options = {"friction": EVERY, "duration": 0.15, "sample_period": 0.01, "method": method}
    ours, theirs = both(rpdr_model, law_of(rpdr_model, kind), q, **options)
    assert_same(ours, theirs)


def test_sampled_laws(rpdr_model):
    """A held command is a load that jumps: at each, joints at rest are asked anew."""
    sampling = Sampling(5e-3, encoder_counts=6000, delay=1, velocity_cutoff=60.0)
    options = {"friction": EVERY, "duration": 0.1, "sample_period": 0.02, "sampling": sampling}
    assert_same(*both(rpdr_model, law_of(rpdr_model, "set point"), START, **options))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["delta", "stewart", "four_bar", "slider_crank", "planar_3rrr", "sarrus", "hexa"])
def test_every_joint_of_a_linkage(name):
    """Joints with several freedoms by component, more of them than the mechanism has freedoms, clusters on clusters."""
    model = ccpin.ReducedModel(ccpin.load(name))
    q = model.alpha(model.mechanism.q_reference)
    names = component_names(model.mechanism.tree)
    level = 0.1 * np.abs(model.gravity(q)).max() / len(names) + 1e-3
    options = {"duration": 0.2, "friction": dict.fromkeys(names, (level, 0.0)), "sample_period": 5e-3}
    assert_same(*both(model, None, q, **options))


def test_gears_and_rotors():
    """What the motors' rotors add to D is felt by joints at rest, too."""
    motors, rotors = (dict.fromkeys(("joint1", "joint2"), stated) for stated in ({"gear": 20.0}, {"armature": 4e-3}))
    model = ccpin.ReducedModel(ccpin.load("rpdr", motors=motors, joints=rotors))
    plain = ccpin.ReducedModel(ccpin.load("rpdr"))
    options = {"friction": EVERY, "duration": 0.06, "sample_period": 0.02}
    ours, theirs = both(model, None, SWUNG, **options)
    assert_same(ours, theirs)
    assert np.abs(ours.q - ccpin.simulate(plain, None, SWUNG, **options).q).max() > 1e-3


LEVEL, TWINS = 0.9, 0.3  # N, of the carriage's slide and of the one that is geared to it


def test_a_spring_with_coulombs_friction():
    """ẍ = −k x − c sign ẋ: half swings about ±c/k, which turn at nπ/ω, until |k x| ≤ c; there it stays."""
    model, k, x_0, c = carriage(), 100.0, 0.1, LEVEL + TWINS
    law = PDSimpleGravity(model, [0.0], k, 1e-12)
    motion = ccpin.simulate(model, law, [x_0], duration=1.6, friction={"x": (LEVEL, 0.0), "twin": (TWINS, 0.0)})
    assert motion.notes[0] == CORE
    omega, turns = np.sqrt(k), x_0 - 2 * np.arange(5) * c / k
    assert abs(k * turns[-1]) < c < abs(k * turns[-2])
    swing = np.minimum(np.floor(motion.t * omega / np.pi).astype(int), 4)
    side, since = (-1.0) ** swing, motion.t - swing * np.pi / omega
    sliding = swing < 4
    expected = side * ((turns[swing] - c / k) * np.where(sliding, np.cos(omega * since), 1.0) + c / k)
    assert np.abs(motion.q[:, 0] - np.where(sliding, expected, turns[-1])).max() < 1e-8
    assert (motion.v[~sliding] == 0).all()
    assert np.ptp(motion.q[~sliding]) == 0
    slow, x = motion.v[sliding, 0], motion.q[sliding, 0]
    crossed = np.flatnonzero(slow[1:-1] * slow[2:] < 0) + 1  # the sample before each turn
    phase = np.arctan2(-slow[crossed] / omega, x[crossed] + np.sign(slow[crossed]) * c / k)
    turned = motion.t[crossed] + np.mod(-phase, np.pi) / omega
    assert turned == pytest.approx(np.arange(1, 4) * np.pi / omega, abs=1e-9)
    lost = 0.5 * k * (x_0**2 - motion.q[-1, 0] ** 2)
    assert lost == pytest.approx(c * np.abs(np.diff([*turns * (-1.0) ** np.arange(5)])).sum(), rel=1e-7)
    shares = motion.friction[~sliding]
    assert shares.sum(axis=1) == pytest.approx(k * turns[-1], abs=1e-6)
    assert (np.abs(shares) <= [max(LEVEL, TWINS)] * 2).all()


def test_sticking_and_slipping_on_a_reference_that_moves():
    """A carriage after a path with PD, whose phases SciPy integrates one by one: the same instants, the same places."""
    model, k, b, c = carriage(), 150.0, 2.0, 3.0
    way = Waypoints(model, [0.0, 0.4, 0.7, 1.2], [[0.0], [0.05], [0.05], [-0.04]])
    law = PDOnlineGravity(model, way, k, b)

    def push(t, x, v):
        wanted = way.at(t)
        return float(k * (wanted.q[0] - x) + b * (wanted.v[0] - v))

    t, x, v, side, changes = 0.0, 0.0, 0.0, 0.0, []
    while t < 1.2:
        if side == 0:

            def happens(t, y, x=x):
                return abs(push(t, x, 0.0)) - c

            def rate(t, y):
                return [0.0, 0.0]
        else:

            def happens(t, y, side=side, began=t):
                return side * y[1] if t > began + 1e-9 else 1.0

            def rate(t, y, side=side):
                return [y[1], push(t, *y) - c * side]

        happens.terminal = True
        found = solve_ivp(rate, (t, 1.2), [x, v], rtol=1e-11, atol=1e-13, events=happens, max_step=5e-3)
        t, (x, v) = found.t[-1], found.y[:, -1]
        if found.status == 1:
            changes.append(t)
            v, load = 0.0, push(t, x, 0.0)
            side = np.sign(load) if side == 0 or abs(load) > c else 0.0
    assert len(changes) >= 3
    motion = ccpin.simulate(model, law, [0.0], duration=1.2, friction={"x": (c, 0.0)}, sample_period=1e-4)
    assert motion.notes[0] == CORE
    assert motion.q[-1, 0] == pytest.approx(x, abs=1e-7)
    way_it_slides = np.sign(motion.v[:, 0])
    seen = motion.t[1:][way_it_slides[1:] != way_it_slides[:-1]]
    assert len(seen) == len(changes)
    assert np.abs(seen - changes).max() <= 1e-4 + 1e-9  # to a sample
    assert (way_it_slides[motion.t > changes[1]] == 0).any()  # it sticks again


@pytest.mark.parametrize("seed", range(20))
def test_holding_is_feasibility(rpdr_model, seed):
    """A load is held exactly if forces within the levels of all four joints balance it, told by a linear program."""
    rng = np.random.default_rng(seed)
    state = rpdr_model.at(np.radians([rng.uniform(-130, -95), rng.uniform(-140, -105)]))
    rubbing = joint_friction(rpdr_model, EVERY)
    rho, level, load = state.rho[rubbing.index], rubbing.coulomb, rng.normal(size=2) * 0.06
    share = share_of_levels(rho, level, load)
    answer = ask(rpdr_model, state, {"friction": numbers_of(rpdr_model)}, rpdr_model.gravity(state.q) - load)
    assert abs(share - 1) > 1e-6
    assert answer[0] == 2
    assert (np.abs(answer[3][1]).max() == 0.0) == (share < 1)
    friction = answer[8][0][rubbing.index]
    assert (np.abs(friction) <= level * (1 + 1e-7)).all()
    if share < 1:
        np.testing.assert_allclose(rho.T @ friction, load, atol=1e-10)


@pytest.mark.parametrize("name", ["delta", "stewart"])
def test_where_many_joints_start(name):
    """Of more joints than freedoms, at rest under random loads and levels, the same ones start, and ρᵀf is the same."""
    model, rng = ccpin.ReducedModel(ccpin.load(name)), np.random.default_rng(0)
    names, q = component_names(model.mechanism.tree), model.alpha(model.mechanism.q_reference)
    started = 0
    for _ in range(40):
        state = model.at(model.coordinates.integrate(q, 0.02 * rng.normal(size=model.n)))
        levels = {
            joint: (float(level), 0.0) for joint, level in zip(names, rng.exponential(0.05, len(names)), strict=True)
        }
        u = model.gravity(state.q) + rng.normal(size=model.n_actuated) * rng.choice([0.05, 0.5, 5.0])
        rubbing = joint_friction(model, levels)
        answer = ask(model, state, {"friction": StickSlip(model, rubbing).numbers()}, u)
        assert answer is not None
        found = answer[8][0][rubbing.index]
        expected = friction_force(model, levels, state, np.zeros(model.n), u)
        rows = state.rho[rubbing.index]
        np.testing.assert_allclose(rows.T @ found, expected.generalized, rtol=0, atol=1e-9)
        assert (np.abs(found) <= rubbing.coulomb * (1 + 1e-7)).all()
        started += bool(np.abs(answer[4][0]).max() > 0)
    assert 5 < started < 35


def numbers_of(model):
    """The friction of all four joints in plain numbers, nothing decided yet."""
    return StickSlip(model, joint_friction(model, EVERY)).numbers()


def ask(model, state, changed, u=(0.0, 0.0)):
    """The core's answer to a run of 2 ms from rest under a constant effort."""
    motors, times = model.n_actuated, np.array([0.0, 2e-3])
    run = _PLAIN | {"times": times, "begin": 0.0, "until": 2e-3, "start": np.concatenate([state.q, np.zeros(model.n)])}
    run |= {"rtol": 1e-9, "atol": 1e-11, "max_step": 1e-2, "singular_rcond": 1e-7, "wrenches": None}
    run |= {"lower": [-np.inf] * motors, "upper": [np.inf] * motors, "evaluations": np.inf, "seconds": np.inf}
    return model.core.simulate(state.q_free, constant_law(np.asarray(u)), run | changed, TABLEAUX["RK45"])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("component", [0, 1, 2, 99]),
        ("component", [-1, 1, 2, 3]),
        ("coordinate", [0, 1, 2, -1]),
        ("coulomb", [0.1, 0.1, 0.1, -0.1]),
        ("viscous", [0.1, np.nan, 0.1, 0.1]),
        ("coulomb", [0.1] * 3),
        ("breakaway", [0.01] * 4),
        ("stribeck_speed", [1.0, 1.0, 0.0, 1.0]),
        ("signs", [0.0] * 5),
        ("rest", [0] * 3),
        ("halted", "text"),
        ("locked", None),
    ],
)
def test_wrong_numbers_are_refused(rpdr_model, field, value):
    """Each would read or write beyond what there is."""
    friction = numbers_of(rpdr_model)
    assert ask(rpdr_model, rpdr_model.at(START), {"friction": friction}) is not None
    with pytest.raises(ValueError, match="specification"):
        ask(rpdr_model, rpdr_model.at(START), {"friction": friction | {field: value}})
    del friction[field]
    with pytest.raises(ValueError, match="specification"):
        ask(rpdr_model, rpdr_model.at(START), {"friction": friction})


def test_a_motion_in_pieces(rpdr_model):
    """Runs, stretches and steps that follow each other carry who rests: to rounding the motion of one piece."""
    law = law_of(rpdr_model, "set point")
    whole = ccpin.simulate(rpdr_model, law, START, duration=1.0, friction=EVERY)
    moving = ccpin.Simulator(rpdr_model, law, friction=EVERY)
    moving.reset(START)
    for until in (0.101, 0.4, 1.0):
        last = moving.run(until)
        assert last.notes[0] == CORE
    assert (whole.v[-1] == 0).all()
    assert (last.v[-1] == 0).all()
    np.testing.assert_allclose(last.q[-1], whole.q[-1], rtol=0, atol=1e-8)
    at_rest = moving.sample()
    assert not at_rest.a.any()
    np.testing.assert_allclose(at_rest.friction, whole.friction[-1], rtol=0, atol=1e-6)
    held = moving.step(at_rest.u, 0.1)
    np.testing.assert_array_equal(held.q, at_rest.q)


def test_the_python_of_a_run_decides_nothing(rpdr_model, monkeypatch):
    """Where the core takes it, neither a step nor an event is looked at in Python."""
    monkeypatch.setattr(Run, "_leg", lambda *arguments: pytest.fail("the core gave up"))
    for law in (None, HeldEffort(np.array([0.1, 0.0])), law_of(rpdr_model, "set point")):
        motion = ccpin.simulate(rpdr_model, law, START, duration=0.3, friction=EVERY, sample_period=0.05)
        assert motion.notes[0] == CORE


def test_what_ends_a_run(rpdr_model):
    """Settling, and a budget that runs out, at the reference's instants; the run goes on from there."""
    law = law_of(rpdr_model, "set point")
    options = {"friction": EVERY, "sample_period": 0.02, "rtol": 1e-6, "atol": 1e-8}
    settling = Settling(GOAL, band=0.05, speed=0.05, hold=0.03)
    ours, theirs = both(rpdr_model, law, START, duration=1.0, settling=settling, **options)
    assert ours.status == "settled"
    assert ours.t[-1] < 0.9
    spent, its = both(rpdr_model, law, START, duration=1.0, budget=Budget(evaluations=200), **options)
    assert spent.status == "exhausted"
    assert_same(spent, its, 1e-7)
    assert_same(ours, theirs, 1e-7)


def test_motors_that_give_all_they_have_and_what_pushes_back(rpdr_model):
    """Saturation on the way, stops and contacts are the reference's, with friction as without."""
    hard = PDSimpleGravity(rpdr_model, GOAL, 400.0, 5.0)
    options = {"duration": 0.03, "friction": EVERY, "sample_period": 0.01}
    motion = ccpin.simulate(rpdr_model, hard, START, **options)
    slow = reference_model(rpdr_model.mechanism, rpdr_model.gravity_vector)
    assert motion.notes[0] != CORE
    np.testing.assert_allclose(motion.q, ccpin.simulate(slow, hard, START, **options).q, rtol=0, atol=1e-9)
    link = sorted(rpdr_model.mechanism.tree.attachments)[1]
    law = law_of(rpdr_model, "set point")
    for met in ({"limits": Limits(position="stop")}, {"contacts": [Contact(link, height=-10.0)]}):
        found = ccpin.simulate(rpdr_model, law, START, **options, **met)
        assert "without any of them the core steps" in found.notes[0]


def test_coordinates_are_left_with_friction():
    """A crank goes round through its rocker's ends, where others measure the motion; friction alone takes energy."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    model = ccpin.ReducedModel(ccpin.load("four_bar", independent=[model.mechanism.tree.names[-1]]))
    q = model.alpha(model.mechanism.q_reference)
    names = component_names(model.mechanism.tree)
    motion = ccpin.simulate(model, None, q, [4.0], duration=1.0, friction=dict.fromkeys(names, (2e-3, 1e-4)))
    assert motion.notes[0] == CORE
    assert motion.changes > 0
    first, *_, last = ((state, v) for state, v, _ in motion.states(model))
    energy = [sum(state.energy(v)) for state, v in (first, last)]
    power = (motion.friction * motion.v_free).sum(axis=1)
    assert (power <= 1e-9).all()
    assert energy[0] - energy[1] == pytest.approx(-np.trapezoid(power, motion.t), rel=1e-3)


@pytest.mark.parametrize("kind", ["free", "path"])
def test_ctrl_c(rpdr_model, kind):
    """A long run is broken off where it has come to, who rests included, and goes on from there."""
    moving = ccpin.Simulator(rpdr_model, law_of(rpdr_model, kind), friction=EVERY)
    moving.reset(SWUNG if kind == "free" else START)
    with alarm(0.3):
        broken = moving.run(1e6, sample_period=1e3)
    assert (broken.status, type(broken.cause)) == ("interrupted", KeyboardInterrupt)
    assert 0.0 < broken.t[-1] == moving.t < 1e6
    assert (broken.v[-1] == 0).all()
    on = moving.run(moving.t + 1.0, sample_period=0.5)
    assert on.status == "finished"
    np.testing.assert_array_equal(on.q[-1], broken.q[-1])
