"""Motions that show a mechanism's constants: within its limits, on its branch, and as telling as can be found.

A motion is a spline through waypoints (`ccpin.control.Waypoints`), from rest to rest. With W = Y S⁻¹ V stacked over its
samples (`felt_combinations`), the covariance of the estimate is (WᵀW)⁻¹ times the noise's
variance: what is made small is the condition number of W, or the trace of (WᵀW)⁻¹ (J. Swevers et al., Optimal robot
excitation and identification, IEEE Transactions on Robotics and Automation 13, 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PPoly
from scipy.optimize import minimize

from ccpin.arrays import Array, choice, one_each, positive, vector, whole
from ccpin.control.references import Waypoints, from_rest_to_rest
from ccpin.domain import certify_path
from ccpin.domain.paths.path import CertifiedPath
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import CcpinError, InvalidInputError, UnsupportedMechanismError
from ccpin.identification.estimates.felt_combinations import Effects, Motions, checked_kinds, effects
from ccpin.identification.logs.log import require_plain
from ccpin.identification.logs.log_files import write_table
from ccpin.mechanism.mechanism import Mechanism

Criterion = Literal["condition", "trace"]
_SAMPLES, _SHRINK, _TRIES = 80, 0.98, 40
_FINE = 25  # samples between two of the search's, where limits are looked at in the end
_ROUNDING = 1e-12  # of a duration over a period
_PENALTY, _NOWHERE = 1e2, 1e6


class MotionLimits(NamedTuple):
    """What a motion must keep within, of shape (n,) each; efforts of shape (motors,)."""

    lower: Array
    upper: Array
    speed: Array
    effort: Array


class Excitation(NamedTuple):
    """A motion that shows a mechanism's constants.

    Attributes:
        reference: The motion, from rest to rest.
        condition: The condition number of W along it. trace: of (WᵀW)⁻¹.
        rank: How many combinations of constants the motors feel (numerical).
        share: The largest share of a limit that the motion takes, looked at 25 times as finely as the search does.
        path: The proof that σ stays on its branch along it; ``None`` where closures cannot be certified.
        told: What was found, in a sentence.
        names: Of the coordinates.
        effects: How W follows from the regressor: the same for other motions within the limits.
    """

    reference: Waypoints
    condition: float
    trace: float
    rank: int
    share: float
    path: CertifiedPath | None
    told: str
    names: tuple[str, ...]
    effects: Effects

    def save(self, path: str | Path, period: float = 1e-3) -> None:
        """Write t, q, v and a at even times as ``.csv`` or ``.parquet``, columns ``q_NAME``, ``v_NAME``, ``a_NAME``.

        The last row is at rest: where the period does not divide the duration it is after the motion's end.

        Args:
            path: The file.
            period: Between rows, s.

        Raises:
            InvalidInputError: Another suffix, a period that is not positive, or the file cannot be written.
        """
        count = self.reference.duration / positive(period, "period", "a positive number of seconds")
        t: Array = period * np.arange(np.ceil(count * (1.0 - _ROUNDING)) + 1.0)
        q, v, a = (np.array(rows) for rows in zip(*(self.reference.at(each) for each in t), strict=True))
        table = {"t": t}
        for symbol, block in (("q", q), ("v", v), ("a", a)):
            table |= {f"{symbol}_{name}": column for name, column in zip(self.names, block.T, strict=True)}
        write_table(table, Path(path))


def excitation(
    model: ReducedModel | Mechanism,
    duration: float,
    *,
    lower: ArrayLike,
    upper: ArrayLike,
    speed: ArrayLike,
    effort: ArrayLike | None = None,
    start: ArrayLike | None = None,
    kinds: Sequence[str] | None = None,
    waypoints: int = 12,
    criterion: Criterion = "condition",
    starts: int = 200,
    iterations: int = 80,
    seed: int = 0,
) -> Excitation:
    """A motion within limits along which the constants of a mechanism show best.

    Args:
        model: What is to move; its coordinates must be plain numbers.
        duration: Seconds.
        lower: Least q, of shape (n,).
        upper: Greatest q, of shape (n,).
        speed: Greatest |q̇|, a number or of shape (n,).
        effort: Greatest |u| that inverse dynamics may ask for, a number or of shape (motors,); default: any.
        start: Where it begins and ends, of shape (n,); default the middle.
        kinds: Of parameters to show (`ReducedModel.parameters`: ``"inertia"``, ``"friction"``, …); by default inertias,
            armatures, dampers and friction, and springs where the model has any.
        waypoints: How many it passes between.
        criterion: ``"condition"`` of W, or ``"trace"`` of (WᵀW)⁻¹.
        starts: How many random motions the search begins with.
        iterations: Steps of improvement of the best of them.
        seed: Of the random motions.

    Raises:
        InvalidInputError: Limits are malformed, or cross; the start is outside or cannot be held; no motion was found.
        UnsupportedMechanismError: A coordinate is a ball or a circle.
    """
    model = model_of(model)
    require_plain(model, "an excitation")
    n, duration = model.n, positive(duration, "duration", "a positive number of seconds")
    motors = model.n_actuated
    most = np.full(motors, np.inf) if effort is None else one_each(effort, "effort", motors, positive=True)
    limits = MotionLimits(
        vector(lower, "lower", n), vector(upper, "upper", n), one_each(speed, "speed", n, positive=True), most
    )
    if np.any(limits.upper <= limits.lower):
        raise InvalidInputError("upper must be above lower in each coordinate")
    begin = (limits.lower + limits.upper) / 2.0 if start is None else vector(start, "start", n)
    search = _MotionSearch(
        model,
        duration,
        limits,
        begin,
        whole(waypoints, "waypoints", 2),
        choice(criterion, "criterion", get_args(Criterion)),
        checked_kinds(kinds, model),
    )
    if search.share(np.zeros((search.count, n))) > 1.0:
        raise InvalidInputError(f"the start q = {begin.tolist()} is outside the limits, or takes more effort to hold")
    random = np.random.default_rng(whole(seed, "seed", 0))
    inner = search.best(random, whole(starts, "starts"), whole(iterations, "iterations", 0))
    for _ in range(_TRIES):
        share, motion = search.share(inner, _FINE), search.motion(inner)
        if share <= 1.0:
            path, told = _proved(model, motion)
            if path is None or path.proved is not None:
                W = search.rows(inner)
                condition = float(np.linalg.cond(W))
                told = f"{W.shape[1]} combinations of constants, condition {condition:.3g}; {told}"
                trace = float(np.trace(np.linalg.inv(W.T @ W)))
                names = tuple(model.coordinates.names)
                return Excitation(motion, condition, trace, W.shape[1], share, path, told, names, search.effects)
        inner = _SHRINK * inner
    if 1.0 < share < np.inf:
        more = "a longer duration, more speed or effort, or a start farther from the limits would do more"
        raise InvalidInputError(f"no motion within the limits was found from q = {begin.tolist()}: {more}")
    raise InvalidInputError("no motion within the limits was found that stays on its branch: narrow lower and upper")


class _MotionSearch:
    """Waypoints looked for: q(t) is linear in what they are away from the start."""

    def __init__(
        self,
        model: ReducedModel,
        duration: float,
        limits: MotionLimits,
        start: Array,
        count: int,
        criterion: str,
        kinds: Sequence[str],
    ) -> None:
        self.model, self.limits, self.start, self.count, self.criterion = model, limits, start, count, criterion
        self.times = np.linspace(0.0, duration, count + 2)
        self.shapes: dict[int, list[Array]] = {}
        reach = (limits.upper - limits.lower) / 2.0
        box = Motions((limits.lower + limits.upper) / 2.0, reach, limits.speed, limits.speed * count / duration * 4.0)
        self.effects: Effects = effects(model, box, kinds)

    def motion(self, inner: Array) -> Waypoints:
        """The spline whose inner waypoints are as far away from the start."""
        away = np.vstack([np.zeros_like(self.start), inner, np.zeros_like(self.start)])
        return Waypoints(self.model, self.times, self.start + away)

    def along(self, inner: Array, finely: int = 1) -> tuple[Array, Array, Array]:
        """q, q̇, q̈ at even times."""
        if finely not in self.shapes:
            unit = from_rest_to_rest(self.times, np.eye(self.count + 2)[:, 1:-1])
            even = np.linspace(0.0, self.times[-1], _SAMPLES * finely)
            self.shapes[finely] = [np.asarray(unit(even, order)) for order in range(3)]
        q, v, a = (shape @ inner for shape in self.shapes[finely])
        return self.start + q, v, a

    def rows(self, inner: Array) -> Array:
        """W along a motion, of shape (samples · n, r)."""
        return self.effects.reduced(self.model.regressor_many(*self.along(inner)))

    def share(self, inner: Array, finely: int = 1) -> float:
        """The largest share of a limit; infinite where a configuration does not exist."""
        try:
            return float(self._shares(inner, finely).max())
        except CcpinError:
            return np.inf

    def cost(self, flat: Array) -> float:
        """The criterion's logarithm, and a penalty where limits are passed."""
        inner = flat.reshape(self.count, -1)
        try:
            W, over = self.rows(inner), np.maximum(self._shares(inner) - 0.98, 0.0)
        except CcpinError:
            return _NOWHERE
        size = np.linalg.svd(W, compute_uv=False)
        if size[-1] <= 1e-14 * size[0]:
            return _NOWHERE
        telling = size[0] / size[-1] if self.criterion == "condition" else np.sqrt(np.sum(1.0 / size**2))
        return float(np.log(telling) + _PENALTY * np.sum(over**2))

    def best(self, random: np.random.Generator, starts: int, iterations: int) -> Array:
        """Of random motions the best one, then improved."""
        half = (self.limits.upper - self.limits.lower) / 2.0
        drawn = [self.held(random.uniform(-1.0, 1.0, (self.count, self.model.n)) * half) for _ in range(starts)]
        least = min(drawn, key=lambda inner: self.cost(inner.ravel()))
        options = {"maxiter": iterations}
        scale = np.tile(half, self.count)
        found = minimize(lambda x: self.cost(x * scale), least.ravel() / scale, method="L-BFGS-B", options=options)
        return np.asarray(found.x * scale).reshape(self.count, -1)

    def held(self, inner: Array) -> Array:
        """A motion made smaller until it is within the limits."""
        for _ in range(_TRIES):
            if self.share(inner) <= 1.0:
                break
            inner = 0.8 * inner
        return inner

    def _shares(self, inner: Array, finely: int = 1) -> Array:
        """Shares of each limit at each sample.

        Raises:
            CcpinError: A configuration does not exist.
        """
        q, v, a = self.along(inner, finely)
        half = (self.limits.upper - self.limits.lower) / 2.0
        found = [(q - self.limits.lower - half) / half, v / self.limits.speed]
        if np.any(np.isfinite(self.limits.effort)):
            found.append(self.model.inverse_dynamics_many(q, v, a) / self.limits.effort)
        elif finely > 1:
            self.model.sigma_many(q)
        return np.abs(np.concatenate(found, axis=1))


def _proved(model: ReducedModel, motion: Waypoints) -> tuple[CertifiedPath | None, str]:
    """The proof that σ stays on its branch along a motion, and what is told of it."""
    polynomial = motion.as_polynomial()
    coefficients = polynomial.coefficients.swapaxes(0, 1).copy()
    coefficients[-1] += polynomial.start
    try:
        path = certify_path(model, PPoly(coefficients, polynomial.breaks), 0.0)
    except UnsupportedMechanismError as error:
        return None, f"that it stays on its branch is not proved: {error}"
    return path, path.reason
