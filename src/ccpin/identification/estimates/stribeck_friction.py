"""Stribeck's friction from logs: the speeds v_s, in which efforts are not linear, by variable projection.

With W the columns of all other constants, and of joint j its column beside s_j − c_j,

    E_j(v_j) = exp(−(q̇′_j/v_j)²) ρ_jᵀ sign q̇′_j,

all weighted by the efforts' deviations, the other constants are linear least squares' for any speeds, and what is
left, ‖(1 − W W⁺)(τ − E δ)‖², δ its best, depends on the speeds alone (G. Golub and V. Pereyra, The differentiation
of pseudo-inverses and nonlinear least squares problems whose variables separate, SIAM Journal on Numerical Analysis
10, 1973). Speeds are looked for on a grid, then by Gauss and Newton's steps; ∂(E δ)/∂v_s stands beside W in the fit
that counts, so that all covariances have what is not known of v_s in them.

An effect is told of a joint where it explains more than two constants have to (2 log N of the weighted sum of N
squares: G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978), friction falls from rest on,
and 95 % of the profile likelihood of v_s lie between speeds that the log has: where v_s is below its slow samples s is
not seen, and where it is above all of them s − c and c are not told apart. Else the joint has Coulomb's friction, and
a reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, least_squares, nnls

from ccpin.arrays import Array, records
from ccpin.description.names import choices
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.identification.estimates.effort_samples import EffortSamples
from ccpin.identification.estimates.felt_combinations import Effects
from ccpin.identification.estimates.robust_fit import EffortRows, RobustFit, fitted_robustly

_GRID, _SWEEPS, _ROUNDS = 16, 4, 4
_SLOW = 20  # samples that have to be slower than v_s
_PROFILE = 3.841  # χ² of one freedom, 95 %
_SETTLED = 1e-3  # of the logarithm of a speed
_ALONE = 1e-6  # of a constant: as much may be told with others
_APART = 1e-8  # of a column: what the others explain of it but for this is all of it


class StribeckFriction(NamedTuple):
    """What logs tell of one joint's dry friction.

    Attributes:
        joint: Its name.
        values: Coulomb level c, breakaway level s and Stribeck speed v_s, N m or N and rad/s or m/s, of shape (3,); NaN
            where no Stribeck effect is told.
        covariance: Of these, of shape (3, 3).
        interval: 95 % of the profile likelihood of v_s.
        gain: By how much less is left of the efforts with the effect than without, in squares of their deviations.
        due: What two constants have to explain for their place.
        reason: Why no effect is told; empty where one is.
    """

    joint: str
    values: Array
    covariance: Array
    interval: tuple[float, float]
    gain: float
    due: float
    reason: str

    @property
    def deviations(self) -> Array:
        """Standard deviations of the values, of shape (3,)."""
        return np.sqrt(np.diag(self.covariance))

    def level(self, speed: Array) -> tuple[Array, Array]:
        """c + (s − c) exp(−(v/v_s)²) at some speeds, and its standard deviation."""
        c, s, v_s = self.values
        fall = np.exp(-((speed / v_s) ** 2))
        slopes = np.stack([1.0 - fall, fall, (s - c) * fall * 2.0 * speed**2 / v_s**3])
        return c + (s - c) * fall, np.sqrt(np.einsum("i...,ij,j...->...", slopes, self.covariance, slopes))


class StribeckColumns(NamedTuple):
    """What Stribeck's friction is made of.

    Attributes:
        names: Of k joints.
        friction: Columns of Y beside their Coulomb levels, ρ_jᵀ sign q̇′_j, of shape (N, n, k).
        rates: q̇′_j, of shape (N, k).
    """

    names: tuple[str, ...]
    friction: Array
    rates: Array

    def of(self, joints: Sequence[int]) -> StribeckColumns:
        """Some of the joints."""
        chosen = list(joints)
        return StribeckColumns(tuple(self.names[k] for k in chosen), self.friction[..., chosen], self.rates[:, chosen])

    def falling(self, speeds: Array) -> Array:
        """E at these speeds, of shape (N, n, k)."""
        return np.asarray(self.friction * np.exp(-((self.rates / speeds) ** 2))[:, None])

    def slopes(self, speeds: Array) -> Array:
        """∂E/∂v_s, alike."""
        return np.asarray(self.falling(speeds) * (2.0 * self.rates**2 / speeds**3)[:, None])


class Verdict(NamedTuple):
    """What is said of a joint's Stribeck effect: `StribeckFriction` tells of each."""

    joint: str
    interval: tuple[float, float]
    gain: float
    due: float
    reason: str


class FoundSpeeds(NamedTuple):
    """What was found of some joints.

    Attributes:
        speeds: v_s by joint of those whose effect is told.
        increments: δ = s − c of these, of shape (k,).
        told: Of every joint that was asked for.
    """

    speeds: dict[str, float]
    increments: Array
    told: tuple[Verdict, ...]

    def slopes(self, columns: StribeckColumns) -> Array:
        """∂(E δ)/∂v_s, of shape (N, n, k)."""
        return columns.slopes(np.array([*self.speeds.values()])) * self.increments


def stribeck_columns(model: ReducedModel, samples: Sequence[EffortSamples], joints: Sequence[str]) -> StribeckColumns:
    """Those of joints in all samples."""
    tree, names = model.mechanism.tree, model.parameters.names
    places = [names.index(f"friction:{joint}") for joint in joints]
    own = [tree.joint(joint).v.start for joint in joints]
    friction = np.concatenate([each.Y[..., places] for each in samples])
    return StribeckColumns(tuple(joints), friction, np.concatenate([each.rates[:, own] for each in samples]))


def asked_joints(model: ReducedModel, asked: bool | Sequence[str]) -> tuple[str, ...]:
    """Joints of one velocity: all, none, or those named.

    Raises:
        InvalidInputError: A name of none.
    """
    able = tuple(joint.name for joint in model.mechanism.tree.joints if joint.kind.nv == 1)
    if isinstance(asked, bool):
        return able if asked else ()
    names = (asked,) if isinstance(asked, str) else records(asked, "stribeck", str)
    for name in names:
        if name not in able:
            raise InvalidInputError(f"stribeck: '{name}' is no joint of one velocity; {choices(str(name), able)}")
    return tuple(name for name in able if name in names)


def found_speeds(rows: EffortRows, columns: StribeckColumns, robust: bool) -> FoundSpeeds:
    """The Stribeck speeds of the joints whose effect is told.

    Args:
        rows: W β = τ of all other constants, and what is known of them.
        columns: Of the joints that are asked for.
        robust: As for `fitted_robustly`.
    """
    left, told = list(range(len(columns.names))), dict[str, Verdict]()
    speeds, increments = np.empty(0), np.empty(0)
    while left:
        search, speeds, increments = _settled(rows, columns.of(left), robust)
        verdicts = [search.worth(k, speeds, increments) for k in range(len(left))]
        if not any(each.reason for each in verdicts):
            verdicts = [search.bounded(k, speeds, each) for k, each in enumerate(verdicts)]
        told |= {each.joint: each for each in verdicts}
        refused = [k for k in range(len(left)) if verdicts[k].reason]
        if not refused:
            break
        left.pop(min(refused, key=lambda k: verdicts[k].gain))
    names = [columns.names[k] for k in left]
    found = dict(zip(names, speeds.tolist(), strict=True)) if left else {}
    return FoundSpeeds(found, increments, tuple(told[name] for name in columns.names))


def with_columns(rows: EffortRows, further: Array) -> EffortRows:
    """Further columns (N, n, k) beside W, of which nothing is known beforehand."""
    return rows._replace(W=np.concatenate([rows.W, further], axis=2), P=np.pad(rows.P, ((0, 0), (0, further.shape[2]))))


def with_effect(before: ReducedModel, after: ReducedModel, samples: EffortSamples, found: FoundSpeeds) -> EffortSamples:
    """Samples of a model whose constants have those of Stribeck's friction besides."""
    old = np.isin(after.parameters.names, before.parameters.names)
    Y = np.empty((*samples.Y.shape[:2], len(old)))
    columns = stribeck_columns(before, [samples], tuple(found.speeds))
    Y[..., old], Y[..., ~old] = samples.Y, columns.falling(np.array([*found.speeds.values()]))
    return samples._replace(Y=Y)


def told_friction(
    found: FoundSpeeds, effects: Effects, parameters: DynamicParameters, fit: RobustFit
) -> tuple[StribeckFriction, ...]:
    """Levels and speeds of every joint that was asked for, from a fit whose last numbers are speeds."""
    told, r = [], effects.basis.shape[1]

    def row(name: str) -> Array:
        """What a constant is of β and speeds; NaN where it is told in combinations only."""
        place = int(np.searchsorted(effects.columns, parameters.names.index(name)))
        own = np.pad(effects.basis[place] / effects.scale[place], (0, len(fit.beta) - r))
        return own if np.linalg.norm(effects.basis[place]) > 1.0 - _ALONE else own * np.nan

    for each in found.told:
        values, covariance = np.full(3, np.nan), np.full((3, 3), np.nan)
        if each.joint in found.speeds:
            names = f"friction:{each.joint}", f"stribeck:{each.joint}"
            c, more = (float(parameters.values[parameters.names.index(name)]) for name in names)
            coulomb, increment, speed = row(names[0]), row(names[1]), np.zeros(len(fit.beta))
            speed[r + list(found.speeds).index(each.joint)] = 1.0
            slopes = np.array([coulomb, coulomb + increment, speed])
            values, covariance = np.array([c, c + more, found.speeds[each.joint]]), slopes @ fit.covariance @ slopes.T
        told.append(StribeckFriction(each.joint, values, covariance, *each[1:]))
    return tuple(told)


def _settled(rows: EffortRows, columns: StribeckColumns, robust: bool) -> tuple[_Projection, Array, Array]:
    """Speeds and increments from samples that count, and these from a fit that has them."""
    fit, before = fitted_robustly(rows, robust), np.zeros(len(columns.names))
    for _ in range(_ROUNDS):
        search = _Projection.of_fit(rows, columns, fit)
        speeds = search.best(before if before.any() else search.grid_best())
        increments = search.left(speeds)[1]
        if np.all(np.abs(np.log(speeds) - before) < _SETTLED):
            break
        before = np.log(speeds)
        E, slopes = columns.falling(speeds), columns.slopes(speeds) * increments
        fit = fitted_robustly(with_columns(rows, np.concatenate([E, slopes], axis=2)), robust)
    return search, speeds, increments


@dataclass(frozen=True, eq=False)
class _Projection:
    """What is left of the efforts by speeds alone: samples that count, rows by their deviations, W projected away.

    Attributes:
        columns: Of these samples, times `weight` (n,) one over deviations.
        others: Orthonormal columns that span W's, with a row for each that is known beforehand.
        right: The efforts, alike, less what W explains of them.
        bounds: Logarithms of the least and greatest speeds, of shape (k,) each.
    """

    columns: StribeckColumns
    weight: Array
    others: Array
    right: Array
    bounds: tuple[Array, Array]

    @classmethod
    def of_fit(cls, rows: EffortRows, columns: StribeckColumns, fit: RobustFit) -> _Projection:
        """That of the samples that a fit counts."""
        own, weight = rows.of(fit.counted), 1.0 / fit.deviation
        counted = columns._replace(friction=columns.friction[fit.counted], rates=columns.rates[fit.counted])
        others = np.linalg.qr(np.concatenate([(weight[:, None] * own.W).reshape(-1, own.W.shape[2]), own.P]))[0]
        right = np.concatenate([(weight * own.tau).ravel(), own.p])
        sizes = np.sort(np.abs(counted.rates), axis=0)
        bounds = np.log(sizes[min(_SLOW, len(sizes) - 1)]), np.log(sizes[-1])
        return cls(counted, weight, others, right - others @ (others.T @ right), bounds)

    def of(self, joints: Sequence[int]) -> _Projection:
        """Some of the joints."""
        low, high = (bound[list(joints)] for bound in self.bounds)
        return replace(self, columns=self.columns.of(joints), bounds=(low, high))

    @property
    def _size(self) -> int:
        return self.columns.friction[..., 0].size

    def _apart(self, columns: Array) -> Array:
        """Columns (N, n, k), weighted, less what W explains of them, with a row for each that is known beforehand."""
        flat = (self.weight[:, None] * columns).reshape(-1, columns.shape[2])
        found = self.others @ -(self.others[: len(flat)].T @ flat)
        found[: len(flat)] += flat
        return np.asarray(found)

    def left(self, speeds: Array) -> tuple[Array, Array]:
        """What is left, and δ."""
        E = self._apart(self.columns.falling(speeds))
        increments = np.linalg.lstsq(E, self.right, rcond=_APART)[0]
        return np.asarray(self.right - E @ increments), np.asarray(increments)

    def grid_best(self) -> Array:
        """Logarithms of speeds, joint by joint the best of a grid while the others stay, of no δ below zero."""
        low, high = self.bounds
        grid, count = np.linspace(low, high, _GRID), len(low)
        E = np.concatenate([self._apart(self.columns.falling(np.exp(row))) for row in grid], axis=1)
        q, triangle = np.linalg.qr(E)
        right = q.T @ self.right
        chosen = np.full(count, _GRID // 2)

        def gain(at: Array) -> float:
            return -float(nnls(triangle[:, at * count + np.arange(count)], right)[1])

        for _ in range(_SWEEPS):
            before = chosen.copy()
            for k in range(count):
                tried = np.repeat(chosen[None], _GRID, axis=0)
                tried[:, k] = np.arange(_GRID)
                chosen = tried[int(np.argmax([gain(each) for each in tried]))]
            if np.array_equal(before, chosen):
                break
        return np.asarray(grid[chosen, np.arange(count)])

    def best(self, start: Array, held: tuple[int, float] | None = None) -> Array:
        """Speeds that leave least, from logarithms; with one held at its logarithm if asked."""
        free = np.arange(len(start)) if held is None else np.delete(np.arange(len(start)), held[0])
        whole = np.array(start)
        if held is not None:
            whole[held[0]] = held[1]
        if not len(free):
            return np.exp(whole)

        def at(x: Array) -> Array:
            found = whole.copy()
            found[free] = x
            return np.exp(found)

        low, high = self.bounds[0][free], self.bounds[1][free]
        inside = np.clip(whole[free], low + 1e-6, high - 1e-6)
        found = least_squares(
            lambda x: self.left(at(x))[0],
            inside,
            lambda x: self.slopes(at(x))[:, free],
            (low, high),
            xtol=1e-4,
            ftol=1e-7,
            max_nfev=30,
        )
        return at(found.x)

    def cost(self, speeds: Array) -> float:
        """The sum of squares of what is left."""
        return float(np.sum(self.left(speeds)[0] ** 2))

    def slopes(self, speeds: Array) -> Array:
        """Of what is left by log v_s, L. Kaufman's: −(1 − P)(∂E/∂log v_s) δ, P on W and E."""
        E = self._apart(self.columns.falling(speeds))
        delta = np.linalg.lstsq(E, self.right, rcond=_APART)[0]
        moved = self._apart(self.columns.slopes(speeds) * (delta * speeds))
        return np.asarray(E @ np.linalg.lstsq(E, moved, rcond=_APART)[0] - moved)

    def worth(self, k: int, speeds: Array, increments: Array) -> Verdict:
        """Whether what joint k's effect explains is worth its two constants; the interval is open yet."""
        gain, due, said = self._without(k, speeds) - self.cost(speeds), 2.0 * float(np.log(self._size)), ""
        if gain < due:
            said = f"the logs show no fall of friction with speed: it would explain {gain:.3g}, and {due:.3g} are due"
        elif increments[k] <= 0.0:
            said = "friction rises with speed from rest on, as no Stribeck effect does"
        return Verdict(self.columns.names[k], (np.nan, np.nan), gain, due, said)

    def bounded(self, k: int, speeds: Array, found: Verdict) -> Verdict:
        """The interval of joint k's speed, and whether the logs bound it."""
        low, high = (self._end(k, speeds, way) for way in (-1, 1))
        slowest, fastest = (float(np.exp(bound[k])) for bound in self.bounds)
        said = ""
        if low is None:
            said = (
                f"the Stribeck speed may be below {slowest:.3g}, where the logs have too few samples to tell breakaway"
            )
        elif high is None:
            said = f"the Stribeck speed may be above {fastest:.3g}, the logs' largest: c and s are not told apart"
        return found._replace(interval=(low or 0.0, np.inf if high is None else high), reason=said)

    def _without(self, k: int, speeds: Array) -> float:
        """What is left at least without the effect of joint k."""
        others = [j for j in range(len(speeds)) if j != k]
        if not others:
            return float(self.right @ self.right)
        part = self.of(others)
        return part.cost(part.best(np.log(speeds[others])))

    def _end(self, k: int, speeds: Array, way: int) -> float | None:
        """Where the profile likelihood of v_s falls to 95 %, slower or faster; ``None``: within bounds nowhere.

        The root of what it falls by is nearly straight in log v_s, so that few steps find it.
        """
        here, last, start = float(np.log(speeds[k])), float(self.bounds[way > 0][k]), np.log(speeds)
        J, least = self.slopes(speeds), self.cost(speeds)
        step = 1.2 * way * float(np.sqrt(_PROFILE * np.linalg.pinv(J.T @ J)[k, k]))

        def above(x: float) -> float:
            return float(np.sqrt(max(self.cost(self.best(start, (k, x))) - least, 0.0)) - np.sqrt(_PROFILE))

        near = here
        while (last - near) * way > 0.0:
            far = near + step if (last - near - step) * way > 0.0 else last
            if above(far) > 0.0:
                return float(np.exp(brentq(above, near, far, xtol=0.02 * abs(step))))
            near = far
        return None
