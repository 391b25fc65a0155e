"""The samples of a log that count: those with all efforts, at which no joint that rubs may stand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, Indices, Mask
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.identification.estimates.robust_fit import RobustFit
from ccpin.identification.logs.smoothing import Outlier, Smoothed

_GAP = 1.5  # of the usual time between two samples: one is missing
_SURE = 4.0  # standard deviations of a velocity within which its sign is not known
_NIL = 1e-9  # of q̇: a joint that is no faster stands, as those of a Delta's parallelograms do that rounding moves


class EffortSamples(NamedTuple):
    """A log's samples.

    Attributes:
        motion: The smoothed log.
        chosen: Which of its times count, by number, of shape (K,). left: How many with efforts do not.
        stretch: Of each the number of a stretch without gaps in which no joint turns back, of shape (K,).
        rates: q̇′, of shape (K, n′).
        Y: The regressor, of shape (K, n, p). force: ρᵀSᵀu as measured, of shape (K, n).
        added: By how much constants are known to be larger in this log, by name.
    """

    motion: Smoothed
    chosen: Indices
    left: int
    stretch: Indices
    rates: Array
    Y: Array
    force: Array
    added: Mapping[str, float]

    @property
    def t(self) -> Array:
        """Their times, s, of shape (K,)."""
        return self.motion.t[self.chosen]


def samples_of(
    model: ReducedModel, motion: Smoothed, rubbing: bool, added: Mapping[str, float] | None = None
) -> EffortSamples:
    """Those of a smoothed log."""
    rows = motion.with_efforts()
    terms = model.terms_many(motion.q[rows], motion.v[rows])
    rates = np.einsum("sij,sj->si", terms.rho, motion.v[rows])
    spread = np.sqrt(np.einsum("sij,sj->si", terms.rho**2, motion.v_deviation[rows] ** 2))
    moves = np.abs(terms.rho).max(axis=(0, 2), initial=0.0) > _NIL
    sure = np.abs(rates[:, moves]) > _SURE * spread[:, moves]
    turning = sure.all(axis=1) if rubbing else np.ones(len(rows), dtype=bool)
    chosen = rows[turning]
    Y = model.regressor_many(motion.q[chosen], motion.v[chosen], motion.a[chosen])
    ways, apart = np.sign(rates[turning][:, moves]), np.diff(motion.t[chosen])
    gaps = apart > _GAP * np.median(np.diff(motion.t[rows])) if len(apart) else apart > 0.0
    stretch = np.cumsum(np.r_[0, (ways[1:] != ways[:-1]).any(axis=1) | gaps])[: len(chosen)]
    left, force = int(len(rows) - len(chosen)), motion.forces(model, chosen)
    return EffortSamples(motion, chosen, left, stretch, rates[turning], Y, force, added or {})


def by_log(samples: Sequence[EffortSamples], values: NDArray[Any]) -> list[NDArray[Any]]:
    """What all samples have, one log's after the other's, log by log."""
    return np.split(values, np.cumsum([len(each.chosen) for each in samples])[:-1])


def autocorrelation(samples: Sequence[EffortSamples], left: Array, counted: Mask) -> Array:
    """Σ x_i x_{i+1} / Σ x_i² of what is left of each row, of shape (n,), over neighbours in a stretch that count."""
    stretches = np.concatenate([np.column_stack([np.full(len(s.chosen), k), s.stretch]) for k, s in enumerate(samples)])
    pairs = (stretches[1:] == stretches[:-1]).all(axis=1) & counted[1:] & counted[:-1]
    power = 0.5 * (left[1:][pairs] ** 2 + left[:-1][pairs] ** 2).sum(axis=0)
    return np.asarray((left[1:] * left[:-1])[pairs].sum(axis=0) / np.maximum(power, np.finfo(float).tiny))


def effort_outliers(
    model: ReducedModel, samples: Sequence[EffortSamples], logs: Sequence[str], fit: RobustFit, left: Array
) -> Iterator[Outlier]:
    """Samples that a fit leaves out, by the motor whose effort alone explains most of it.

    A motor that is off by e adds e b to what is left, b its column of ρᵀSᵀ: the b taken is that nearest to it, rows
    counted by their deviations. `logs` are the samples' names.
    """
    motors, told = np.eye(len(model.mechanism.actuated)), (by_log(samples, x) for x in (fit.counted, fit.off, left))
    for each, log, counted, off, missed in zip(samples, logs, *told, strict=True):
        for k in np.flatnonzero(~counted).tolist():
            state = model.at(each.motion.q[each.chosen[k]])
            felt = np.array([state.generalized_force(motor) for motor in motors]) / fit.deviation
            size = np.maximum(np.linalg.norm(felt, axis=1), np.finfo(float).tiny)
            worst = int(np.argmax(np.abs(felt @ (missed[k] / fit.deviation)) / size))
            name = f"u_{model.mechanism.actuated[worst]}"
            yield Outlier(name, float(each.t[k]), float(off[k]), log)
