"""Cross-validation beside NumPy's least squares of what is left."""

import numpy as np

from ccpin.identification import identify
from ccpin.identification.estimates.held_out import cross_validated, parts_of
from ccpin.identification.estimates.robust_fit import EffortRows
from ccpin.identification.logs.log import Log


def test_each_part_is_told_by_the_others():
    draw = np.random.default_rng(0)
    W, stated, deviation = draw.normal(size=(50, 2, 3)), np.array([1.0, 2.0, 3.0]), np.array([0.1, 0.3])
    tau = W @ (1.1 * stated) + deviation * draw.normal(size=(50, 2))
    parts = parts_of([np.arange(50.0)], ["one"])
    assert [name for name, _ in parts] == [f"{10 * k} s to {10 * k + 9} s" for k in range(5)]
    nothing = np.zeros((0, 3)), np.zeros(0)
    told = cross_validated(EffortRows(W, tau, *nothing), deviation, stated, tau - W @ stated, tau, parts)
    for each, (name, chosen) in zip(told, parts, strict=True):
        others = np.setdiff1d(np.arange(50), chosen)
        A, b = (W[others] / deviation[:, None]).reshape(-1, 3), (tau[others] / deviation).ravel()
        beta = np.linalg.lstsq(A, b, rcond=None)[0]
        assert np.allclose(each.found, np.sqrt(((tau - W @ beta)[chosen] ** 2).mean(axis=0)), rtol=1e-9)
        assert np.allclose(each.stated, np.sqrt(((tau - W @ stated)[chosen] ** 2).mean(axis=0)), rtol=1e-12)
        assert np.allclose(each.measured, np.sqrt((tau[chosen] ** 2).mean(axis=0)), rtol=1e-12)
        assert (each.where, each.samples) == (name, 10)


def test_what_the_others_do_not_show_stays_as_stated():
    W = np.zeros((20, 1, 2))
    W[:10, 0, 0] = W[10:, 0, 1] = 1.0
    stated, tau = np.array([1.0, 2.0]), (W @ np.array([1.5, 2.5]))
    nothing = np.zeros((0, 2)), np.zeros(0)
    times = [np.arange(10.0), np.arange(10.0)]
    told = cross_validated(
        EffortRows(W, tau, *nothing), np.ones(1), stated, tau - W @ stated, tau, parts_of(times, ["a", "b"])
    )
    assert [each.where for each in told] == ["a", "b"]
    assert [each.found.tolist() for each in told] == [[0.5], [0.5]]


def test_an_estimate_says_what_it_makes_of_what_it_has_not_seen(bench):
    """A robot told wrong: on unseen samples found constants miss the noise alone, stated ones much more."""
    model = bench.model
    truth = np.array(model.parameters.values)
    truth[model.parameters.of("inertia")] *= 1.2
    log = bench.log(0)
    u = model.regressor_many(bench.q, bench.v, bench.a) @ truth + 0.005 * np.random.default_rng(1).normal(
        size=(1000, 2)
    )
    columns = dict(log.columns) | {f"u_joint{k + 1}": u[:, k] for k in range(2)}
    found = identify(model, Log(log.t, columns)).held_out
    assert len(found) == 5
    for each in found:
        assert (each.found < 0.0065).all()
        assert (each.stated > 0.01).all()
        assert (each.measured > each.stated).all()
