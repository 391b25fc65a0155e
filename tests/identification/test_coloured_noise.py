"""Deviations where noise of efforts hangs together: the double sum over samples, and robots that are found again."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from ccpin.identification import Log, identify
from ccpin.identification.estimates.coloured_noise import coloured_covariance, with_coloured_noise
from ccpin.identification.estimates.robust_fit import EffortRows, fitted_robustly


def chained(size, share, draw, n=2):
    """Noise of unit deviation of which a sample has so large a share of the one before it."""
    white = draw.normal(size=(size + 500, n))
    return lfilter([np.sqrt(1.0 - share**2)], [1.0, -share], white, axis=0)[500:]


LOGS = {
    "samples missing, a short log and none": (0.9, [np.r_[0:20, 23:48, 52:82], np.arange(50), [0, 1, 4], []], 25),
    "a single pair far apart": (0.98, [np.r_[0:13, 40], [3]], 37),
    "no lag": (0.1, [np.arange(12)], 0),
}


@pytest.mark.parametrize(("a", "places", "lags"), LOGS.values(), ids=LOGS)
def test_it_is_the_sum_over_all_pairs_of_samples(a, places, lags):
    """Of several logs, samples that do not count, and something known beforehand."""
    draw, size = np.random.default_rng(0), sum(map(len, places))
    W = draw.normal(size=(size, 2, 3)) + np.sin(np.arange(size) / 9.0)[:, None, None]
    rows = EffortRows(W, W @ np.ones(3) + 0.3 * chained(size, 0.6, draw), np.array([[0.0, 2.0, 1.0]]), np.array([3.0]))
    fit = fitted_robustly(rows, False)
    counted = np.arange(size) % 37 != 3
    fit = fit._replace(counted=counted)
    found = coloured_covariance([SimpleNamespace(chosen=np.array(each, dtype=int)) for each in places], rows, fit, a)
    assert lags == int(1.1447 * (4.0 * a**2 * counted.sum() / (1.0 - a**2) ** 2) ** (1.0 / 3.0))
    at = np.concatenate([10_000 * k + np.array(each, dtype=int) for k, each in enumerate(places)])
    e, X = rows.left(fit.beta) / fit.deviation, W / fit.deviation[:, None]
    pairs = [(s, t, at[t] - at[s]) for s in range(size) for t in range(size) if counted[s] and counted[t]]
    near = [(s, t, lag) for s, t, lag in pairs if abs(lag) <= lags]
    R, S = {}, rows.P.T @ rows.P
    for lag in {lag for _, _, lag in near}:
        R[lag] = np.mean([np.outer(e[s], e[t]) for s, t, apart in near if apart == lag], axis=0)
    for s, t, lag in near:
        S = S + (1.0 - abs(lag) / (lags + 1.0)) * X[s].T @ R[lag] @ X[t]
    np.testing.assert_allclose(found, fit.covariance @ S @ fit.covariance, rtol=1e-10)


@pytest.mark.parametrize(("a", "same"), [(0.0999, True), (0.1001, False), (-0.5, True)])
def test_what_smoothing_brings_about_is_white(a, same):
    """Below a tenth the covariance is least squares' own."""
    draw = np.random.default_rng(1)
    rows = EffortRows(draw.normal(size=(60, 2, 3)), draw.normal(size=(60, 2)), np.zeros((0, 3)), np.zeros(0))
    fit = fitted_robustly(rows, False)
    given, own = ([SimpleNamespace(chosen=np.arange(60))], rows, fit, np.array([a, -0.2])), fit.covariance
    assert (with_coloured_noise(own, *given) is own) == same


def test_it_is_no_smaller_than_either_in_any_direction():
    """And where one of them is larger everywhere it is that one."""
    draw = np.random.default_rng(2)
    rows = EffortRows(draw.normal(size=(90, 2, 3)), chained(90, 0.8, draw), np.zeros((0, 3)), np.zeros(0))
    fit, given = fitted_robustly(rows, False), [SimpleNamespace(chosen=np.arange(90))]
    own = coloured_covariance(given, rows, fit, 0.8)
    told = draw.normal(size=(3, 3)) * np.sqrt(np.trace(own))
    for other in (told @ told.T, 1e-6 * own, 1e6 * own):
        found = with_coloured_noise(other, given, rows, fit, np.array([0.8, 0.1]))
        least = [np.linalg.eigvalsh(found - each).min() / np.trace(found) for each in (own, other)]
        assert min(least) > -1e-12
    for other, largest in ((1e-6 * own, own), (1e6 * own, 1e6 * own)):
        found = with_coloured_noise(other, given, rows, fit, np.array([0.8, 0.1]))
        np.testing.assert_allclose(found, largest, rtol=1e-6, atol=1e-9 * np.trace(largest))


def test_noise_that_never_forgets_is_taken_to_forget_a_hundredth():
    draw = np.random.default_rng(3)
    rows = EffortRows(draw.normal(size=(30, 2, 3)), chained(30, 0.8, draw), np.zeros((0, 3)), np.zeros(0))
    fit, given = fitted_robustly(rows, False), [SimpleNamespace(chosen=np.arange(30))]
    found = with_coloured_noise(1e-6 * np.eye(3), given, rows, fit, np.array([0.2, 0.999]))
    np.testing.assert_allclose(found, coloured_covariance(given, rows, fit, 0.99), rtol=1e-3)
    assert not np.allclose(found, coloured_covariance(given, rows, fit, 0.985), rtol=1e-2)


def off(bench, share, robots, logs=1):
    """Errors of what is told, in deviations: of efforts with such noise, of a fiftieth, in so many logs a robot."""
    found, size = [], 0.02 * np.sqrt((bench.tau**2).mean(axis=0))
    for robot in range(robots):
        told = identify(bench.model, [with_noise(bench, share, size, (robot, k)) for k in range(logs)])
        found.append((told.values - told.stated) / told.deviations)
    return np.concatenate(found)


def with_noise(bench, share, size, seed):
    """A log with noise of this size in the efforts."""
    draw = np.random.default_rng(seed)
    log, noise = bench.log(int(draw.integers(2**31)), effort=1e-12), size * chained(len(bench.t), share, draw)
    columns = {f"u_joint{k + 1}": log.columns[f"u_joint{k + 1}"] + noise[:, k] for k in range(2)}
    return Log(log.t, {**log.columns, **columns})


def test_errors_are_as_large_as_deviations(bench):
    """Of noise of which nine tenths stay; as white noise it made errors of 3.5 deviations."""
    assert 0.7 < np.sqrt((off(bench, 0.9, 6) ** 2).mean()) < 1.6


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.7, 0.9])
def test_intervals_hold(bench, share):
    """Of logs that are many times as long as their noise remembers: 16 s."""
    errors = off(bench, share, 40, logs=4)
    assert 0.91 < (np.abs(errors) < 1.96).mean() < 0.98


@pytest.mark.slow
def test_coarse_encoders_leave_no_fewer_that_hold(bench):
    """What is left of the efforts hangs together by the motion's errors then: counted by one of both."""
    found = [identify(bench.model, bench.log(seed, encoder=1e-3)) for seed in range(20)]
    assert np.mean([np.abs(each.values - each.stated) < 1.96 * each.deviations for each in found]) > 0.93
