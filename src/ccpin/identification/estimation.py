"""The constants of a mechanism from logs: weighted least squares of Y π = ρᵀSᵀu, with its covariance.

A log's motion is smoothed first (`ccpin.identification.smoothing`); each sample with all efforts gives the n rows of
Y(q, q̇, q̈) π = ρᵀSᵀu (22). What the rows tell apart is β = Vᵀ S π (`ccpin.identification.felt_combinations`); with Σ the
efforts' noise, found from the residuals, β̂ = C Wᵀ Σ⁻¹ τ and its covariance is C = (Wᵀ Σ⁻¹ W)⁻¹. What an encoder's noise
leaves in q̈ is not white, but has next to nothing of the slow changes that motions make: C counts it as if it were.
(C. Atkeson, C. An and J. Hollerbach, Estimation of inertial parameters of manipulator loads and links, International
Journal of Robotics Research 5, 1986; M. Gautier, Numerical calculation of the base inertial parameters, 1991.)

A sample at which a joint with friction may turn either way within what its velocity is known to is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import qr
from scipy.special import gammaincinv

from ccpin.arrays import Array, Indices, instance, positive, records
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.identification.felt_combinations import Effects, Motions, checked_kinds, effects
from ccpin.identification.log import Log
from ccpin.identification.smoothing import Smoothed, smoothed
from ccpin.mechanism.mechanism import Mechanism

_SURE = 4.0  # standard deviations of a velocity within which its sign is not known
_PASSES = 5
_SMOOTHNESS = 0.3  # a third of what serves the motion best: what is cut off peaks of q̈ would come back as constants
_COUNTS = 1e-9  # of a combination's largest multiple: smaller ones are rounding


class Estimate(NamedTuple):
    """What logs tell of a mechanism's constants.

    Attributes:
        combinations: What can be told, in words: a parameter, and the multiples of others that it cannot be told from.
        values: Of these, of shape (r,), in the first parameter's unit. stated: what the model says of them, alike.
        covariance: Of the values, of shape (r, r).
        multiples: The values as multiples of all p constants, of shape (r, p).
        parameters: All constants looked at: those nearest the model's (in effect) that agree with the values.
        effort_noise: Standard deviation of what is left of each row of ρᵀSᵀu, N m or N, of shape (n,).
        samples: How many counted, and how many were left out because a joint may have stood.
        motions: The smoothed logs.
        effects: How combinations follow from constants.
    """

    combinations: tuple[str, ...]
    values: Array
    stated: Array
    covariance: Array
    multiples: Array
    parameters: DynamicParameters
    effort_noise: Array
    samples: tuple[int, int]
    motions: tuple[Smoothed, ...]
    effects: Effects

    def __repr__(self) -> str:
        used, left = self.samples
        return f"Estimate({len(self.values)} combinations of constants from {used} samples, {left} left out)"

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, of shape (r,)."""
        return np.sqrt(np.diag(self.covariance))

    def box(self, confidence: float = 0.95, about: DynamicParameters | None = None) -> tuple[Array, Array]:
        """Bounds (lower, upper), of shape (p,) each, of constants about the ellipsoid of this confidence.

        Of each combination its first parameter alone varies, so that the combination is its value less to plus √χ²_r
        deviations: that is how far any of (β − β̂)ᵀ C⁻¹ (β − β̂) ≤ χ²_r goes. As Y knows combinations alone (to what
        `effects` calls felt), a robot whose combinations are in the ellipsoid moves as one in the box does.

        Args:
            confidence: Of the ellipsoid, between 0 and 1.
            about: What all other constants are, those of a law's model; default `parameters`.

        Raises:
            InvalidInputError: The confidence is not between 0 and 1, or the constants are another mechanism's.
        """
        about = self.parameters if about is None else instance(about, "about", DynamicParameters)
        if about.names != self.parameters.names:
            raise InvalidInputError("the constants are those of another mechanism")
        level, radii = positive(confidence, "confidence", "a number between 0 and 1"), np.zeros(len(self.parameters))
        if level >= 1.0:
            raise InvalidInputError(f"confidence = {level:g} must be a number between 0 and 1")
        first = self.effects.columns[pivots(self.effects)]
        radii[first] = np.sqrt(2.0 * gammaincinv(len(self.values) / 2.0, level)) * self.deviations
        middle = np.array(about.values)
        middle[first] += self.values - self.multiples @ about.values
        return middle - radii, middle + radii

    def table(self) -> str:
        """Each combination, its value, its standard deviation and what the model states, a line each."""
        rows = zip(self.combinations, self.values, self.deviations, self.stated, strict=True)
        return "\n".join(
            f"{value:12.5g} ± {off:9.2g}   stated {said:12.5g}   {name}" for name, value, off, said in rows
        )


def identify(
    model: ReducedModel | Mechanism,
    logs: Log | Iterable[Log],
    *,
    kinds: Sequence[str] | None = None,
    spacing: float | None = None,
    noise: Mapping[str, float] | None = None,
) -> Estimate:
    """What logs tell of a mechanism's constants.

    Args:
        model: The mechanism as it is described; its geometry is taken as it is.
        logs: One or more, with positions of the independent coordinates and efforts of all motors.
        kinds: Of parameters to find (`ReducedModel.parameters`: ``"inertia"``, ``"friction"``, …), all others are taken
            as stated; by default inertias, armatures, dampers and friction, and springs where the model has any.
        spacing: Between the knots of the motions' splines, s (`smoothed`).
        noise: Standard deviations of columns where they are known (`smoothed`).

    Raises:
        InvalidInputError: No log, an effort was not measured, or too few samples to tell anything.
        UnsupportedMechanismError: A coordinate is a ball or a circle.
    """
    model = model_of(model)
    logs = records([logs] if isinstance(logs, Log) else logs, "logs", Log)
    if not logs:
        raise InvalidInputError("no log: there is nothing to learn from")
    kinds = checked_kinds(kinds, model)
    for log in logs:
        if missing := [name for name in model.mechanism.actuated if f"u_{name}" not in log.columns]:
            raise InvalidInputError(f"no column 'u_{missing[0]}' in {log!r}: each motor's effort must be measured")
    motions = tuple(smoothed(log, model, spacing=spacing, noise=noise, smoothness=_SMOOTHNESS) for log in logs)
    equations = [_equations(model, motion, "friction" in kinds) for motion in motions]
    Y, tau = (np.concatenate(parts) for parts in list(zip(*equations, strict=True))[:2])
    left = sum(each[2] for each in equations)
    if len(Y) <= len(model.parameters.of(*kinds)):
        raise InvalidInputError(f"{len(Y)} samples count, {left} were left out: too few to tell anything")
    found = effects(model, _box(motions), kinds)
    known = np.setdiff1d(np.arange(Y.shape[2]), found.columns)
    tau = tau - Y[..., known] @ model.parameters.values[known]
    beta, covariance, deviation = _weighted(found.reduced(Y), tau)
    return _estimate(model, found, beta, covariance, deviation, (len(Y), left), motions)


def _equations(model: ReducedModel, motion: Smoothed, rubbing: bool) -> tuple[Array, Array, int]:
    """Y, ρᵀSᵀu and how many samples with efforts were left out."""
    rows = motion.with_efforts()
    terms = model.terms_many(motion.q[rows], motion.v[rows])
    rates = np.einsum("sij,sj->si", terms.rho, motion.v[rows])
    spread = np.sqrt(np.einsum("sij,sj->si", terms.rho**2, motion.v_deviation[rows] ** 2))
    turning = np.all(np.abs(rates) > _SURE * spread, axis=1) if rubbing else np.ones(len(rows), dtype=bool)
    chosen = rows[turning]
    Y = model.regressor_many(motion.q[chosen], motion.v[chosen], motion.a[chosen])
    return Y, motion.forces(model, chosen), int(len(rows) - len(chosen))


def _box(motions: Sequence[Smoothed]) -> Motions:
    """The box in which the logs' motions are."""
    q = np.concatenate([motion.q for motion in motions])
    low, high = q.min(axis=0), q.max(axis=0)
    v, a = (np.concatenate([np.abs(getattr(m, name)) for m in motions]).max(axis=0) for name in ("v", "a"))
    return Motions((low + high) / 2.0, (high - low) / 2.0, v, a)


def _weighted(W: Array, tau: Array) -> tuple[Array, Array, Array]:
    """β̂, its covariance and the standard deviation of each of the n rows of a sample."""
    n, r = tau.shape[1], W.shape[1]
    deviation = np.ones(n)
    for _ in range(_PASSES):
        weight = np.tile(1.0 / deviation, len(tau))
        q, triangle = np.linalg.qr(weight[:, None] * W)
        beta = np.linalg.solve(triangle, q.T @ (weight * tau.ravel()))
        off = tau - (W @ beta).reshape(-1, n)
        deviation = np.sqrt((off**2).sum(axis=0) / (len(tau) - r / n))
        deviation = np.maximum(deviation, 1e-14 * np.abs(tau).max())
    inverse = np.linalg.inv(np.linalg.qr(W / np.tile(deviation, len(tau))[:, None])[1])
    return beta, inverse @ inverse.T, deviation


def _estimate(
    model: ReducedModel,
    found: Effects,
    beta: Array,
    covariance: Array,
    deviation: Array,
    samples: tuple[int, int],
    motions: tuple[Smoothed, ...],
) -> Estimate:
    """Words and values: s₁ + (V₁ᵀ)⁻¹V₂ᵀ s₂ = (V₁ᵀ)⁻¹ β, with s = S π and V₁ the rows of V that pivot."""
    everything, scale, V = model.parameters, found.scale, found.basis
    r, stated = V.shape[1], everything.values[found.columns]
    first = pivots(found)
    turned = np.linalg.inv(V[first].T)
    multiples = np.zeros((r, len(everything)))
    multiples[:, found.columns] = (turned @ V.T) * scale / scale[first][:, None]
    multiples[np.abs(multiples) < _COUNTS * np.abs(multiples).max(axis=1, keepdims=True)] = 0.0
    to_values = turned / scale[first][:, None]
    near = stated + V @ (beta - V.T @ (scale * stated)) / scale
    values = np.array(everything.values)
    values[found.columns] = near
    return Estimate(
        tuple(
            _words(everything.names, row, int(column))
            for row, column in zip(multiples, found.columns[first], strict=True)
        ),
        to_values @ beta,
        multiples @ everything.values,
        to_values @ covariance @ to_values.T,
        multiples,
        DynamicParameters(everything.names, everything.kinds, everything.units, values),
        deviation,
        samples,
        motions,
        found,
    )


def pivots(found: Effects) -> Indices:
    """Which of the columns combinations are written on, of shape (r,)."""
    return np.sort(qr(found.basis.T, pivoting=True, mode="r")[1][: found.basis.shape[1]])


def _words(names: Sequence[str], multiples: Array, first: int) -> str:
    """``mx:link3 + 0.5 mass:link4``: the first parameter, then the others."""
    others = [k for k in np.flatnonzero(multiples).tolist() if k != first]
    return " ".join([names[first], *(f"{_times(multiples[k])}{names[k]}" for k in others)])


def _times(multiple: float) -> str:
    size = f"{abs(multiple):.6g}"
    return f"{'+' if multiple > 0 else '-'} {'' if size == '1' else size + ' '}"
