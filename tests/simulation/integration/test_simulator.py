"""The stepper against closed forms, against `simulate`, and against itself however its way is cut up."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import ccpin
from ccpin.control import Measurement, PDSimpleGravity, Sampling, TorqueFunction
from ccpin.control.control_law import Delayed, NoTorque
from ccpin.errors import InvalidInputError
from ccpin.simulation import Budget, Event
from tests.oracles import rpdr as oracle
from tests.support.agreement import reference_model
from tests.support.backends import same_on_both
from tests.support.limp import Limp
from tests.support.long_cases import later
from tests.support.paper import FRICTION, GOAL, K_P, K_V, START

POSE = np.radians([-95.0, -105.0])
BENCH = Sampling(1e-3, encoder_counts=4096, velocity_cutoff=100.0, saturation=12.0, delay=1)


@pytest.fixture(scope="module")
def law(rpdr_model):
    return PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)


@pytest.fixture(scope="module", params=["core", pytest.param("numpy", marks=[same_on_both, pytest.mark.slow])])
def either_model(request, rpdr_model):
    """The RPDR as it computes by default, and with NumPy alone, which CCPIN_BACKEND=numpy asks by default."""
    return rpdr_model if request.param == "core" else reference_model(rpdr_model.mechanism)


def weight(q):
    """g(q) (25) by the closed forms."""
    q_free = oracle.sigma(q, 1)
    return oracle.rho(q_free).T @ oracle.gravity(q_free)


def oracle_motion(q, v, effort, duration):
    """(q, q̇) after constant efforts, from the closed forms."""

    def derivative(t, x):
        D, C, g = oracle.reduced_terms(oracle.sigma(x[:2], 1), x[2:])
        return np.concatenate([x[2:], np.linalg.solve(D, effort - C @ x[2:] - g)])

    found = solve_ivp(derivative, (0.0, duration), np.concatenate([q, v]), method="DOP853", rtol=1e-12, atol=1e-13)
    return found.y[:2, -1], found.y[2:, -1]


# Nothing is stepped over.

HOLD = weight(POSE)
PULSE = np.array([5.0, 0.0])


def pulsed(t, q, v):
    """What holds the robot at rest, and 5 N m more for 50 ms."""
    return HOLD + PULSE * (0.5 <= t < 0.55)


@cache
def after_the_pulse():
    """q at 0.6 s, by the closed forms from switch to switch."""
    q, v = oracle_motion(POSE, np.zeros(2), HOLD + PULSE, 0.05)
    return oracle_motion(q, v, HOLD, 0.05)[0]


@pytest.mark.parametrize("sample_period", [1e-3, 0.6])
@pytest.mark.parametrize("times", [None, [0.5, 0.55]])
@pytest.mark.parametrize("method", ["LSODA", *later("RK45", "DOP853")])
def test_a_pulse_is_not_stepped_over(rpdr_model, sample_period, times, method):
    """From rest, whether the law says when it switches or not, and however the motion is sampled."""
    motion = ccpin.simulate(
        rpdr_model, TorqueFunction(pulsed, times), POSE, duration=0.6, sample_period=sample_period, method=method
    )
    assert motion.status == "finished"
    assert np.abs(motion.q[-1] - after_the_pulse()).max() < 1e-6


@same_on_both
def test_a_push_is_not_stepped_over(rpdr_model):
    """So it is with a wrench on a link that is a function of time."""

    def push(t, state, v):
        return {"link1": [0.0, 0.0, 0.0, 0.0, 5.0 * (0.5 <= t < 0.55), 0.0]}

    motions = [
        ccpin.simulate(
            rpdr_model, lambda t, q, v: HOLD, POSE, duration=0.6, wrenches=push, sample_period=period, max_step=longest
        )
        for period, longest in ((0.6, None), (1e-3, None), (1e-3, 1e-3))
    ]
    assert all(np.abs(motion.q[-1] - motions[-1].q[-1]).max() < 1e-7 for motion in motions)
    assert motions[0].evaluations == motions[1].evaluations
    assert np.abs(motions[0].q[-1] - POSE).max() > 1e-4


@same_on_both
@pytest.mark.parametrize("sample_period", later(0.6, 0.02, 1e-3))
def test_friction_lets_go_whenever_it_is_sampled(rpdr_model, sample_period):
    """A load above the breakaway level for 50 ms moves the robot by the same amount for every sample period."""

    def load(t, q, v):
        return HOLD + np.array([0.8, 0.0]) * (0.2 <= t < 0.25)

    options = {"duration": 0.6, "friction": FRICTION}
    named = ccpin.simulate(rpdr_model, TorqueFunction(load, [0.2, 0.25]), POSE, max_step=1e-3, **options)
    motion = ccpin.simulate(rpdr_model, load, POSE, sample_period=sample_period, **options)
    assert motion.q[-1, 0] - POSE[0] > 1e-2
    assert np.abs(motion.q[-1] - named.q[-1]).max() < 1e-7


@pytest.mark.parametrize("bench", [{}, {"friction": FRICTION}, {"friction": FRICTION, "sampling": BENCH}])
def test_output_changes_nothing(either_model, law, bench):
    """The end of a motion is the same, bit for bit, however often it is sampled; common samples agree."""
    law = PDSimpleGravity(either_model, GOAL, K_P, K_V)
    fine, coarse = (
        ccpin.simulate(either_model, law, START, duration=0.1, sample_period=period, **bench) for period in (1e-3, 0.02)
    )
    assert np.array_equal(fine.q[-1], coarse.q[-1])
    assert np.array_equal(fine.v[-1], coarse.v[-1])
    assert fine.evaluations == coarse.evaluations
    np.testing.assert_allclose(fine.q[::20], coarse.q, rtol=0, atol=1e-12)


# One motion, however it is cut up.


@pytest.mark.parametrize("sample_period", [1e-3, 0.05])
def test_steps_with_u_held_are_the_closed_forms(either_model, sample_period):
    """Ten steps under efforts that change at each, against the closed forms from step to step."""
    simulator = ccpin.Simulator(either_model)
    sample = simulator.reset(START)
    q, v = START, np.zeros(2)
    for k in range(10):
        u = weight(START) + 0.5 * np.array([np.sin(k), np.cos(2 * k)])
        sample = simulator.step(u, 0.01)
        q, v = oracle_motion(q, v, u, 0.01)
        assert sample.t == pytest.approx(0.01 * (k + 1), abs=1e-15)
        assert sample.q == pytest.approx(q, abs=1e-9)
        assert sample.v == pytest.approx(v, abs=1e-7)
        D, C, g = oracle.reduced_terms(oracle.sigma(q, 1), v)
        assert sample.a == pytest.approx(np.linalg.solve(D, u - C @ v - g), abs=1e-5)
        assert np.array_equal(sample.u, u)
    assert simulator.stop is None
    assert sample.closure_error <= 1e-10


@pytest.mark.parametrize("name", ["delta", "stewart", "slider_crank"])
def test_the_cores_steps_are_the_references(name):
    """The same steps on both backends, also where motors are not the independent joints and q is on a manifold."""
    mechanism = ccpin.load(name)
    ends = []
    for model in (ccpin.ReducedModel(mechanism), reference_model(mechanism)):
        simulator = ccpin.Simulator(model, friction={})
        simulator.reset(model.alpha(mechanism.q_reference), near=mechanism.q_reference)
        for k in range(5):
            sample = simulator.step(0.1 * np.cos(k + np.arange(model.n_actuated)), 2e-3)
        ends.append(sample)
        assert simulator.evaluations > 30
    for ours, theirs in zip(*ends, strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("bench", [{}, {"friction": FRICTION}, {"friction": FRICTION, "sampling": BENCH}])
def test_simulate_is_the_stepper(rpdr_model, law, bench):
    """A motion advanced in pieces that its law knows nothing of is the motion in one run, to the tolerance."""
    whole = ccpin.simulate(rpdr_model, law, START, duration=0.1, sample_period=0.01, **bench)
    simulator = ccpin.Simulator(rpdr_model, law, **bench)
    simulator.reset(START)
    pieces = [simulator.advance(t) for t in whole.t[1:]]
    np.testing.assert_allclose([piece.q for piece in pieces], whole.q[1:], rtol=0, atol=1e-8)
    np.testing.assert_allclose([piece.u for piece in pieces][:-1], whole.u[1:-1], rtol=0, atol=1e-5)
    np.testing.assert_allclose([piece.friction for piece in pieces], whole.friction[1:], rtol=0, atol=1e-5)


def test_steps_through_the_bench(rpdr_model):
    """A command given to the stepper passes through saturation and delay as a law's does."""
    simulator = ccpin.Simulator(rpdr_model, sampling=Sampling(1e-3, saturation=3.0, delay=2))
    simulator.reset(START)
    motors = [simulator.step([float(k), 10.0], 1e-3).u for k in range(1, 6)]
    assert np.array_equal(motors, [[0, 0], [0, 0], [1, 3], [2, 3], [3, 3]])


def test_laws_and_steps_may_follow_each_other(rpdr_model, law):
    """Time, friction and counts run on through step, advance and run, and a law replaced acts from there."""
    simulator = ccpin.Simulator(rpdr_model, law)
    simulator.reset(START)
    simulator.step([1.0, 1.0], 0.01)
    simulator.advance(0.05)
    motion = simulator.run(0.1)
    simulator.law = None
    last = simulator.advance(0.11)
    assert (motion.t[0], motion.t[-1], last.t) == (0.05, 0.1, 0.11)
    assert np.array_equal(last.u, np.zeros(2))
    assert simulator.evaluations > motion.evaluations


@pytest.mark.parametrize("bench", [{}, {"friction": FRICTION, "sampling": BENCH}])
def test_what_it_carries_can_be_carried_on(rpdr_model, law, bench):
    """Another simulator goes on from the first one's memory to the same bits."""
    first = ccpin.Simulator(rpdr_model, law, **bench)
    first.reset(START)
    first.advance(0.05)
    memory = first.memory()
    first.recall(memory)
    ends = [first.run(0.1)]
    second = ccpin.Simulator(rpdr_model, law, **bench)
    second.recall(memory)
    ends.append(second.run(0.1))
    assert np.array_equal(ends[0].q, ends[1].q)
    assert np.array_equal(ends[0].u, ends[1].u)


def test_samples_cannot_spoil_the_motion(rpdr_model):
    """What a step returns cannot be written to, or is a copy."""
    simulator = ccpin.Simulator(rpdr_model)
    simulator.reset(START)
    sample = simulator.step([1.0, 1.0], 1e-3)
    for array in (sample.q, sample.v, sample.q_free):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_stepping_into_a_singularity_says_so():
    """A Delta that falls from rest stretches its arms: the last sample is where it stopped; `stop` stays."""
    model = ccpin.ReducedModel(ccpin.load("delta"))
    simulator = ccpin.Simulator(model)
    simulator.reset(model.alpha(model.mechanism.q_reference))
    for _ in range(250):
        sample = simulator.step(np.zeros(3), 2e-3)
        if simulator.stop is not None:
            break
    assert simulator.stop.status == "singular"
    loops = np.linalg.svd(model.parametrization.constraints.value(sample.q_free).jacobian, compute_uv=False)
    at_rest = np.linalg.svd(
        model.parametrization.constraints.value(model.mechanism.q_reference).jacobian, compute_uv=False
    )
    assert loops[-1] / loops[0] < 0.05 * at_rest[-1] / at_rest[0]
    assert sample.closure_error <= 1e-10


def test_bad_calls_are_named(rpdr_model):
    """No reset, a wrong size, a time that is past, a step of nothing."""
    simulator = ccpin.Simulator(rpdr_model)
    with pytest.raises(InvalidInputError, match="reset"):
        simulator.step([0.0, 0.0], 1e-3)
    simulator.reset(START)
    with pytest.raises(InvalidInputError, match="u has shape"):
        simulator.step([0.0], 1e-3)
    with pytest.raises(InvalidInputError, match="dt"):
        simulator.step([0.0, 0.0], 0.0)
    with pytest.raises(InvalidInputError, match="later"):
        simulator.advance(0.0)
    with pytest.raises(InvalidInputError, match="direction"):
        ccpin.Simulator(rpdr_model, events=[Event(lambda t, state, v: t, direction=2)]).reset(START)


# How a motion ends.


class Raises(ccpin.control.ControlLaw):
    """No torque, and an exception from a time on."""

    def __init__(self, error):
        self.error = error

    def torque(self, t, state, v):
        if t > 0.05:
            raise self.error
        return np.zeros(2)


@pytest.mark.parametrize(
    ("error", "status"),
    [(ZeroDivisionError("nought"), "failed"), (KeyError("gain"), "failed"), (KeyboardInterrupt(), "interrupted")],
)
def test_whatever_is_raised_the_motion_is_kept(rpdr_model, error, status):
    """Every exception is the cause of a motion that ends with its last certain state."""
    motion = ccpin.simulate(rpdr_model, Raises(error), START, duration=1.0)
    assert motion.status == status
    assert motion.cause is error
    assert 0.03 < motion.t[-1] <= 0.05
    with pytest.raises(type(error)):
        raise motion.cause


def test_a_law_that_fails_at_once_raises(rpdr_model):
    """Where there is nothing to keep the exception itself comes."""
    with pytest.raises(InvalidInputError, match="the law returned u of shape"):
        ccpin.simulate(rpdr_model, lambda t, q, v: np.zeros(3), START, duration=1.0)


TOLERANCES = ({}, {"rtol": 1e-12, "atol": 1e-13}, {"rtol": 1e-6, "atol": 1e-8})
STEPS = {name: [same_on_both, pytest.mark.slow, pytest.mark.slow] for name in ("RK23", "Radau")}  # many


@pytest.mark.parametrize(
    ("method", "options"),
    [
        pytest.param(method, options, marks=[mark] * (mark is not None))
        for k, options in enumerate(TOLERANCES)
        for method in ("RK45", "DOP853", "RK23", "Radau")
        for mark in [STEPS.get(method, [None, same_on_both, None])[k]]
    ],
)
def test_a_singularity_is_one_for_every_integrator(rpdr_model, method, options):
    """Thrown at the stretched loop the motion ends as singular, by all of them."""
    motion = ccpin.simulate(
        rpdr_model, Limp(2), np.radians([-108.0, -72.0]), [-8.0, 8.0], duration=0.5, method=method, **options
    )
    assert motion.status == "singular"
    assert motion.t[-1] == pytest.approx(0.057, abs=1e-3)


@pytest.mark.parametrize("method", ["RK45", "DOP853"])
def test_a_singularity_is_one_late_in_a_motion_too(rpdr_model, method):
    """At 1e7 s, where no step can be shorter than 2e-8 s and integrators give up before they have come near."""
    simulator = ccpin.Simulator(rpdr_model, Limp(2), method=method)
    simulator.reset(np.radians([-108.0, -72.0]), [-8.0, 8.0], t=1e7)
    motion = simulator.run(1e7 + 0.5, sample_period=0.1)
    assert motion.status == "singular"
    assert "the coordinates joint1, joint2 end, in which Limp is stated" in motion.message
    assert motion.t[-1] - 1e7 == pytest.approx(0.057, abs=1e-3)


@pytest.mark.parametrize("controller", [None, lambda t, q, v: np.zeros(2)])
@pytest.mark.parametrize("budget", [Budget(evaluations=500), Budget(seconds=0.02)])
def test_a_budget_ends_a_motion(rpdr_model, controller, budget):
    """A spent budget is a status, and what was computed is there."""
    motion = ccpin.simulate(rpdr_model, controller, START, duration=1e4, sample_period=0.01, budget=budget)
    assert motion.status == "exhausted"
    assert motion.t[-1] > 0
    assert motion.evaluations < 20_000
    if budget.evaluations:
        assert 500 <= motion.evaluations < 600


def test_the_last_sample_is_where_it_stopped(rpdr_model):
    """Also between two regular samples: here where q leaves a region."""
    edge = np.radians(-120.0)
    law = PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    motion = ccpin.simulate(
        rpdr_model, law, START, duration=1.0, sample_period=0.05, region=lambda q: q[0] < edge, rtol=1e-10
    )
    assert motion.status == "outside"
    assert motion.q[-1, 0] == pytest.approx(edge, abs=1e-8)
    assert motion.t[-1] % 0.05 > 1e-6


def test_the_acceleration_is_in_the_trajectory(rpdr_model):
    """a at each sample is that of the closed forms under the recorded efforts."""
    law = PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)
    for controller in (law, lambda t, q, v: law.torque(t, Measurement(q), v)):
        motion = ccpin.simulate(rpdr_model, controller, START, duration=0.2, sample_period=0.02)
        for q, v, a, u in zip(motion.q, motion.v, motion.a, motion.u, strict=True):
            D, C, g = oracle.reduced_terms(oracle.sigma(q, 1), v)
            assert a == pytest.approx(np.linalg.solve(D, u - C @ v - g), abs=1e-8)


@pytest.mark.parametrize("seed", range(5))
def test_a_clock_of_its_own_loses_no_switch(seed):
    """On any clock the next switch is later than now, and at it the law is past it, rounding or not."""
    rng = np.random.default_rng(seed)
    for start, times in zip(rng.uniform(0, 1e4, 200), rng.uniform(0, 1, (200, 2)), strict=True):
        low, high = np.sort(times)
        step = TorqueFunction(lambda t, q, v, at=low: [float(t >= at)], [low, high])
        delayed = Delayed(step, start)
        first = delayed.next_switch(start)
        assert delayed.torque(first, Measurement(np.zeros(1)), np.zeros(1)) == [1.0]
        second = delayed.next_switch(first)
        assert first < second < delayed.next_switch(second) == np.inf


def test_a_switch_that_is_past_is_told(rpdr_model):
    """A law whose next switch is now would hold the motion up for ever."""

    class Stuck(NoTorque):
        def next_switch(self, t):
            return t

    simulator = ccpin.Simulator(rpdr_model, Stuck(rpdr_model), friction=FRICTION)
    simulator.reset(START)
    with pytest.raises(InvalidInputError, match="later than that"):
        simulator.advance(0.1)
