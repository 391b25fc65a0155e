"""Output error: constants, and lengths, by which simulated motions are nearest to the measured ones.

Least squares of efforts (`estimation`) needs accelerations, takes the geometry as stated, and has
no use for what efforts do only in time. Here a log is cut into shots between reversals, and what is minimised is

    Σ_shots Σ_k ‖(q̂(t_k) − q(t_k; x₀, u, θ)) / s‖²

over the numbers θ and the start x₀ = (q, q̇) of every shot (multiple shooting; H. Bock, Recent advances in parameter
identification techniques for O.D.E., 1983), q moved by the efforts as measured, splines between samples
(`shooting`). Starts are eliminated shot by shot, J = J_θ less what J_x₀ explains, and Gauss and
Newton's steps are halved while the sum grows. Noise in efforts moves a whole shot one way, so that residuals are
correlated within shots, but not between them: with g_s = J_sᵀ r_s the covariance is

    (JᵀJ)⁻¹ (Σ_s g_s g_sᵀ) (JᵀJ)⁻¹ · S / (S − k)

for S shots (K.-Y. Liang and S. Zeger, Longitudinal data analysis using generalized linear models, 1986).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.interpolate import make_interp_spline

from ccpin.arrays import Array, positive, records
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import CcpinError, ConvergenceError, InvalidInputError
from ccpin.identification.calibration.geometry_numbers import changed_mechanism, named_numbers
from ccpin.identification.estimates.effort_samples import samples_of
from ccpin.identification.estimates.shooting import FollowedShots, MotionShot, VariedPlant, followed
from ccpin.identification.logs.log import Log
from ccpin.mechanism.mechanism import Mechanism
from ccpin.programs.recording.constants import Parameter, geometry_of

if TYPE_CHECKING:
    from ccpin.identification.estimates.estimate import Estimate

_STEP = 1e-6  # m: of central differences in lengths
_LEAST = 12  # samples of a shot
_MOST_STEPS, _MOST_HALVINGS = 30, 10
_SETTLED = 1e-3  # of standard deviations
_TOLD = 1e-7  # of the largest singular value: what is below is not told


class Refined(NamedTuple):
    """Constants and lengths of simulated motions that are nearest to logs.

    Attributes:
        names: Of the estimate's combinations, then of lengths.
        values: Of these, of shape (k,). before: Where the search began: the estimate's, and the file's lengths, alike.
        covariance: Of the values, of shape (k, k).
        parameters: All constants that agree with the values.
        model: The mechanism of these lengths, its constants as stated; `with_constants` writes the found ones.
        missed: Root mean square of q̂ − q before and after, rad or m, of shape (2, n).
        shots: How many there are.
    """

    names: tuple[str, ...]
    values: Array
    before: Array
    covariance: Array
    parameters: DynamicParameters
    model: ReducedModel
    missed: Array
    shots: int

    def __repr__(self) -> str:
        return f"Refined({len(self.names)} numbers from {self.shots} shots)"

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, of shape (k,)."""
        return np.sqrt(np.diag(self.covariance))


class _OutputErrors:
    """The logs as shots, with what was added in each, and what is looked for, in units in which it changes alike."""

    def __init__(
        self,
        model: ReducedModel,
        estimate: Estimate,
        geometry: Sequence[Parameter],
        shots: list[MotionShot],
        added: Sequence[Mapping[str, float]],
    ) -> None:
        found = estimate.effects
        self.model, self.geometry, self.shots, self.added = model, tuple(geometry), shots, added
        self.base = estimate.parameters
        noise = [[motion.noise[f"q_{part.name}"] for part in model.coordinates.parts] for motion in estimate.motions]
        self.noise = np.sqrt(np.mean(np.square(noise), axis=0))
        turned = estimate.multiples[:, found.columns] @ (found.basis / found.scale[:, None])
        self.tangent = np.zeros((len(self.base), len(estimate.values)))
        self.tangent[found.columns] = (found.basis / found.scale[:, None]) @ np.linalg.inv(turned)
        self.start = np.r_[estimate.values, [each.value for each in geometry]]

    def constants(self, values: Array) -> DynamicParameters:
        """π."""
        k = self.tangent.shape[1]
        return replace(self.base, values=self.base.values + self.tangent @ (values - self.start)[:k])

    def changed(self, lengths: Array) -> ReducedModel:
        """The mechanism with other lengths."""
        told = {(each.kind, each.of): float(x) for each, x in zip(self.geometry, lengths, strict=True)}
        if not told:
            return self.model
        return ReducedModel(changed_mechanism(self.model.mechanism, told), self.model.gravity_vector)

    def at(self, values: Array, starts: Array) -> tuple[list[Array], list[Array], list[Array]]:
        """What is left of each shot over its noise (K n,), and its derivatives by starts and by numbers."""
        told = self._followed(values, starts)
        found: tuple[list[Array], list[Array], list[Array]] = ([], [], [])
        for shot, q, by_start, by_numbers in zip(self.shots, told.q, told.by_start, told.by_numbers, strict=True):
            there = ~np.isnan(shot.q)
            weight = np.broadcast_to(1.0 / self.noise, shot.q.shape)[there]
            found[0].append((shot.q - q)[there] * weight)
            found[1].append(by_start[there] * weight[:, None])
            found[2].append(by_numbers[there] * weight[:, None])
        return found

    def _followed(self, values: Array, starts: Array) -> FollowedShots:
        """The motions of all shots, those with the same added constants at once."""
        lengths, unit = values[self.tangent.shape[1] :], np.eye(len(self.geometry))
        pairs = tuple((self.changed(lengths + _STEP * e), self.changed(lengths - _STEP * e)) for e in unit)
        model, constants = self.changed(lengths), self.constants(values)
        told, first = FollowedShots([], [], []), 0
        for added, run in groupby(self.added):
            own = slice(first, first + len(list(run)))
            plant = VariedPlant(model, constants.plus(added).values, self.tangent, pairs, (_STEP,) * len(unit))
            for all_of_them, found in zip(told, followed(plant, self.shots[own], starts[own]), strict=True):
                all_of_them += found
            first = own.stop
        return told


def refined(
    model: ReducedModel | Mechanism,
    estimate: Estimate,
    logs: Log | Iterable[Log],
    geometry: Sequence[str],
    horizon: float,
) -> Refined:
    """`Estimate.refined`."""
    model = model_of(model)
    logs = records([logs] if isinstance(logs, Log) else logs, "logs", Log)
    if len(logs) != len(estimate.motions) or model.parameters.names != estimate.parameters.names:
        raise InvalidInputError("these are not the logs, or not the mechanism, that the estimate is of")
    if estimate.motors.names:
        raise InvalidInputError("with motors' constants take another estimate, of `motors.corrected(log)`")
    named = named_numbers(geometry_of(model), geometry, "geometry") if geometry else ()
    shots, starts, added = _cut(model, estimate, logs, positive(horizon, "horizon", "a positive number of seconds"))
    search = _OutputErrors(model, estimate, named, shots, added)
    return _solved(search, starts, (*estimate.combinations, *(each.name for each in named)))


def _cut(
    model: ReducedModel, estimate: Estimate, logs: Sequence[Log], horizon: float
) -> tuple[list[MotionShot], Array, list[Mapping[str, float]]]:
    """Shots, where the smoothed motions have them begin, and what was added."""
    shots, starts, loads = [], [], list[Mapping[str, float]]()
    spoilt = {(each.log, each.t) for each in estimate.outliers}
    for log, late, motion, added in zip(logs, estimate.delays, estimate.motions, estimate.added, strict=True):
        on_time = log.delayed({"u": late.taken}) if late.taken else log
        if not np.array_equal(on_time.t, motion.t):
            raise InvalidInputError(f"{log!r} is not one of the logs that the estimate is of")
        columns = [f"q_{part.name}" for part in model.coordinates.parts]
        measured = np.column_stack([on_time.columns[name] for name in columns])
        for each in motion.outliers:
            if each.column in columns:
                measured[on_time.t == each.t, columns.index(each.column)] = np.nan
        samples = samples_of(model, motion, True)
        for number in np.unique(samples.stretch):
            rows = samples.chosen[samples.stretch == number]
            first = rows[0]
            count = max(1, int(np.ceil((motion.t[rows[-1]] - motion.t[first]) / horizon)))
            for part in np.array_split(rows, count):
                if len(part) < _LEAST or spoilt & {(late.log, t) for t in motion.t[part].tolist()}:
                    continue
                t, u = motion.t[part], motion.u[part]
                between = make_interp_spline(t, u, 3)((t[1:] + t[:-1]) / 2.0)
                shots.append(MotionShot(t, measured[part], u, between))
                starts.append(np.r_[motion.q[part[0]], motion.v[part[0]]])
                loads.append(added)
    if not shots:
        raise InvalidInputError(f"between reversals there are nowhere {_LEAST} samples in a row: sample faster")
    return shots, np.array(starts), loads


def _solved(search: _OutputErrors, starts: Array, names: tuple[str, ...]) -> Refined:
    """Gauss–Newton's iteration."""
    values = search.start.copy()
    left, by_start, by_numbers = search.at(values, starts)
    first = _missed(search, left)
    for _ in range(_MOST_STEPS):
        parted = [np.linalg.qr(each) for each in by_start]
        J = [N - q @ (q.T @ N) for (q, _), N in zip(parted, by_numbers, strict=True)]
        whole = np.concatenate(J)
        unit = np.maximum(np.linalg.norm(whole, axis=0), np.finfo(float).tiny)
        _, size, turned = np.linalg.svd(whole / unit, full_matrices=False)
        if size[-1] < _TOLD * size[0]:
            worst = names[int(np.argmax(np.abs(turned[-1])))]
            raise InvalidInputError(f"the logs do not tell '{worst}' from the other numbers: leave one out")
        inverse = (turned.T / size**2) @ turned / np.outer(unit, unit)
        gradient = [each.T @ r for each, r in zip(J, left, strict=True)]
        step = inverse @ np.sum(gradient, axis=0)
        spread = len(J) / max(len(J) - len(step), 1)
        covariance = inverse @ sum(np.outer(g, g) for g in gradient) @ inverse * spread
        moved = np.array(
            [np.linalg.solve(r, q.T @ (e - N @ step)) for (q, r), e, N in zip(parted, left, by_numbers, strict=True)]
        )
        deviations = np.sqrt(np.diag(covariance))
        if (np.abs(step) <= _SETTLED * deviations).all():
            changed = search.changed(values[search.tangent.shape[1] :])
            missed, parameters = np.array([first, _missed(search, left)]), search.constants(values)
            return Refined(names, values, search.start, covariance, parameters, changed, missed, len(search.shots))
        cost, share = sum(float(r @ r) for r in left), 1.0
        for _ in range(_MOST_HALVINGS):
            try:
                left, by_start, by_numbers = search.at(values + share * step, starts + share * moved)
            except CcpinError:
                share /= 2.0
                continue
            if sum(float(r @ r) for r in left) <= cost * (1.0 + 1e-9):
                break
            share /= 2.0
        else:
            raise ConvergenceError(
                "no step brings simulated motions nearer to the measured ones: a shorter horizon may"
            )
        values, starts = values + share * step, starts + share * moved
    raise ConvergenceError(f"constants of simulated motions did not settle in {_MOST_STEPS} steps")


def _missed(search: _OutputErrors, left: Sequence[Array]) -> Array:
    """Root mean square of q̂ − q of each coordinate."""
    squares, count = np.zeros(search.model.n), np.zeros(search.model.n)
    for shot, r in zip(search.shots, left, strict=True):
        there = ~np.isnan(shot.q)
        own = np.zeros(shot.q.shape)
        own[there] = r
        squares += ((own * search.noise) ** 2).sum(axis=0)
        count += there.sum(axis=0)
    return np.asarray(np.sqrt(squares / np.maximum(count, 1.0)))
