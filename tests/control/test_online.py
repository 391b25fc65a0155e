"""σ in real time: the cap, warm starts, what happens when the cap is not enough, and sampled tracking."""

import numpy as np
import pytest

import ccpin
from ccpin.control import ComputedTorque, Measurement, OnlineLaw, OnlineSigma, PDPlus, PointToPoint, Sampling
from ccpin.control.online import capped_sigma
from ccpin.errors import InvalidInputError
from tests.oracles import rpdr
from tests.support.paper import GOAL, K_P, K_V, START

OUT_OF_REACH = np.radians([180.0, 0.0])  # the arms point away from each other
PAPER_ORDER = [0, 2, 1, 3]


@pytest.fixture(scope="module")
def reference(model):
    return PointToPoint(model, START, GOAL, 0.4)


@pytest.fixture
def evaluations(model, monkeypatch):
    """How often φ is evaluated."""
    counted, value = [], model.parametrization.constraints.value

    def counting(q_free):
        counted.append(1)
        return value(q_free)

    monkeypatch.setattr(model.parametrization.constraints, "value", counting)
    return counted


def closed_form(q):
    return rpdr.sigma(q, 1.0)[PAPER_ORDER]


def test_within_the_cap_it_is_sigma(model):
    """σ and ρ by the paper's closed forms, to the tolerance asked for."""
    start = closed_form(START)
    for step in (1e-6, 1e-3, 0.03):
        q = START + step
        solve = capped_sigma(model.parametrization, q, start, 6, 1e-12)
        assert solve.residual <= 1e-12
        np.testing.assert_allclose(solve.point.q_free, closed_form(q), atol=1e-10)
        rho = rpdr.rho(closed_form(q)[PAPER_ORDER])[PAPER_ORDER]
        np.testing.assert_allclose(solve.point.rho, rho, atol=1e-9)


@pytest.mark.parametrize("cap", [1, 2, 3])
def test_the_cap_is_hard(model, evaluations, cap):
    """No more Newton steps than the cap and one evaluation more; what is unfinished is never returned."""
    start = closed_form(START)
    for step in (1e-9, 1e-3, 0.05, 0.3, 3.0):
        evaluations.clear()
        solve = capped_sigma(model.parametrization, START + step, start, cap, 1e-10)
        assert solve.steps <= cap
        assert len(evaluations) <= cap + 1
        if solve.point is None:
            assert solve.residual > 1e-10
        else:
            np.testing.assert_allclose(solve.point.q_free, closed_form(START + step), atol=1e-8)
    assert solve.point is None


def test_what_is_accepted_can_be_trusted(model, monkeypatch):
    """From starts near and far from singularities: the branch kept, det ψ_q′ never of another sign, steps shrinking.

    Every accepted solve took corrections each at most an eighth of the one before (down to rounding).
    """
    visited, value = [], model.parametrization.constraints.value

    def recording(q_free):
        visited.append(q_free)
        return value(q_free)

    monkeypatch.setattr(model.parametrization.constraints, "value", recording)
    rng = np.random.default_rng(1)
    solved = 0
    for q_free in rpdr.random_configurations(rng, 600, 1.0, away=1e-3):
        visited.clear()
        q = q_free[:2] + rng.choice([0.01, 0.1, 0.3]) * rng.normal(size=2)
        solve = capped_sigma(model.parametrization, q, q_free[PAPER_ORDER], 8, 1e-10)
        if solve.point is None:
            continue
        solved += 1
        assert np.sin(rpdr.fold(solve.point.q_free[PAPER_ORDER])) > 0
        assert all(np.sin(rpdr.fold(at[PAPER_ORDER])) > 0 for at in visited)
        lengths = np.linalg.norm(np.diff(visited, axis=0), axis=1)
        assert np.all((lengths[1:] <= 0.125 * lengths[:-1]) | (lengths[1:] <= 1e-10))
    assert 300 < solved < 600


def test_a_path_is_followed_in_few_steps(model, reference):
    """Sampled at 1 ms along the paper's move, every σ is found within the cap and is the closed form."""
    online = OnlineSigma(model, closed_form(START), max_newton_steps=3)
    for k in range(401):
        q = reference.at(1e-3 * k).q
        sample = online.update(1e-3 * k, q)
        assert sample.outcome == "solved"
        np.testing.assert_allclose(sample.state.q_free, closed_form(q), atol=1e-7)
    report = online.report()
    assert (report.samples, report.held, report.first_held, report.lost) == (401, 0, None, False)
    assert 1 <= report.most_steps <= 3
    assert report.largest_residual <= 1e-9
    assert "each of 401 samples" in report.message


def test_an_outage_is_held_then_lost_then_recovered(model, reference):
    """Readings that cannot be: the last valid σ stands in, then counts as lost, until readings make sense again."""
    online = OnlineSigma(model, closed_form(START), patience=3)
    good = online.update(0.0, START)
    states = [online.update(1e-3 * k, OUT_OF_REACH) for k in range(1, 7)]
    assert [sample.outcome for sample in states] == ["held"] * 3 + ["lost"] * 3
    assert all(sample.state is good.state for sample in states)
    early = online.report()
    last = online.update(7e-3, reference.at(7e-3).q)
    assert last.outcome == "solved"
    assert (early.samples, early.held, early.longest_hold, early.first_held, early.lost) == (7, 6, 6, 1e-3, True)
    report = online.report()
    assert (report.samples, report.held, report.longest_hold) == (8, 6, 6)
    assert "6 of 8 samples (first at t = 0.001 s" in report.message
    steps = [sample.steps for sample in (good, *states, last)]
    assert report.mean_steps == pytest.approx(np.mean(steps))
    assert report.most_steps == max(steps)


def test_the_law_holds_and_brakes(model, reference):
    """While held the law works at the last valid point; once lost it brakes there."""
    law = ComputedTorque(model, reference, [400.0, 400.0], [40.0, 40.0])
    online_law = OnlineLaw(law, OnlineSigma(model, closed_form(START), patience=1))
    v = np.array([0.3, -0.2])
    held = online_law.online.update(0.0, START).state
    np.testing.assert_array_equal(online_law.torque(0.0, Measurement(START), v), law.torque(0.0, held, v))
    found = online_law.torque(1e-3, Measurement(OUT_OF_REACH), v)
    np.testing.assert_array_equal(found, law.torque_with(1e-3, OUT_OF_REACH, v, held))
    np.testing.assert_array_equal(online_law.torque(2e-3, Measurement(OUT_OF_REACH), v), law.brake(v, held))


def test_samples_come_in_order(model):
    """The same sample again is free; an earlier one, or another at the same time, is refused."""
    online = OnlineSigma(model, closed_form(START))
    first = online.update(0.5, START + 0.01)
    assert online.update(0.5, START + 0.01) is first
    assert online.report().samples == 1
    for t, q in ((0.4, START), (0.5, START)):
        with pytest.raises(InvalidInputError, match="order of time"):
            online.update(t, q)


def test_continuous_simulation_refuses_an_online_law(model, reference):
    """An integrator goes back and forth in time, which a law with a memory must not see: the run says so."""
    law = PDPlus(model, reference, K_P, K_V)
    motion = ccpin.simulate(model, OnlineLaw(law, OnlineSigma(model, closed_form(START))), START, duration=0.1)
    assert motion.status == "failed"
    assert "use the tracking law itself" in motion.message


@pytest.mark.parametrize("name", ["rpdr", pytest.param("delta", marks=pytest.mark.slow)])
def test_sampled_tracking(name):
    """At 1 ms the sampled law tracks to a milliradian, about twice as well at half the period, never without σ."""
    model = ccpin.ReducedModel(ccpin.load(name))
    start, goal = {"rpdr": (START, GOAL), "delta": (np.array([-0.2, 0.1, 0.0]), np.array([0.4, -0.1, 0.3]))}[name]
    law = ComputedTorque(model, PointToPoint(model, start, goal, 0.4), [400.0] * model.n, [40.0] * model.n)
    errors = []
    for period in (2e-3, 1e-3):
        online = OnlineSigma(model, model.sigma(start))
        motion = ccpin.simulate(
            model,
            OnlineLaw(law, online),
            start,
            duration=0.4,
            sampling=Sampling(period),
            rtol=1e-7,
            atol=1e-9,
            sample_period=0.01,
        )
        assert motion.status == "finished"
        assert online.report().held == 0
        assert online.report().samples >= 0.4 / period
        errors.append(max(np.abs(law.error(t, q)).max() for t, q in zip(motion.t, motion.q, strict=True)))
    assert errors[1] < 1e-3
    assert errors[1] < 0.6 * errors[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [({"max_newton_steps": 0}, "max_newton_steps"), ({"tolerance": 0.0}, "tolerance"), ({"patience": -1}, "patience")],
)
def test_bad_options_are_refused(model, options, words):
    """A cap of at least one step, a positive tolerance, a patience that is not negative."""
    with pytest.raises(InvalidInputError, match=words):
        OnlineSigma(model, closed_form(START), **options)
