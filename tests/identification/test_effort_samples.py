"""Which samples count, and where one stretch of a motion ends."""

import numpy as np

import ccpin
from ccpin.identification.estimates.effort_samples import samples_of
from ccpin.identification.logs.log import Log
from ccpin.identification.logs.smoothing import smoothed


def test_stretches_end_where_a_joint_turns_back_and_where_samples_are_missing(bench):
    log = bench.log(0)
    columns = dict(log.columns)
    columns["u_joint1"] = np.array(columns["u_joint1"])
    columns["u_joint1"][500:505] = np.nan
    motion = smoothed(Log(log.t, columns), bench.model)
    found = samples_of(bench.model, motion, True)
    rates = np.einsum("sij,sj->si", bench.model.terms_many(bench.q, bench.v).rho, bench.v)[found.chosen]
    for k in range(1, len(found.chosen)):
        parted = (np.sign(rates[k]) != np.sign(rates[k - 1])).any() or found.chosen[k] - found.chosen[k - 1] > 1
        assert (found.stretch[k] > found.stretch[k - 1]) == parted, k
    assert found.stretch[0] == 0
    assert not np.isin(np.arange(500, 505), found.chosen).any()
    assert found.left + len(found.chosen) == len(log.t) - 5


def test_a_log_without_efforts_has_no_samples(bench):
    log = bench.log(0).between(0.0, 0.5)
    alone = Log(log.t, {name: column for name, column in log.columns.items() if name[0] == "q"})
    found = samples_of(bench.model, smoothed(alone, bench.model), True)
    assert (len(found.chosen), len(found.stretch), found.Y.shape[0], found.left) == (0, 0, 0, 0)


def test_joints_that_never_move_do_not_turn_back():
    """Rows of ρ that are rounding say nothing of which way their joints turn: here all others turn one way."""
    model, t = ccpin.ReducedModel(ccpin.load("delta")), np.linspace(0.0, 0.2, 101)
    middle, rate = model.alpha(model.mechanism.q_reference), np.array([1.0, 0.6, 0.3])
    q, v, a = middle + 0.1 + np.outer(t, rate), np.tile(rate, (len(t), 1)), np.zeros((len(t), 3))
    rates = np.einsum("sij,sj->si", model.terms_many(q, v).rho, v)
    still = np.abs(rates).max(axis=0) < 1e-12
    assert still.any()
    assert np.abs(rates[:, ~still]).min() > 1e-3
    names = model.mechanism.independent
    noisy, efforts = q + 1e-9 * np.sin(7.0 * np.arange(303).reshape(q.shape)), model.inverse_dynamics_many(q, v, a)
    columns = {f"q_{name}": column for name, column in zip(names, noisy.T, strict=True)}
    columns |= {f"u_{name}": column for name, column in zip(model.mechanism.actuated, efforts.T, strict=True)}
    found = samples_of(model, smoothed(Log(t, columns), model), True)
    assert (found.left, len(found.chosen), found.stretch.max()) == (0, len(t), 0)
