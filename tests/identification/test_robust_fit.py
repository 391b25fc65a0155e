"""Least squares beside NumPy's and closed forms; with gross errors, and with what is known beforehand."""

import numpy as np
import pytest

from ccpin.identification import identify
from ccpin.identification.estimates.robust_fit import EffortRows, fitted_robustly
from ccpin.identification.logs.log import Log

BETA = np.array([1.0, -2.0, 0.5])
NOISE = np.array([0.1, 0.02])


def rows(seed, grossly=0.0, known=0):
    """600 samples of two rows, and what is known of the first numbers: deviation 0.05."""
    draw = np.random.default_rng(seed)
    W = draw.normal(size=(600, 2, 3))
    tau = W @ BETA + NOISE * draw.normal(size=(600, 2))
    bad = draw.random(600) < grossly
    tau[bad] += (20.0 + 10.0 * draw.random((bad.sum(), 1))) * NOISE * np.sign(W[bad, :, 0])
    return EffortRows(W, tau, 20.0 * np.eye(3)[:known], 20.0 * BETA[:known]), bad


def test_where_nothing_is_off_it_is_weighted_least_squares():
    given, _ = rows(0)
    found = fitted_robustly(given, True)
    weight = 1.0 / np.tile(found.deviation, 600)
    W = weight[:, None] * given.W.reshape(-1, 3)
    assert np.allclose(found.beta, np.linalg.lstsq(W, weight * given.tau.ravel(), rcond=None)[0], rtol=1e-9)
    assert np.allclose(found.covariance, np.linalg.inv(W.T @ W), rtol=1e-9)
    assert np.allclose(found.deviation, NOISE, rtol=0.1)
    assert found.counted.all()
    plain = fitted_robustly(given, False)
    assert np.array_equal(found.beta, plain.beta)


def test_what_is_known_beforehand_is_one_more_measurement():
    given, _ = rows(1, known=2)
    found = fitted_robustly(given, True)
    weight = np.tile(found.deviation**-2, 600)
    W, tau = given.W.reshape(-1, 3), given.tau.ravel()
    precision = W.T @ (weight[:, None] * W) + np.diag([400.0, 400.0, 0.0])
    mode = np.linalg.solve(precision, W.T @ (weight * tau) + 400.0 * BETA * [1, 1, 0])
    assert np.allclose(found.beta, mode, rtol=1e-9)
    assert np.allclose(found.covariance, np.linalg.inv(precision), rtol=1e-9)


def test_noise_is_counted_by_what_the_numbers_take_up():
    """σ² is unbiased where there are hardly more equations than numbers."""
    found = []
    for seed in range(500):
        draw = np.random.default_rng(seed)
        W = draw.normal(size=(5, 1, 3))
        given = EffortRows(W, draw.normal(size=(5, 1)), np.zeros((0, 3)), np.zeros(0))
        found.append(fitted_robustly(given, False).deviation[0] ** 2)
    assert abs(np.mean(found) - 1.0) < 5.0 / np.sqrt(500.0)


def test_with_one_in_fifty_grossly_off_intervals_hold_and_plain_ones_do_not():
    within, plain, missed = [], [], 0
    for seed in range(60):
        given, bad = rows(seed, grossly=0.02)
        found = fitted_robustly(given, True)
        missed += int((found.counted & bad).sum())
        for fit, told in ((found, within), (fitted_robustly(given, False), plain)):
            told.append(np.abs(fit.beta - BETA) < 1.96 * np.sqrt(np.diag(fit.covariance)))
    assert missed == 0
    assert 0.9 < np.mean(within) < 0.99
    assert np.mean(np.array(plain)[:, 0]) < 0.5


def test_outliers_of_efforts_are_named_by_their_motor(bench):
    log = bench.log(1)
    columns, at = dict(log.columns), {"u_joint1": [0, 100, 333], "u_joint2": [700]}
    for name, places in at.items():
        columns[name] = np.array(columns[name])
        columns[name][places] += 1.0
    found = identify(bench.model, [Log(log.t, columns, "spoilt"), bench.log(0)])
    assert {each.log for each in found.outliers} == {"spoilt"}
    named = {(each.column, round(each.t, 9)) for each in found.outliers}
    assert named == {(name, round(log.t[k], 9)) for name, places in at.items() for k in places}
    assert np.abs((found.values - found.stated) / found.deviations).max() < 4.5
    plain = identify(bench.model, Log(log.t, columns), robust=False)
    assert plain.outliers == ()
    assert (plain.effort_noise > 3.0 * found.effort_noise).all()


@pytest.mark.slow
def test_lost_efforts_do_not_make_a_robot_lighter(bench):
    """A drive that tells zero at one in fifty samples."""
    within, wider = [], []
    for seed in range(10):
        log, draw = bench.log(seed), np.random.default_rng(seed)
        columns = dict(log.columns)
        for name in ("u_joint1", "u_joint2"):
            columns[name] = np.where(draw.random(len(log.t)) < 0.02, 0.0, columns[name])
        found, plain = (identify(bench.model, Log(log.t, columns), robust=robust) for robust in (True, False))
        within.append(np.abs(found.values - found.stated) < 1.96 * found.deviations)
        wider.append(plain.deviations / found.deviations)
    assert np.mean(within) > 0.92
    assert np.mean(wider) > 3.0
