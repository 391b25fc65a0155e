"""The sampled loop: what the law sees, what the motors get, and that it converges to the continuous loop."""

import numpy as np
import pytest
from scipy.signal import lfilter

import ccpin
from ccpin.control import ControlLaw, CoulombCompensation, Measurement, PDSimpleGravity, Sampling, TorqueFunction
from ccpin.control.control_law import NoTorque
from ccpin.control.sampling import SampledCommands
from ccpin.errors import InvalidInputError
from ccpin.simulation import Settling, supervise
from ccpin.simulation.plant.stick_slip import friction_force
from tests.oracles import rpdr as oracle
from tests.support.backends import same_on_both
from tests.support.paper import FRICTION, GOAL, K_P, K_V, START

BENCH = Sampling(1e-3, encoder_counts=4096, velocity_cutoff=100.0, saturation=12.0, delay=1)
STEP = 2 * np.pi / 4096


class Recorded(ControlLaw):
    """A law that notes what it was asked."""

    def __init__(self, law):
        self.law, self.calls = law, []

    def torque(self, t, state, v):
        u = self.law.torque(t, state, v)
        self.calls.append((t, state.q.copy(), v.copy(), u.copy()))
        return u

    def columns(self):
        return [np.array(column) for column in zip(*self.calls, strict=True)]


@pytest.fixture(scope="module")
def law(rpdr_model):
    return PDSimpleGravity(rpdr_model, GOAL, K_P, K_V)


def run(model, law, sampling, duration=0.1, **options):
    recorded = Recorded(law)
    motion = ccpin.simulate(model, recorded, START, duration=duration, sampling=sampling, **options)
    return motion, *recorded.columns()


@same_on_both
def test_it_converges_to_the_continuous_loop_at_first_order(rpdr_model, law):
    """Zero-order hold alone: the error over periods 8 … 0.5 ms has slope 1 on logarithmic axes."""
    continuous = ccpin.simulate(rpdr_model, law, START, duration=0.32, sample_period=8e-3)
    periods = np.array([8e-3, 4e-3, 2e-3, 1e-3, 5e-4])
    errors = [
        np.abs(
            ccpin.simulate(rpdr_model, law, START, duration=0.32, sample_period=8e-3, sampling=Sampling(period)).q
            - continuous.q
        ).max()
        for period in periods
    ]
    slope = np.polyfit(np.log(periods), np.log(errors), 1)[0]
    assert np.all(np.diff(errors) < 0)
    assert slope == pytest.approx(1.0, abs=0.1)


@pytest.mark.slow
@same_on_both
def test_it_converges_with_friction_too(rpdr_model, law):
    """With stick and slip the error still falls in proportion to the period."""
    options = {"duration": 0.32, "sample_period": 8e-3, "friction": FRICTION}
    continuous = ccpin.simulate(rpdr_model, law, START, **options)
    periods = np.array([4e-3, 2e-3, 1e-3])
    errors = [
        np.abs(ccpin.simulate(rpdr_model, law, START, sampling=Sampling(p), **options).q - continuous.q).max()
        for p in periods
    ]
    assert np.polyfit(np.log(periods), np.log(errors), 1)[0] == pytest.approx(1.0, abs=0.2)


def test_efforts_are_held(rpdr_model, law):
    """The law is asked once a period, of the true state, and its answer stands until the next."""
    motion, t, q, v, u = run(rpdr_model, law, Sampling(2e-3), sample_period=5e-4)
    assert t == pytest.approx(np.arange(51) * 2e-3)
    assert np.array_equal(q, motion.q[::4])
    assert np.array_equal(v, motion.v[::4])
    for offset in range(4):
        assert np.array_equal(motion.u[offset::4][:50], u[:50])


def test_encoders_round_to_counts(rpdr_model, law):
    """The law sees whole counts within half a count of q."""
    motion, _, q, _, _ = run(rpdr_model, law, Sampling(1e-3, encoder_counts=4096))
    assert np.abs(q / STEP - np.round(q / STEP)).max() < 1e-9
    assert np.abs(q - motion.q).max() <= 0.5 * STEP * (1 + 1e-9)
    assert np.abs(q - motion.q).max() > 0.4 * STEP


def test_velocity_is_the_filtered_difference(rpdr_model, law):
    """What the law sees as velocity is SciPy's first-order filter of the differenced readings."""
    _, _, q, v, _ = run(rpdr_model, law, Sampling(1e-3, encoder_counts=4096, velocity_cutoff=80.0))
    pole = np.exp(-2 * np.pi * 80.0 * 1e-3)
    slope = np.diff(q, axis=0, prepend=[np.round(START / STEP) * STEP]) / 1e-3
    assert v == pytest.approx(lfilter([1 - pole], [1, -pole], slope, axis=0), abs=1e-9)


def test_the_filter_starts_settled_at_the_first_velocity(rpdr_model):
    """A motion under way is seen at its speed from the first sample on, not after a transient."""
    seen = Recorded(NoTorque(rpdr_model))
    ccpin.simulate(rpdr_model, seen, START, [1.0, -2.0], duration=5e-3, sampling=Sampling(1e-4, velocity_cutoff=50.0))
    _, _, v, _ = seen.columns()
    assert v[0] == pytest.approx([1.0, -2.0], abs=1e-9)
    assert np.abs(v - [1.0, -2.0]).max() < 0.3


def test_commands_arrive_late(rpdr_model, law):
    """The motors get the command of k samples ago, and before the first one what they had."""
    motion, _, _, _, u = run(rpdr_model, law, Sampling(1e-3, delay=3, effort_before=(0.5, -0.5)))
    assert np.array_equal(motion.u[3:], u[:-3])
    assert np.array_equal(motion.u[:3], [[0.5, -0.5]] * 3)


def test_motors_saturate(rpdr_model, law):
    """Each motor gives at most its limit, and the law's effort within it."""
    motion, _, _, _, u = run(rpdr_model, law, Sampling(1e-3, saturation=(6.0, 4.0)))
    assert np.array_equal(motion.u, np.clip(u, [-6.0, -4.0], [6.0, 4.0]))
    assert np.abs(u).max() > 6.0
    assert np.abs(motion.u).max(axis=0) == pytest.approx([6.0, 4.0])


def test_the_run_keeps_the_memory(rpdr_model, law):
    """With the whole bench on, the same law and arguments give the same samples, bit for bit."""
    once, again = (
        ccpin.simulate(rpdr_model, law, START, duration=0.1, friction=FRICTION, sampling=BENCH) for _ in range(2)
    )
    assert np.array_equal(once.q, again.q)
    assert np.array_equal(once.u, again.u)


@pytest.mark.parametrize("period", [1e-3, 7e-4, 3e-2])
def test_samples_fall_where_asked(rpdr_model, law, period):
    """The trajectory's times do not depend on the controller's, and its loops stay closed."""
    motion = ccpin.simulate(rpdr_model, law, START, duration=0.05, sampling=Sampling(period), sample_period=2e-3)
    assert motion.t == pytest.approx(np.arange(26) * 2e-3)
    assert motion.closure_error.max() <= 1e-10


@pytest.fixture(scope="module")
def bench(rpdr_model, law):
    """The paper's point-to-point motion with friction and the sampled loop."""
    return ccpin.simulate(rpdr_model, law, START, duration=1.0, friction=FRICTION, sampling=BENCH)


@same_on_both
def test_the_bench_reaches_its_goal(bench):
    """Within ±2° from about 0.3 s on, as the paper's hardware."""
    outside = np.flatnonzero(np.abs(bench.q - GOAL).max(axis=1) > np.radians(2.0))
    assert bench.t[outside[-1] + 1] == pytest.approx(0.3, abs=0.05)


@same_on_both
def test_the_bench_rests_where_friction_explains(bench, rpdr_model):
    """At rest |K_p q̃ + g(q_d) − g(q)| ≤ c + K_p·(half a count), g from the closed forms."""
    q = bench.q[-1]

    def gravity(q):
        q_free = oracle.sigma(q, 1)
        return oracle.rho(q_free).T @ oracle.gravity(q_free)

    left = np.abs(K_P * (GOAL - q) + gravity(GOAL) - gravity(q))
    assert np.abs(bench.v[-1]).max() == 0.0
    assert np.ptp(bench.q[-200:], axis=0).max() < STEP
    assert np.all(left <= 0.2 + K_P * 0.5 * STEP)
    assert np.all(left > 1e-3)
    force = friction_force(rpdr_model, FRICTION, q, bench.v[-1], bench.u[-1], bench.q_free[-1])
    assert force.generalized == pytest.approx(gravity(q) - bench.u[-1], abs=1e-9)


@same_on_both
def test_compensation_by_the_error_shrinks_it(rpdr_model, law, bench):
    """Pushing towards the goal with most of the friction leaves less of the error than none."""
    helped = CoulombCompensation(law, 0.18, width=0.02)
    motion = ccpin.simulate(rpdr_model, helped, START, duration=0.5, friction=FRICTION, sampling=BENCH)
    assert not motion.v[-1].any()
    assert np.abs(motion.q[-1] - GOAL).max() < np.abs(bench.q[-1] - GOAL).max()


def test_compensation_adds_what_it_says(rpdr_model, law):
    """Towards the goal: ĉ sign(q_d − q_start), constant. By the error: ĉ q̃/width, at most ĉ."""
    constant = CoulombCompensation(law, [0.1, 0.2], q_start=[GOAL[0] + 0.3, GOAL[1] - 0.3])
    by_error = CoulombCompensation(law, 0.1, width=0.02)
    for offset, share in (([0.005, -0.5], [-0.25, 1.0]), ([0.0, 0.01], [0.0, -0.5])):
        q = GOAL + offset
        plain = law.torque(0.0, Measurement(q), np.ones(2))
        assert constant.torque(0.0, Measurement(q), np.ones(2)) - plain == pytest.approx([-0.1, 0.2])
        assert by_error.torque(0.0, Measurement(q), np.ones(2)) - plain == pytest.approx(0.1 * np.array(share))


@pytest.mark.slow
@same_on_both
def test_supervised_cycles_with_the_bench_on(rpdr_model):
    """Back and forth: every move settles within the band friction allows and stays there while waiting."""
    band = np.radians(2.0)
    motion = supervise(
        rpdr_model,
        lambda goal, near: PDSimpleGravity(rpdr_model, goal, K_P, K_V, near),
        START,
        [GOAL, START],
        wait=0.3,
        settling=Settling(GOAL, band=band),
        friction=FRICTION,
        sampling=BENCH,
        rtol=1e-7,
        atol=1e-9,
    )
    assert len(motion.moves) == 2
    for move in motion.moves:
        assert move.settled - move.start < 0.5
        assert np.abs(move.trajectory.q[-300:] - move.goal).max() <= band
    joint = np.searchsorted(motion.trajectory.t, motion.moves[1].start)
    assert np.array_equal(motion.trajectory.u[joint], motion.moves[0].trajectory.u[-1])
    assert np.all(np.diff(motion.trajectory.t) > 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"period": 0.0}, "period = 0.0 must be positive"),
        ({"period": None}, "period"),
        ({"period": np.nan}, "period = nan must be a finite number"),
        ({"encoder_counts": -4096}, "encoder_counts = -4096 must be positive"),
        ({"encoder_counts": ()}, "encoder_counts"),
        ({"period": (1e-3, 1e-3)}, "period"),
        ({"period": "fast"}, "period = 'fast'"),
        ({"velocity_cutoff": [1.0, 2.0]}, "velocity_cutoff"),
        ({"velocity_cutoff": 0.0}, "velocity_cutoff"),
        ({"saturation": (1.0, -1.0)}, "saturation"),
        ({"delay": -1}, "whole number of periods"),
        ({"delay": 0.5}, "whole number of periods"),
        ({"effort_before": np.inf}, "effort_before"),
    ],
)
def test_bad_sampling_is_named(change, words):
    """Every value out of its range is refused by its name."""
    with pytest.raises(InvalidInputError, match=words):
        Sampling(**({"period": 1e-3} | change))


def test_a_law_may_reuse_its_array(rpdr_model):
    """A command on its way is not changed by the next one, even where the law writes into the same array."""
    buffer = np.zeros(2)

    def ramp(t, q, v):
        buffer[:] = t
        return buffer

    motion = ccpin.simulate(rpdr_model, ramp, START, duration=0.01, sampling=Sampling(1e-3, delay=2))
    assert motion.u[2:, 0] == pytest.approx(motion.t[:-2])


@pytest.mark.parametrize("name", ["encoder_counts", "saturation", "effort_before"])
def test_one_value_each(rpdr_model, law, name):
    """Three values for two joints or motors are refused."""
    with pytest.raises(InvalidInputError, match=f"{name} has 3 values"):
        ccpin.simulate(rpdr_model, law, START, duration=0.1, sampling=Sampling(1e-3, **{name: (1.0, 2.0, 3.0)}))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([0.1, 0.2, 0.3],), "coulomb must be"),
        ((-0.1,), "coulomb must be"),
        ((0.1, None, 0.0), "width"),
        ((0.1, [0.0]), "shape"),
    ],
)
def test_bad_compensation_is_named(law, arguments, words):
    """Levels, start and width are checked."""
    with pytest.raises(InvalidInputError, match=words):
        CoulombCompensation(law, *arguments)


def test_noise_of_encoders():
    """q̂ − q is normal with the deviation asked for, v̂ its difference quotient; the same seed gives the same noise."""
    model = ccpin.ReducedModel(ccpin.load("rpdr"))
    q0, seen = model.alpha(model.mechanism.q_reference), []

    def law(t, q, v):
        seen.append([*q - q0, *v])
        return np.zeros(2)

    def run(seed):
        seen.clear()
        commands = SampledCommands(
            model, TorqueFunction(law), Sampling(1e-3, encoder_noise=(1e-4, 3e-4), seed=seed), q0, np.zeros(2)
        )
        state = model.at(q0)
        for k in range(2000):
            commands.instant(k * 1e-3, state, np.zeros(2))
        return np.array(seen)

    first = run(3)
    np.testing.assert_array_equal(first, run(3))
    assert (first != run(4)).all(axis=1).any()
    deviation = first[:, :2].std(axis=0) / [1e-4, 3e-4]
    np.testing.assert_allclose(deviation, 1.0, rtol=0, atol=4 / np.sqrt(2 * 2000))  # four standard errors
    np.testing.assert_allclose(first[:, :2].mean(axis=0) / [1e-4, 3e-4], 0.0, rtol=0, atol=4 / np.sqrt(2000))
    np.testing.assert_allclose(first[1:, 2:], np.diff(first[:, :2], axis=0) / 1e-3, rtol=0, atol=1e-9)
    assert abs(np.corrcoef(first[1:, 0], first[:-1, 0])[0, 1]) < 4 / np.sqrt(2000)


@pytest.mark.parametrize("options", [{"encoder_noise": -1.0}, {"seed": 0.5}, {"seed": -1}])
def test_bad_noise(options):
    """Impossible noise is named."""
    with pytest.raises(InvalidInputError, match=f"sampling: {next(iter(options))}"):
        Sampling(1e-3, **options)
