"""What an adaptive law learnt along a motion: the law asked again at all its samples, as the simulation asked it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance
from ccpin.control.sampling import SampledCommands, Sampling
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.proof.digests import require_same
from ccpin.simulation.results.trajectory import Trajectory

_APART = 1e-6  # of the largest effort: an effort asked for again that is this far from what the motors got is another


class EstimateHistory(NamedTuple):
    """An adaptive law along a motion, at its samples.

    Attributes:
        t: Times, s, of shape (N,).
        values: π̂ as it was used then, of shape (N, k).
        e: q − q_d, of shape (N, n). s: ė + Λe, alike.
        lyapunov: V, J, of shape (N,), where the true constants are known, else empty.
    """

    t: Array
    values: Array
    e: Array
    s: Array
    lyapunov: Array


def asked_again(law: Any, motion: Trajectory, sampling: Sampling | None, true: ArrayLike | None) -> EstimateHistory:
    """`AdaptiveTracking.estimates`: a run of the law, asked at the motion's samples."""
    motion, model = instance(motion, "motion", Trajectory), law.model
    require_same("what a law learnt", law.digests, motion.origin._replace(name="the motion"), "closures")
    loop = Sampling(law.period) if sampling is None else instance(sampling, "sampling", Sampling)
    if loop.period != law.period:
        raise InvalidInputError(f"sampling has another period than the law: {loop.period:g} s, not {law.period:g} s")
    rows, run = _rows(motion.t, law.period), law.begin()
    place = 0

    def measured(*_: object) -> tuple[Array, Array, Array]:
        return motion.q[place], motion.v[place], motion.q_free[place]

    start = float(motion.t[0])
    commands = SampledCommands(model, run, loop, motion.q[0], motion.v[0], start, measured)
    values, efforts, found = list[Array](), list[Array](), list[float]()
    for number, row in enumerate(rows.tolist()):
        place, t = row, start + number * law.period
        values.append(run.estimate)
        state = _at(model, motion, row)
        commands.instant(t, state, motion.v[row])
        efforts.append(commands.effort(t, state, motion.v[row]))
        if true is not None:
            found.append(law.lyapunov(t, state, motion.v[row], values[-1], true))
    _require_these(model, np.array(efforts), motion.u[rows])
    t, q, v = motion.t[rows], motion.q[rows], motion.v[rows]
    e = np.array([law.error(*each) for each in zip(t, q, strict=True)])
    s = np.array([law.sliding(*each) for each in zip(t, q, v, strict=True)])
    return EstimateHistory(t, np.array(values), e, s, np.array(found))


def _rows(t: Array, period: float) -> Array:
    """Where a motion's samples are those of a loop of that period.

    Raises:
        InvalidInputError: There is none at one of the loop's instants.
    """
    due = t[0] + np.arange(np.floor((t[-1] - t[0]) / period * (1.0 + 1e-9)) + 1.0) * period
    rows = np.asarray(np.searchsorted(t, due - 1e-6 * period))
    if (rows >= len(t)).any() or (np.abs(t[np.minimum(rows, len(t) - 1)] - due) > 1e-6 * period).any():
        raise InvalidInputError(
            f"the motion has no sample at each of the law's, every {period:g} s: simulate with sample_period={period:g}"
        )
    return rows


def _at(model: ReducedModel, motion: Trajectory, row: int) -> Any:
    q_free = motion.q_free[row]
    return model.at(motion.q[row], q_free if len(q_free) == model.mechanism.nq else None)


def _require_these(model: ReducedModel, efforts: Array, given: Array) -> None:
    """The efforts asked for are those that the motors got, or would be within their limits.

    Raises:
        InvalidInputError: They are others.
    """
    limited = np.clip(efforts, *model.mechanism.motors.limits.T)
    off = np.minimum(np.abs(efforts - given), np.abs(limited - given)).max(initial=0.0)
    if off > _APART * np.abs(given).max(initial=0.0):
        raise InvalidInputError(
            f"asked again, the law gives efforts {off:.3g} from the motion's: it is of another law, was run with "
            "another sampling (give it), motors that lag, or has learnt before this motion begins"
        )
