"""From noisy samples to a motion: q, q̇ and q̈ of the independent coordinates, on the closed set, with their errors.

Each measured column is smoothed alone first: generalised cross-validation (G. Wahba, 1990), or the noise where it is
stated, decides how much, and tells the column's noise. Encoders of passive joints and measured velocities are then
fitted together with the coordinates: a joint's position is that of σ(q), its rate (ρ q̇), so that what comes out is
closed, and every encoder counts by its own noise (Gauss and Newton's iteration; ρ is its slope).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from ccpin.arrays import Array, Indices, Mask, instance, positive
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import ConvergenceError, InvalidInputError
from ccpin.identification.logs.log import Log, one_position, position, require_plain
from ccpin.identification.logs.penalized_splines import (
    DEGREE,
    Knots,
    Measurements,
    SplineErrors,
    SplineFit,
    apart,
    banded,
    fitted,
    freedom,
    inverse_band,
    normal_equations,
    spread,
    variances,
)
from ccpin.mechanism.mechanism import Mechanism

_BEYOND = 5.0  # standard deviations: Gaussian noise is farther off once in 1.7 million samples
_ABOUT = 51  # samples over which residuals are compared: at a jerk all of them are large, about an outlier it alone
_LEAST = 1e-14  # of the largest number, or of a radian or metre: rounding
_ROUNDED = 1e-9  # of a time between samples
_REACH = 2.0  # usual times between two samples: what is farther from any position is not looked at
_MOST_KNOTS = 2000
_FINEST = 10  # knots a sample: more than that is a mistake in units
_ITERATIONS, _CLOSE = 30, 1e-9


class Outlier(NamedTuple):
    """A sample that was left out: its column, its time in s, how many standard deviations it is off, and its log."""

    column: str
    t: float
    off: float
    log: str


class Smoothed(NamedTuple):
    """A motion behind a log, at the log's times.

    Attributes:
        t: Times, s, of shape (T,).
        q, v, a: Independent coordinates, velocities and accelerations, of shape (T, n) each.
        u: Measured efforts of the motors as they are, NaN where there is none, of shape (T, motors).
        near: Whether each coordinate has a position that counts within two of its usual times between samples, or a
            knot's spacing, of shape (T,): beyond it the motion is a guess.
        q_deviation, v_deviation, a_deviation: Their standard deviations, of shape (T, n) each.
        noise: Standard deviation of each position's and velocity's column about the motion, by name: far above what
            the sensor has where sensors contradict one another, or the closures.
        outliers: Samples that were left out.
        errors: How errors of q, q̇ and q̈ at all times are correlated.
    """

    t: Array
    q: Array
    v: Array
    a: Array
    u: Array
    near: Mask
    q_deviation: Array
    v_deviation: Array
    a_deviation: Array
    noise: Mapping[str, float]
    outliers: tuple[Outlier, ...]
    errors: SplineErrors

    def with_efforts(self) -> Indices:
        """The samples that have the efforts of all motors, and positions near by, by number."""
        return np.flatnonzero(self.near & ~np.isnan(self.u).any(axis=1))

    def transmission(self, model: ReducedModel, rows: Indices) -> Array:
        """ρᵀSᵀ at some samples, of shape (len(rows), n, motors)."""
        if model.actuation is None:
            return np.broadcast_to(np.eye(model.n), (len(rows), model.n, model.n))
        return np.asarray(np.swapaxes(model.terms_many(self.q[rows], self.v[rows]).rho, 1, 2) @ model.actuation.T)

    def forces(self, model: ReducedModel, rows: Indices) -> Array:
        """ρᵀSᵀu at some samples, N m or N, of shape (len(rows), n)."""
        return np.asarray(np.einsum("sjk,sk->sj", self.transmission(model, rows), self.u[rows]))


class _Alone(NamedTuple):
    """A column smoothed alone: samples that count, noise, the penalty's weight over the noise's square, the fit."""

    kept: Array
    noise: float
    weight: float
    fit: SplineFit


def smoothed(
    log: Log,
    model: ReducedModel | Mechanism,
    *,
    spacing: float | None = None,
    noise: Mapping[str, float] | None = None,
    smoothness: float = 1.0,
) -> Smoothed:
    """The motion behind a log.

    Args:
        log: Positions of all independent coordinates (``q_…``), and what else was measured.
        model: What moved; its coordinates must be plain numbers (no balls, no continuous joints).
        spacing: Seconds between the spline's knots, well below the shortest time in which the motion turns; by default
            two samples of a coordinate, or a two-thousandth of the log.
        noise: Standard deviations of columns, SI units, where they are known (an encoder's step over √12, say).
        smoothness: The penalty's weight over what cross-validation or noise asks for: less has less bias.

    Raises:
        InvalidInputError: A coordinate is not measured, a column is of no joint, there are too few samples, or more
            than ten knots for each.
        UnsupportedMechanismError: A coordinate is a ball or a circle.
        ConvergenceError: Fitting all sensors together did not converge.
        ConfigurationNotFoundError: Smoothed coordinates are out of reach.
    """
    model, known = model_of(model), {} if noise is None else dict(instance(noise, "noise", Mapping))
    instance(log, "log", Log)
    parts = model.coordinates.parts
    require_plain(model, "smoothing")
    if missing := [part.name for part in parts if f"q_{part.name}" not in log.columns]:
        raise InvalidInputError(f"no column 'q_{missing[0]}' in {log!r}: each independent coordinate must be measured")
    if unknown := [name for name in known if name not in log.columns or name[0] == "u"]:
        raise InvalidInputError(f"noise is stated of '{unknown[0]}', which is no position or velocity of {log!r}")
    positive(smoothness, "smoothness")
    if spacing is None:
        own = [log.t[~np.isnan(log.columns[f"q_{part.name}"])] for part in parts]
        usual = max((float(np.median(np.diff(times))) for times in own if len(times) > 1), default=0.0)
        spacing = max(2.0 * usual, (log.t[-1] - log.t[0]) / _MOST_KNOTS)
    elif positive(spacing, "spacing", "a time in seconds") * len(log.t) * _FINEST < log.t[-1] - log.t[0]:
        raise InvalidInputError(f"spacing = {spacing:g} s is far below the time between samples of {log!r}")
    knots = Knots.over(log.t[0], log.t[-1], spacing)
    basis = [knots.basis(log.t, d) for d in range(3)]
    measured = {name: column for name, column in log.columns.items() if name[0] != "u"}
    alone, outliers = {}, []
    for name in measured:
        stated = positive(known[name], f"the noise of '{name}'") if name in known else None
        alone[name], found = _alone(name, log, knots, basis[0], stated, smoothness)
        outliers += found
    weights = np.array([alone[f"q_{part.name}"].weight for part in parts])
    penalty = sparse.kron(knots.roughness(), sparse.diags_array(weights)).tocsr()
    c = np.column_stack([alone[f"q_{part.name}"].fit.c for part in parts])
    fit, about = _together(model, basis, measured, alone, banded(penalty, model.n), c)
    q, v, a = (np.asarray(each @ fit.c) for each in basis)
    inverse = inverse_band(fit.factor)
    q_deviation, v_deviation, a_deviation = (_deviations(inverse, each, model.n) for each in basis)
    names = model.mechanism.actuated
    efforts = [log.columns.get(f"u_{name}", np.full(len(log.t), np.nan)) for name in names]
    u = np.column_stack(efforts) if efforts else np.zeros((len(log.t), 0))
    told = {name: max(each.noise, about[name]) for name, each in alone.items()}
    left_out = tuple(sorted(outliers, key=lambda each: each.t))
    errors = SplineErrors(basis, fit.factor, penalty, smoothness)
    step = float(knots.t[1] - knots.t[0])
    near = np.all([_near(log.t, log.t[alone[f"q_{part.name}"].kept], step) for part in parts], axis=0)
    return Smoothed(log.t, q, v, a, u, near, q_deviation, v_deviation, a_deviation, told, left_out, errors)


def _near(t: Array, measured: Array, step: float) -> Mask:
    """Which times have a measured one within reach."""
    after = np.clip(np.searchsorted(measured, t), 1, len(measured) - 1)
    away = np.minimum(np.abs(t - measured[after - 1]), np.abs(t - measured[after]))
    return np.asarray(away <= max(_REACH * float(np.median(np.diff(measured))), step) * (1.0 + _ROUNDED))


def _deviations(inverse: Array, design: Any, n: int) -> Array:
    """Standard deviations of the coordinates' values or derivatives, of shape (T, n)."""
    return np.sqrt(np.column_stack([variances(inverse, each) for each in apart(design, n)]))


def _alone(
    name: str, log: Log, knots: Knots, basis: Any, stated: float | None, smoothness: float
) -> tuple[_Alone, list[Outlier]]:
    """A column smoothed by itself; samples beyond five standard deviations go, the worst of each stretch first."""
    column, roughness, outliers = log.columns[name], knots.roughness(), list[Outlier]()
    kept = ~np.isnan(column)
    reach = 2.0 * (knots.t[1] - knots.t[0])
    while True:
        if kept.sum() <= DEGREE:
            raise InvalidInputError(f"'{name}' has {kept.sum()} samples that count; a motion takes more")
        matrix, y = basis[kept], column[kept]
        fit, weight, free = _chosen(matrix, y, roughness, stated, smoothness)
        left = max(kept.sum() - free, 1.0)
        usual = 1.4826 * float(np.median(np.abs(fit.residuals))) * np.sqrt(kept.sum() / left)
        about = 1.4826 * median_filter(np.abs(fit.residuals), _ABOUT, mode="nearest")
        least = _LEAST * max(float(np.abs(y).max()), 1.0)
        off = np.abs(fit.residuals) / np.maximum(about, max(stated or 0.0, usual, least))
        times = log.t[kept]
        worst = [k for k in np.flatnonzero(off > _BEYOND) if off[k] >= off[np.abs(times - times[k]) <= reach].max()]
        if not worst:
            scale = stated or max(float(np.sqrt(fit.residuals @ fit.residuals / left)), least)
            return _Alone(kept, scale, weight / scale**2, fit), outliers
        outliers += [Outlier(name, float(times[k]), float(off[k]), log.source) for k in worst]
        kept = kept.copy()
        kept[np.flatnonzero(kept)[worst]] = False


def _chosen(
    matrix: Any, y: Array, roughness: Any, stated: float | None, smoothness: float
) -> tuple[SplineFit, float, float]:
    """A column's fit whose weight cross-validates best, or leaves residuals as large as its noise explains; freedom."""
    count = len(y)
    normal = normal_equations(Measurements(matrix, y, np.ones(count)), 1)
    unit, rough = float((matrix.T @ matrix).trace() / roughness.trace()), banded(roughness, 1)

    def tried(logarithm: float) -> tuple[SplineFit, float, float]:
        weight = unit * 10.0**logarithm
        return fitted(normal, weight * rough), weight, freedom(normal, weight * rough)

    def score(logarithm: float) -> float:
        fit, _, free = tried(logarithm)
        left, square = max(count - free, 1e-9 * count), float(fit.residuals @ fit.residuals)
        if stated is not None:
            return abs(float(np.log(max(square, np.finfo(float).tiny) / (stated**2 * left))))
        return float(np.log(max(square, np.finfo(float).tiny)) - 2.0 * np.log(left))

    grid = np.arange(-9.0, 10.0)
    least = int(np.argmin([score(each) for each in grid]))
    found = minimize_scalar(
        score, bounds=(grid[least] - 1.0, grid[least] + 1.0), method="bounded", options={"xatol": 0.02}
    )
    return tried(float(found.x) + float(np.log10(smoothness)))


def _together(
    model: ReducedModel,
    basis: list[Any],
    measured: Mapping[str, Array],
    alone: Mapping[str, _Alone],
    penalty: Array,
    c: Array,
) -> tuple[SplineFit, dict[str, float]]:
    """All sensors fitted at once, by Gauss and Newton's iteration from the coordinates' own splines; what each misses.

    That is the root mean square of its residuals, by name.
    """
    own = {f"q_{part.name}": k for k, part in enumerate(model.coordinates.parts)}
    others = [name for name in measured if name not in own]
    direct = [_rows(basis[0], np.eye(model.n)[[k]], measured[name], alone[name]) for name, k in own.items()]
    step = np.inf
    for _ in range(_ITERATIONS):
        rows = [*direct, *(_linearised(model, basis, measured, alone, others, c) if others else ())]
        matrix = sparse.vstack([each.matrix for each in rows]).tocsr()
        together = Measurements(matrix, *(np.concatenate(parts) for parts in list(zip(*rows, strict=True))[1:]))
        fit = fitted(normal_equations(together, model.n), penalty)
        step, c = float(np.abs(basis[0] @ (fit.c - c)).max()), fit.c
        if not others or step <= _CLOSE:
            parts = np.split(fit.residuals, np.cumsum([len(each.y) for each in rows])[:-1])
            sizes = (float(np.sqrt(np.mean(part**2))) for part in parts)
            return fit, dict(zip((*own, *others), sizes, strict=True))
    raise ConvergenceError(f"fitting {', '.join(others)} with the coordinates did not converge: steps of {step:.1e}")


def _linearised(
    model: ReducedModel,
    basis: list[Any],
    measured: Mapping[str, Array],
    alone: Mapping[str, _Alone],
    names: list[str],
    c: Array,
) -> list[Measurements]:
    """Passive positions σ_j(q) about the motion c, and velocities ρ_j q̇ with its ρ."""
    q, found = np.asarray(basis[0] @ c), []
    configurations = model.sigma_many(q)
    rho = np.array([model.rho(each) for each in configurations])
    for name in names:
        joint = one_position(model, name[2:])
        slopes, column = rho[:, joint.v.start], measured[name]
        if name[0] == "q":
            at = position(model, name[2:], configurations)
            if not joint.kind.sliding:  # encoders count whole turns from wherever they were switched on
                at = at + 2.0 * np.pi * np.round(np.nanmedian(column - at) / (2.0 * np.pi))
            column = column - at + (slopes * q).sum(axis=1)
        found.append(_rows(basis[name[0] == "v"], slopes, column, alone[name]))
    return found


def _rows(design: Any, slopes: Array, column: Array, alone: _Alone) -> Measurements:
    """y = Σ_k slope_k B(t) c_k at the samples that count; slopes (T, n), or (1, n) where they are constant."""
    slopes = np.broadcast_to(slopes, (len(column), slopes.shape[1]))
    count = int(alone.kept.sum())
    return Measurements(spread(design[alone.kept], slopes[alone.kept]), column[alone.kept], np.full(count, alone.noise))
