"""Motors' constants from logs: a column says u_j, the motor's effort is k_j u_j, and Y π = ρᵀSᵀ diag(k) u.

Noise is in u, so that k stands with what is free of it: with A = ρᵀSᵀ square, what is compared is

    A u = M Y π + noise,    M = A diag(1/k) A⁻¹,    ∂(M Y π)/∂k_j = −A_j (A⁻¹ M Y π)_j / k_j,

linear in π at each k, and solved by Gauss and Newton's iteration with these columns beside M Y (regression of Y π on
A diag(k) u would make k too small: W. Fuller, Measurement error models, 1987). Without friction or other constants that
are taken as stated, π and k scaled alike explain a log alike: what is known beforehand of a motor or of bodies fixes
the scale, and how well is in the covariance; where nothing does, nothing is told. k is the mode of its own posterior,
not of k's and π's together, which is below it where bodies fix the scale (`marginal_motors`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, instance, inverses
from ccpin.description.names import choices
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import ConvergenceError, InvalidInputError
from ccpin.identification.estimates.effort_samples import EffortSamples
from ccpin.identification.estimates.marginal_motors import marginal_rows
from ccpin.identification.estimates.robust_fit import EffortRows, RobustFit, fitted_robustly, with_columns
from ccpin.identification.estimates.stated_priors import deviation
from ccpin.identification.logs.log import Log

_MOST_STEPS, _LEAST_SHARE = 50, 0.1
_SETTLED, _ROUNDING = 1e-2, 1e-9  # of deviations; of k
_FIXED = 1e-8  # of a column's size: less of it that no constant explains is rounding


class MotorConstants(NamedTuple):
    """What logs tell of motors.

    Attributes:
        names: Of m motors.
        values: k of each, its true effort over what its column says, of shape (m,).
        covariance: Of these, of shape (m, m).
        with_values: Their covariance with the estimate's values, of shape (m, r).
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    with_values: Array

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, of shape (m,)."""
        return np.sqrt(np.diag(self.covariance))

    def corrected(self, log: Log) -> Log:
        """A log whose efforts are k times what it says.

        Raises:
            InvalidInputError: It has no effort of one of the motors.
        """
        columns = dict(instance(log, "log", Log).columns)
        for name, k in zip(self.names, self.values, strict=True):
            if f"u_{name}" not in columns:
                raise InvalidInputError(f"no column 'u_{name}' in {log!r}")
            columns[f"u_{name}"] = columns[f"u_{name}"] * k
        return Log(log.t, columns, log.source)


class StatedMotors(NamedTuple):
    """Motors whose constants are looked for: names, places among all, and the deviations of k about 1, ∞: unknown."""

    names: tuple[str, ...]
    places: Indices
    deviations: Array


class FittedMotors(NamedTuple):
    """A fit, linear about the last k.

    Attributes:
        samples: Those given, Y as columns say it: M Y.
        rows: M W β = A u.
        both: The same with columns beside M W, those given, then those by k, and what is known of k; what is integrated
            out tells of k as rows known beforehand do (`marginal_rows`). fit: Of these.
        k: Of all motors; ``None``: not asked for.
    """

    samples: Sequence[EffortSamples]
    rows: EffortRows
    both: EffortRows
    fit: RobustFit
    k: Array | None


def asked_motors(model: ReducedModel, asked: object) -> StatedMotors:
    """All motors alike, none, or those of a mapping.

    Raises:
        InvalidInputError: Neither a share nor a number nor a mapping of these, a name of no motor, or motors that are
            not as many as coordinates.
    """
    names = model.mechanism.actuated
    if isinstance(asked, bool):
        asked = dict.fromkeys(names) if asked else {}
    elif not isinstance(asked, Mapping):
        asked = dict.fromkeys(names, deviation(asked, 1.0, "motors", "all"))
    if asked and len(names) != model.n:
        raise InvalidInputError(f"motors: {len(names)} motors of {model.n} coordinates: what each gives is not told")
    for name in asked:
        if name not in names:
            raise InvalidInputError(f"motors: '{name}' is no motor; {choices(str(name), names)}")
    known = tuple(name for name in names if name in asked)
    told = [np.inf if asked[name] is None else deviation(asked[name], 1.0, "motors", name) for name in known]
    return StatedMotors(known, np.array([names.index(name) for name in known], dtype=np.intp), np.array(told))


def as_logged(A: Array, k: Array) -> Array:
    """M = A diag(1/k) A⁻¹: what a force Y π is by what columns say, of shape (N, n, n)."""
    return np.asarray(A @ (np.linalg.inv(A) / k[:, None]))


def fitted_motors(
    model: ReducedModel,
    samples: Sequence[EffortSamples],
    rows_of: Callable[[Sequence[EffortSamples]], EffortRows],
    beside: Callable[[Sequence[EffortSamples]], Array],
    asked: StatedMotors,
    robust: bool,
) -> FittedMotors:
    """β and k by Gauss and Newton's iteration from k = 1, whose steps in k are those of 1/k, in which M is linear.

    Args:
        model: The mechanism.
        samples: With Y.
        rows_of: W β = τ of samples.
        beside: Columns beside W, of shape (N, n, s), of samples.
        asked: Whose constants are looked for.
        robust: Leave out efforts that are grossly off.

    Raises:
        InvalidInputError: Nothing fixes the scale of constants and motors.
        ConvergenceError: The iteration does not settle.
    """
    rows = rows_of(samples)
    both = with_columns(rows, beside(samples))
    fit = fitted_robustly(both, robust)
    if not asked.names:
        return FittedMotors(samples, rows, both, fit, None)
    parts = [each.motion.transmission(model, each.chosen) for each in samples]
    A, force = np.concatenate(parts), np.concatenate([each.force for each in samples])
    inverse = inverses(A)
    k, r, own, m = np.ones(model.n), rows.W.shape[2], asked.places, len(asked.names)
    for turn in range(_MOST_STEPS):
        drawn = [s._replace(Y=as_logged(a, k) @ s.Y) for s, a in zip(samples, parts, strict=True)]
        rows = rows_of(drawn)
        efforts = np.einsum("sij,sj->si", inverse, force - rows.left(fit.beta[:r])) / k
        free = with_columns(rows, beside(drawn))
        both = with_columns(free, -(A * efforts[:, None])[..., own])
        both = _with_known(both, np.eye(m) / asked.deviations[:, None], (1.0 - k[own]) / asked.deviations)
        if not turn:
            _require_scale(both, fit.deviation, asked.names)
        counted = fit.counted
        further, p = marginal_rows(free.of(counted), A[counted][..., own], inverse[counted][:, own], fit.deviation)
        both = _with_known(both, further / k[own], p)
        fit = fitted_robustly(both, robust)
        step = fit.beta[-m:]
        away = np.linalg.solve(fit.root[-m:, -m:], step)
        if away @ away <= _SETTLED**2 or (np.abs(step) <= _ROUNDING * k[own]).all():
            return FittedMotors(drawn, rows, both, fit, k)
        k[own] = k[own] / np.maximum(1.0 - step / k[own], _LEAST_SHARE)
    raise ConvergenceError(f"motors' constants do not settle: they seem to be {k[own]}")


def told_motors(asked: StatedMotors, k: Array | None, covariance: Array, to_values: Array) -> MotorConstants:
    """Of the covariance of (β̂, …, k̂), β̂'s made that of the values."""
    first, r = len(covariance) - len(asked.names), len(to_values)
    values = np.zeros(0) if k is None else k[asked.places]
    return MotorConstants(asked.names, values, covariance[first:, first:], covariance[first:, :r] @ to_values.T)


def _with_known(rows: EffortRows, further: Array, p: Array) -> EffortRows:
    """Rows of what is known of the last columns besides."""
    further = np.pad(further, ((0, 0), (rows.P.shape[1] - further.shape[1], 0)))
    return rows._replace(P=np.concatenate([rows.P, further]), p=np.r_[rows.p, p])


def _require_scale(rows: EffortRows, deviation: Array, names: Sequence[str]) -> None:
    """Check that no motors' columns are explained by constants, and by other motors', whose scale is then anyone's."""
    m, columns = len(names), rows.W.shape[2]
    stacked = np.concatenate([(rows.W / deviation[:, None]).reshape(-1, columns), rows.P])
    triangle = np.asarray(np.linalg.qr(stacked, mode="r"))[:, columns - m :]
    _, size, turned = np.linalg.svd(triangle[columns - m :] / np.linalg.norm(triangle, axis=0))
    if size[-1] <= _FIXED:
        named = ", ".join(name for name, share in zip(names, np.abs(turned[-1]), strict=True) if share > _LEAST_SHARE)
        raise InvalidInputError(
            f"motors: nothing fixes the scale of {named}: with motors and all constants larger alike logs are as they "
            "were. State how well one motor is known ('10 %'), a prior of bodies ({'inertia': '5 %'}), what was added "
            "in another log (a load that was weighed), or less kinds"
        )
