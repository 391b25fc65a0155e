"""Weighted least squares of Y π = ρᵀSᵀu, with what is known beforehand, and without samples that are grossly off.

With W β = τ + ε, ε's deviation σ_j the same in each row j of all samples, and prior rows P β = p of unit deviation,

    β̂ = C (Wᵀ Σ⁻¹ τ + Pᵀ p),    C = (Wᵀ Σ⁻¹ W + Pᵀ P)⁻¹,    σ_j² = Σ left_j² / (N − Σ h_j),

h the rows' leverages: the mode and the covariance of the posterior. Efforts have outliers: a fit is made first in which
a residual z σ beyond k σ counts by k/|z| (P. Huber, Robust estimation of a location parameter, 1964: iteratively
reweighted, σ from the median), and samples more than five deviations off it are left out of the one that counts, again
until they are the same. Where none is as far off, nothing is left out, and the answer is least squares' own.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.ndimage import median_filter

from ccpin.arrays import Array, Indices, Mask

_PASSES, _ROUNDS = 5, 12
_HUBER = 1.345  # deviations beyond which a residual's weight falls: 95 % as sure as least squares under Gaussian noise
_BEYOND = 5.0  # deviations: Gaussian noise is farther off once in 1.7 million samples
_ABOUT = 51  # samples over which residuals are compared: where the model is off all of them are large
_USUAL = 1.4826  # of the median of |x|: the standard deviation of Gaussian noise
_LEAST = 1e-14  # of the largest effort: rounding


class EffortRows(NamedTuple):
    """W β = τ and P β = p.

    Attributes:
        W: Of shape (N, n, r). tau: Of shape (N, n).
        P: Of shape (K, r). p: Of shape (K,); both divided by their deviations.
    """

    W: Array
    tau: Array
    P: Array
    p: Array

    def left(self, beta: Array) -> Array:
        """τ − W β, of shape (N, n)."""
        return np.asarray(self.tau - self.W @ beta)

    def of(self, samples: Mask | Indices) -> EffortRows:
        """Some samples, with all that is known beforehand."""
        return self._replace(W=self.W[samples], tau=self.tau[samples])

    def condensed(self) -> EffortRows:
        """At most r + 1 samples whose sums of squares left by any β are these, row by row: R of [W_j τ_j] = Q R."""
        both = np.concatenate([self.W, self.tau[..., None]], axis=2).swapaxes(0, 1)
        triangles = np.asarray(np.linalg.qr(both, mode="r")).swapaxes(0, 1)
        return self._replace(W=triangles[..., :-1], tau=triangles[..., -1])


class RobustFit(NamedTuple):
    """A fit of some rows.

    Attributes:
        beta: β̂, of shape (r,). root: Upper triangular, of shape (r, r): C = root rootᵀ.
        deviation: σ, of shape (n,).
        counted: Which samples did, of shape (N,).
        off: How many deviations each sample's worst row is off, of shape (N,).
        orthogonal: Q of the counted samples' weighted rows, of shape (N_counted n, r).
    """

    beta: Array
    root: Array
    deviation: Array
    counted: Mask
    off: Array
    orthogonal: Array

    @property
    def covariance(self) -> Array:
        """C, of shape (r, r)."""
        return np.asarray(self.root @ self.root.T)


def with_columns(rows: EffortRows, further: Array) -> EffortRows:
    """Further columns (N, n, k) beside W, of which nothing is known beforehand."""
    return rows._replace(W=np.concatenate([rows.W, further], axis=2), P=np.pad(rows.P, ((0, 0), (0, further.shape[2]))))


def fitted_robustly(rows: EffortRows, robust: bool) -> RobustFit:
    """The fit of all samples, or of all but those grossly off."""
    counted = np.ones(len(rows.tau), dtype=bool)
    fit = _least_squares(rows, counted)
    if not robust or _off(rows.left(fit.beta)).max() <= _BEYOND:
        return fit
    beta = _reweighted(rows, fit.beta)
    for _ in range(_ROUNDS):
        off = _off(rows.left(beta))
        if np.array_equal(off <= _BEYOND, counted):
            break
        counted = off <= _BEYOND
        fit = _least_squares(rows, counted)
        beta = fit.beta
    return fit._replace(off=_off(rows.left(fit.beta)))


def solved(rows: EffortRows, weights: Array) -> tuple[Array, Array, Array]:
    """β̂ of rows that count by weights (N, n) (of residuals, not their squares), Q's part of them, and R."""
    r = rows.W.shape[2]
    A = np.concatenate([(weights[..., None] * rows.W).reshape(-1, r), rows.P])
    q, triangle = np.linalg.qr(A)
    beta = np.linalg.solve(triangle, q.T @ np.concatenate([(weights * rows.tau).ravel(), rows.p]))
    return beta, q[: rows.tau.size], triangle


def _least_squares(rows: EffortRows, counted: Mask) -> RobustFit:
    rows_of, deviation = rows.of(counted), np.ones(rows.tau.shape[1])
    short = rows_of.condensed()
    for _ in range(_PASSES):
        beta, q, _ = solved(short, np.broadcast_to(1.0 / deviation, short.tau.shape))
        leverage = (q**2).sum(axis=1).reshape(short.tau.shape).sum(axis=0)
        squares = (short.left(beta) ** 2).sum(axis=0)
        deviation = np.sqrt(squares / np.maximum(len(rows_of.tau) - leverage, 1.0))
        deviation = np.maximum(deviation, _LEAST * np.abs(rows.tau).max())
    beta, q, triangle = solved(rows_of, np.broadcast_to(1.0 / deviation, rows_of.tau.shape))
    root = np.asarray(np.linalg.inv(triangle), dtype=np.float64)
    return RobustFit(beta, root, deviation, counted, _off(rows.left(beta)), q)


def _reweighted(rows: EffortRows, beta: Array) -> Array:
    """Huber's estimate, from another."""
    least = _LEAST * np.abs(rows.tau).max()
    for _ in range(_ROUNDS):
        left = np.abs(rows.left(beta))
        deviation = np.maximum(_USUAL * np.median(left, axis=0), least)
        share = np.minimum(1.0, _HUBER * deviation / np.maximum(left, least))
        beta, _, _ = solved(rows, np.sqrt(share) / deviation)
    return beta


def _off(left: Array) -> Array:
    """How many deviations the worst row of each sample is off: all rows', or those about it where these are larger."""
    size = np.abs(left)
    about = median_filter(size, (_ABOUT, 1), mode="mirror")
    usual = _USUAL * np.maximum(about, np.median(size, axis=0))
    return np.asarray((size / np.maximum(usual, np.finfo(float).tiny)).max(axis=1))
