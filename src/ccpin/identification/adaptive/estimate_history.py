"""What an adaptive law learnt along a motion: the law asked again at all its samples, as the simulation asked it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance
from ccpin.control.control_law import stated
from ccpin.control.sampling import SampledCommands, Sampling
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.proof.digests import require_same
from ccpin.simulation.integration.core_numbers import law_numbers
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
    rows = _rows(motion.t, law.period)
    t, q, v = float(motion.t[0]) + law.period * np.arange(len(rows)), motion.q[rows], motion.v[rows]
    values, efforts = _in_core(law, loop, t, motion, rows) or _in_python(law, loop, t, motion, rows)
    _require_these(model, efforts, motion.u[rows])
    wanted = [law.reference.at(when) for when in t.tolist()]
    e = np.array([model.coordinates.difference(goal.q, x) for goal, x in zip(wanted, q, strict=True)])
    s = v - np.array([goal.v for goal in wanted]) + e @ law.slope.T
    V = list[float]()
    if true is not None:
        at = zip(t.tolist(), rows.tolist(), values, strict=True)
        V = [law.lyapunov(when, _at(model, motion, row), motion.v[row], x, true) for when, row, x in at]
    return EstimateHistory(motion.t[rows], values, e, s, np.array(V))


def _in_core(law: Any, loop: Sampling, t: Array, motion: Trajectory, rows: Array) -> tuple[Array, Array] | None:
    """Estimates and efforts held at each sample; ``None`` where only the reference can tell."""
    run, model = law.begin(), law.model
    told = law_numbers(model, stated(run))
    if told is None or np.any(loop.encoder_noise) or motion.q_free.shape[1] != model.mechanism.nq:
        return None
    numbers = SampledCommands(model, run, loop, motion.q[0], motion.v[0], t[0]).numbers()
    found = model.core.learnt(told, numbers, t, motion.q[rows], motion.v[rows], motion.q_free[rows])
    return None if found is None else (found[0], found[1])


def _in_python(law: Any, loop: Sampling, t: Array, motion: Trajectory, rows: Array) -> tuple[Array, Array]:
    """The same of any law, loop and motion."""
    run, model, place = law.begin(), law.model, 0

    def measured(*_: object) -> tuple[Array, Array, Array]:
        return motion.q[place], motion.v[place], motion.q_free[place]

    commands = SampledCommands(model, run, loop, motion.q[0], motion.v[0], t[0], measured)
    values, efforts = list[Array](), list[Array]()
    for when, place in zip(t.tolist(), rows.tolist(), strict=True):
        values.append(run.estimate)
        state = _at(model, motion, place)
        commands.instant(when, state, motion.v[place])
        efforts.append(commands.effort(when, state, motion.v[place]))
    return np.array(values), np.array(efforts)


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
            "another sampling (give it), motors that lag or have other limits than the law's model states, or has "
            "learnt before this motion begins"
        )
