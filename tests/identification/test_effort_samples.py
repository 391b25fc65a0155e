"""Which samples count, and where one stretch of a motion ends."""

import numpy as np

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
