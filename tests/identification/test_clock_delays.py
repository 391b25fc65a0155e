"""Efforts whose stamps are late: how late, how sure, and set right."""

import numpy as np
import pytest

from ccpin.identification import identify
from ccpin.identification.estimates.clock_delays import further_delays, slopes
from ccpin.identification.estimates.robust_fit import EffortRows, fitted_robustly

LATE = 0.004


def told(seed, late):
    """F(t) = sin t − sin 3t, told with noise, fitted with two columns; F comes late."""
    draw, t = np.random.default_rng(seed), np.arange(0.0, 20.0, 0.01)
    W = np.sin(np.outer(t, [1.0, 3.0]))[:, None]
    force = (np.sin(t - late) - np.sin(3.0 * (t - late)) + 0.02 * draw.normal(size=len(t)))[:, None]
    return (
        t,
        EffortRows(W, force, np.zeros((0, 2)), np.zeros(0)),
        W @ np.array([1.0, -1.0]) + 0.02 * draw.normal(size=(len(t), 1)),
    )


def test_a_delay_is_found_as_surely_as_it_says():
    """What is told has noise of its own, which its rates have much more of: no delay is the smaller for it."""
    off = []
    for seed in range(100):
        t, rows, F = told(seed, LATE)
        fit, stretch = fitted_robustly(rows, False), np.zeros(len(t), dtype=int)
        rates = [[slopes(t, stretch, each)] for each in (F, rows.tau)]
        (seconds,), (deviation,) = further_delays(fit, rows.left(fit.beta), *rates)
        off.append((seconds - LATE) / deviation)
    assert abs(np.mean(off)) < 5.0 / np.sqrt(100.0)
    assert 0.75 < np.std(off) < 1.25


def test_a_log_that_stands_tells_no_delay():
    _, rows, _ = told(0, 0.0)
    fit = fitted_robustly(rows, False)
    seconds, deviation = further_delays(fit, rows.left(fit.beta), *[[np.zeros_like(rows.tau)]] * 2)
    assert (seconds.tolist(), deviation.tolist()) == ([0.0], [np.inf])


def test_rates_do_not_reach_over_a_reversal():
    t, stretch = np.arange(8.0), np.repeat([0, 1], 4)
    found = slopes(t, stretch, np.r_[0.0, 1.0, 2.0, 3.0, 13.0, 14.0, 15.0, 16.0][:, None])
    assert found[:, 0].tolist() == [0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0]


def test_a_log_says_how_late_its_efforts_are(bench):
    (own,) = identify(bench.model, bench.log(0)).delays
    (late,) = identify(bench.model, bench.log(0).delayed({"u": -LATE})).delays
    assert (own.log, own.taken, late.taken) == ("a log", 0.0, 0.0)
    assert abs(own.seconds) < 4.0 * own.deviation < 1.5e-3
    assert abs(late.seconds - own.seconds - LATE) < 0.15 * LATE
    (alone,) = identify(bench.model, bench.log(0).delayed({"u": -LATE}), kinds=("friction",)).delays
    assert abs(alone.seconds - LATE) < 0.15 * LATE  # all else is as stated, and as late


@pytest.mark.slow
def test_clocks_are_set_right(bench):
    logs = [bench.log(k).delayed({"u": -late}) for k, late in ((0, LATE), (1, -0.5 * LATE))]
    found = identify(bench.model, logs, align=True)
    for each, late in zip(found.delays, (LATE, -0.5 * LATE), strict=True):
        assert abs(each.seconds - late) < 4.5 * each.deviation
        assert abs(each.taken - each.seconds) < 0.11 * each.deviation
    assert np.abs((found.values - found.stated) / found.deviations).max() < 4.5
    wrong = identify(bench.model, logs)
    assert (wrong.effort_noise > found.effort_noise).all()
