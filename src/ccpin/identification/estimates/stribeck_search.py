"""Stribeck speeds from logs, in which efforts are not linear, by variable projection.

With W the columns of all other constants, and of joint j its column beside s_j − c_j,

    E_j(v_j) = exp(−(q̇′_j/v_j)²) ρ_jᵀ sign q̇′_j,

all weighted by the efforts' deviations, the other constants are linear least squares' for any speeds, and what is
left, ‖(1 − W W⁺)(τ − E δ)‖², δ its best, depends on the speeds alone (G. Golub and V. Pereyra, The differentiation
of pseudo-inverses and nonlinear least squares problems whose variables separate, SIAM Journal on Numerical Analysis
10, 1973). Speeds are looked for on a grid, then by Gauss and Newton's steps.

An effect is told of a joint where it explains more than two constants have to (2 log N of the weighted sum of N
squares: G. Schwarz, Estimating the dimension of a model, Annals of Statistics 6, 1978), friction falls from rest on,
and 95 % of the profile likelihood of v_s lie between speeds that the log has: where v_s is below its slow samples s is
not seen, and where it is above all of them s − c and c are not told apart. Else the joint has Coulomb's friction, and
a reason.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq, least_squares, nnls

from ccpin.arrays import Array
from ccpin.identification.estimates.robust_fit import EffortRows, RobustFit, fitted_robustly, with_columns
from ccpin.identification.estimates.stribeck_friction import FoundSpeeds, StribeckColumns, Verdict

_GRID, _SWEEPS, _ROUNDS = 16, 4, 4
_SLOW = 20  # samples that have to be slower than v_s
_PROFILE = 3.841  # χ² of one freedom, 95 %
_SETTLED = 1e-3  # of the logarithm of a speed
_APART = 1e-8  # of a column: what the others explain of it but for this is all of it


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
        sizes = np.maximum(np.sort(np.abs(counted.rates), axis=0), np.finfo(float).tiny)
        low = np.log(sizes[min(_SLOW, len(sizes) - 1)])
        bounds = low, np.maximum(np.log(sizes[-1]), low + _SETTLED)
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
