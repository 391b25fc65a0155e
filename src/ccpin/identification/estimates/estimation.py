"""The constants of a mechanism from logs: weighted least squares of Y π = ρᵀSᵀu, with its covariance.

A log's motion is smoothed first (`smoothing`); each sample with all efforts gives the n rows of
Y(q, q̇, q̈) π = ρᵀSᵀu (22). What the rows tell apart is β = Vᵀ S π (`felt_combinations`); with Σ the efforts' noise,
found from the residuals, β̂ = C Wᵀ Σ⁻¹ τ with C = (Wᵀ Σ⁻¹ W)⁻¹ (`robust_fit`). C is its covariance where what is left is
white; where it is not that is counted (`coloured_noise`), and what errors of the smoothed motion add (`motion_errors`).
(C. Atkeson, C. An and J. Hollerbach, Estimation of inertial parameters of manipulator loads and links, International
Journal of Robotics Research 5, 1986; M. Gautier, Numerical calculation of the base inertial parameters, 1991.)

A constant of which something is known beforehand is told whether logs show it or not: V spans what motors feel and all
such constants, and β̂ and C are the posterior's. A sample at which a joint with friction may turn either way within what
its velocity is known to is left out. Where Stribeck's friction is asked for, its speeds are found beside
(`stribeck_search`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, instance, records
from ccpin.dynamics.changed_constants import with_stribeck_speeds
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import ConvergenceError, InvalidInputError
from ccpin.identification.estimates.clock_delays import Delay, further_delays, slopes
from ccpin.identification.estimates.coloured_noise import with_coloured_noise
from ccpin.identification.estimates.effort_samples import (
    EffortSamples,
    autocorrelation,
    by_log,
    effort_outliers,
    samples_of,
)
from ccpin.identification.estimates.estimate import Estimate
from ccpin.identification.estimates.felt_combinations import Effects, Motions, checked_kinds, effects
from ccpin.identification.estimates.held_out import cross_validated, parts_of
from ccpin.identification.estimates.motion_errors import with_motion_errors
from ccpin.identification.estimates.motor_constants import (
    FittedMotors,
    StatedMotors,
    asked_motors,
    fitted_motors,
    told_motors,
)
from ccpin.identification.estimates.robust_fit import EffortRows, RobustFit
from ccpin.identification.estimates.stated_priors import Prior, stated_prior
from ccpin.identification.estimates.stribeck_friction import (
    NO_SPEEDS,
    FoundSpeeds,
    asked_joints,
    stribeck_columns,
    told_friction,
    with_effect,
)
from ccpin.identification.estimates.stribeck_search import found_speeds
from ccpin.identification.logs.log import Log, same
from ccpin.identification.logs.smoothing import smoothed
from ccpin.mechanism.mechanism import Mechanism

_SMOOTHNESS = 0.3  # a third of what serves the motion best: what is cut off peaks of q̈ would come back as constants
_COUNTS = 1e-9  # of a combination's largest multiple: smaller ones are rounding
_ALIGNED, _MOST_TURNS = 0.1, 6  # standard deviations of a delay that are not worth another turn; turns
_FAR = 0.05  # of a log: clocks that are farther apart are no clocks that are late


def identify(
    model: ReducedModel | Mechanism,
    logs: Log | Iterable[Log],
    *,
    kinds: Sequence[str] | None = None,
    spacing: float | None = None,
    noise: Mapping[str, float] | None = None,
    prior: Mapping[str, float | str] | None = None,
    robust: bool = True,
    align: bool = False,
    stribeck: bool | Sequence[str] = False,
    motors: bool | str | float | Mapping[str, str | float | None] = False,
    added: Sequence[Mapping[str, float]] | None = None,
) -> Estimate:
    """What logs tell of a mechanism's constants.

    Args:
        model: The mechanism as it is described; its geometry is taken as it is.
        logs: One or more, with positions of the independent coordinates and efforts of all motors.
        kinds: Of parameters to find (`ReducedModel.parameters`: ``"inertia"``, ``"friction"``, …), all others are taken
            as stated; by default inertias, armatures, dampers and friction, and springs where the model has any.
        spacing: Between the knots of the motions' splines, s (`smoothed`).
        noise: Standard deviations of columns where they are known (`smoothed`).
        prior: How well the model's own constants are known, by kind (``"mass"``, ``"inertia"``) or name
            (``"friction:hip"``): standard deviations in their units, or shares, ``"5 %"``
            (`ccpin.identification.estimates.stated_priors`). Such constants are told apart where logs do not.
        robust: Leave out efforts that are more than five deviations off (`robust_fit`).
        align: Set the efforts' clocks right (`Log.delayed`), each log's by what leaves least of it.
        stribeck: Look for a Stribeck effect of these joints (of one velocity), or of all, beside the kinds: breakaway
            levels as ``stribeck:JOINT``, and speeds. What is told is `Estimate.model`'s; a joint of which the logs tell
            none has Coulomb's friction.
        motors: Look for factors k of motors' efforts as well, each known to be 1 to a share (``"10 %"``) or deviation,
            of all or by name; of ``None`` nothing is known, nor of any with ``True``
            (`ccpin.identification.estimates.motor_constants`). Motors that are not named are as their columns say.
        added: Of each log by how much constants were larger than in the others, by name, as those of a load that was
            weighed: taken as exact. What is told is of the mechanism without; ``{}``: as it is.

    Raises:
        InvalidInputError: No log, or one twice, an effort was not measured, too few samples to tell anything, a prior
            of what is not looked for, a Stribeck effect of joints without friction, motors that are not as many as
            coordinates, nothing that fixes their scale, efforts that are all 0, or what was added is not told of each
            log, or of no constant.
        UnsupportedMechanismError: A coordinate is a ball or a circle.
        ConvergenceError: Clocks that are so far apart that setting them right does not settle, or motors' constants.
    """
    model = model_of(model)
    logs = records([logs] if isinstance(logs, Log) else logs, "logs", Log)
    if not logs:
        raise InvalidInputError("no log: there is nothing to learn from")
    for (j, log), (k, other) in combinations(enumerate(logs), 2):
        if same(log, other):
            raise InvalidInputError(f"logs[{j}] and logs[{k}] are one: what it tells would count twice")
    for name, value in (("robust", robust), ("align", align)):
        instance(value, name, bool, "True or False")
    asked, given, drives = asked_joints(model, stribeck), model, asked_motors(model, motors)
    model = with_stribeck_speeds(given, dict.fromkeys(asked, 0.0))
    kinds = checked_kinds(kinds, model)
    if asked and "friction" not in kinds:
        raise InvalidInputError("stribeck: 'friction' is not among the kinds that are looked for")
    known = stated_prior(model.parameters, model.parameters.of(*kinds), prior)
    loads = _loads(model, added, len(logs))
    for log in logs:
        if missing := [name for name in model.mechanism.actuated if f"u_{name}" not in log.columns]:
            raise InvalidInputError(f"no column 'u_{missing[0]}' in {log!r}: each motor's effort must be measured")
    taken, most = np.zeros(len(logs)), _FAR * np.array([log.t[-1] - log.t[0] for log in logs])
    for turn in range(_MOST_TURNS):
        on_time = [log.delayed({"u": late}) if late else log for log, late in zip(logs, taken.tolist(), strict=True)]
        motions = [smoothed(log, model, spacing=spacing, noise=noise, smoothness=_SMOOTHNESS) for log in on_time]
        rubbing = "friction" in kinds
        samples = [samples_of(model, each, rubbing, load) for each, load in zip(motions, loads, strict=True)]
        found = _effects(model, samples, kinds, known)
        rows_of = partial(_rows, model, found=found, known=known)
        driven = fitted_motors(model, samples, rows_of, partial(NO_SPEEDS.slopes, model), drives, robust)
        delays = _further(samples, driven.rows, driven.fit)
        if not align or (np.abs(delays[0]) <= _ALIGNED * delays[1]).all():
            break
        taken = taken + delays[0]
        if turn == _MOST_TURNS - 1 or (np.abs(taken) > most).any():
            raise ConvergenceError(f"setting the efforts' clocks right does not settle: they seem to be {taken} s late")
    plain = _Fitted(model, samples, found, driven)
    speeds = found_speeds(driven.both, stribeck_columns(model, driven.samples, asked), robust)
    best = plain
    if speeds.speeds:
        best = _with_stribeck(given, plain, speeds, (*kinds, "stribeck"), prior, drives, robust)
        delays = _further(best.samples, best.rows, best.fit)
    told = zip(logs, *delays, taken, strict=True)
    late = tuple(Delay(log.source, float(d + own), float(off), float(own)) for log, d, off, own in told)
    return _estimate(best, plain, speeds, drives, late)


def _loads(model: ReducedModel, added: object, logs: int) -> tuple[Mapping[str, float], ...]:
    """What was added in each log."""
    told: tuple[Mapping[str, float], ...] = ({},) * logs if added is None else records(added, "added", Mapping)
    if len(told) != logs:
        raise InvalidInputError(f"added: {len(told)} of {logs} logs are told of; say {{}} where nothing was added")
    for each in told:
        model.parameters.plus(each)
    return told


class _Fitted(NamedTuple):
    """A model, samples, what they tell apart, and a fit, in which Stribeck speeds and motors' constants follow β."""

    model: ReducedModel
    samples: Sequence[EffortSamples]
    effects: Effects
    driven: FittedMotors

    @property
    def rows(self) -> EffortRows:
        """W β = τ."""
        return self.driven.rows

    @property
    def fit(self) -> RobustFit:
        """Of the rows with their slopes."""
        return self.driven.fit

    @property
    def stated(self) -> Array:
        """β of the model's own constants."""
        found = self.effects
        return np.asarray(found.basis.T @ (found.scale * self.model.parameters.values[found.columns]))

    @property
    def beta(self) -> Array:
        """β̂, of shape (r,)."""
        return self.fit.beta[: self.rows.W.shape[2]]


def _with_stribeck(
    given: ReducedModel,
    plain: _Fitted,
    speeds: FoundSpeeds,
    kinds: Sequence[str],
    prior: Mapping[str, float | str] | None,
    drives: StatedMotors,
    robust: bool,
) -> _Fitted:
    """The fit with an effect of the joints of which it is told; ∂(E δ)/∂v_s stand beside W."""
    joints = dict.fromkeys(each.joint for each in speeds.told)
    model = with_stribeck_speeds(given, dict.fromkeys(joints, 0.0) | speeds.speeds)
    samples = [with_effect(plain.model, model, each, speeds) for each in plain.samples]
    known = stated_prior(model.parameters, model.parameters.of(*kinds), prior)
    found = _effects(model, samples, kinds, known)
    rows_of = partial(_rows, model, found=found, known=known)
    slopes = partial(speeds.slopes, model)
    return _Fitted(model, samples, found, fitted_motors(model, samples, rows_of, slopes, drives, robust))


def _effects(model: ReducedModel, samples: Sequence[EffortSamples], kinds: Sequence[str], known: Prior) -> Effects:
    """What motors feel in the box of the logs' motions, and all constants of which something is known."""
    used, left = sum(len(each.chosen) for each in samples), sum(each.left for each in samples)
    if used <= len(model.parameters.of(*kinds)):
        raise InvalidInputError(f"{used} samples count, {left} were left out: too few to tell anything")
    q = np.concatenate([each.motion.q for each in samples])
    low, high = q.min(axis=0), q.max(axis=0)
    v, a = (np.concatenate([np.abs(getattr(m.motion, name)) for m in samples]).max(axis=0) for name in ("v", "a"))
    felt = effects(model, Motions((low + high) / 2.0, (high - low) / 2.0, v, a), kinds)
    single = np.eye(len(felt.columns))[:, np.searchsorted(felt.columns, known.columns)]
    further, size, _ = np.linalg.svd(single - felt.basis @ (felt.basis.T @ single), full_matrices=False)
    return felt._replace(basis=np.hstack([felt.basis, further[:, size > _COUNTS]]))


def _rows(model: ReducedModel, samples: Sequence[EffortSamples], found: Effects, known: Prior) -> EffortRows:
    """W β = τ less what constants that are not looked for, or were added, make, and what is known beforehand."""
    values = np.array(model.parameters.values)
    values[found.columns] = 0.0
    others = replace(model.parameters, values=values)
    tau = np.concatenate([each.force - each.Y @ others.plus(each.added).values for each in samples])
    if not (tau.any() or len(known.columns)):
        raise InvalidInputError("all efforts are 0: constants are told by what motors exert")
    W = np.concatenate([found.reduced(each.Y) for each in samples]).reshape(*tau.shape, -1)
    places = np.searchsorted(found.columns, known.columns)
    P = found.basis[places] / (found.scale[places] * known.deviations)[:, None]
    return EffortRows(W, tau, P, model.parameters.values[known.columns] / known.deviations)


def _further(samples: Sequence[EffortSamples], rows: EffortRows, fit: RobustFit) -> tuple[Array, Array]:
    """By how much the efforts of each log are later than was thought, with standard deviations."""
    left = rows.left(fit.beta[: rows.W.shape[2]])
    parts = by_log(samples, left)
    told = [slopes(s.t, s.stretch, s.force - missed) for s, missed in zip(samples, parts, strict=True)]
    return further_delays(fit, left, told, [slopes(s.t, s.stretch, s.force) for s in samples])


def _estimate(
    best: _Fitted, plain: _Fitted, speeds: FoundSpeeds, drives: StatedMotors, late: tuple[Delay, ...]
) -> Estimate:
    """Words and values: s₁ + (V₁ᵀ)⁻¹V₂ᵀ s₂ = (V₁ᵀ)⁻¹ β, with s = S π and V₁ the rows of V that pivot."""
    model, samples, found, (_, rows, both, fit, k) = best
    everything, scale, V = model.parameters, found.scale, found.basis
    r, stated = V.shape[1], everything.values[found.columns]
    first = found.pivots
    turned = np.linalg.inv(V[first].T)
    multiples = np.zeros((r, len(everything)))
    multiples[:, found.columns] = (turned @ V.T) * scale / scale[first][:, None]
    multiples[np.abs(multiples) < _COUNTS * np.abs(multiples).max(axis=1, keepdims=True)] = 0.0
    to_values = turned / scale[first][:, None]
    values = np.array(everything.values)
    values[found.columns] = stated + V @ (best.beta - best.stated) / scale
    parameters = DynamicParameters(everything.names, everything.kinds, everything.units, values)
    chained = autocorrelation(samples, rows.left(best.beta), fit.counted)
    covariance = with_motion_errors(model, samples, both, fit, parameters, k)
    covariance = with_coloured_noise(covariance, samples, both, fit, chained)
    measured = np.concatenate([each.force for each in samples])
    missed = measured - np.concatenate([each.Y @ everything.plus(each.added).values for each in samples])
    own = fit.counted
    counted = by_log(samples, own)
    parts = parts_of([each.t[c] for each, c in zip(samples, counted, strict=True)], [each.log for each in late])
    unseen = cross_validated(rows.of(own), fit.deviation, best.stated, missed[own], measured[own], parts)
    if plain is not best:
        without = cross_validated(plain.rows.of(own), fit.deviation, plain.stated, missed[own], measured[own], parts)
        unseen = tuple(each._replace(coulomb=other.found) for each, other in zip(unseen, without, strict=True))
    return Estimate(
        tuple(
            _words(everything.names, row, int(column))
            for row, column in zip(multiples, found.columns[first], strict=True)
        ),
        to_values @ best.beta,
        multiples @ everything.values,
        to_values @ covariance[:r, :r] @ to_values.T,
        multiples,
        parameters,
        fit.deviation,
        chained,
        (int(own.sum()), sum(each.left for each in samples)),
        tuple(effort_outliers(model, samples, [each.log for each in late], fit, rows.left(best.beta))),
        unseen,
        late,
        tuple(each.motion for each in samples),
        found,
        model,
        told_friction(speeds, found, parameters, covariance),
        told_motors(drives, k, covariance, to_values),
        tuple(dict(each.added) for each in samples),
    )


def _words(names: Sequence[str], multiples: Array, first: int) -> str:
    """``mx:link3 + 0.5 mass:link4``: the first parameter, then the others."""
    others = [k for k in np.flatnonzero(multiples).tolist() if k != first]
    return " ".join([names[first], *(f"{_times(multiples[k])}{names[k]}" for k in others)])


def _times(multiple: float) -> str:
    size = f"{abs(multiple):.6g}"
    return f"{'+' if multiple > 0 else '-'} {'' if size == '1' else size + ' '}"
