"""The covariance of constants where noise of the efforts is coloured: correlated from sample to sample.

With X = Σ^−½ W, e = Σ^−½ ε of covariances R(l) = E e_s e_{s+l}ᵀ and C = (XᵀX + PᵀP)⁻¹, least squares is off by
C (Σ_s X_sᵀ e_s + Pᵀ e_p), e_p the prior's own errors, of

    Cov β̂ = C (Σ_l w_l Σ_s X_sᵀ R(l) X_{s+l} + PᵀP) C,    w_l = 1 − |l|/(L + 1),

which is C where noise is white. R is that of the residuals, over all pairs of samples l apart that both count;
weights that fall to zero keep the sum positive (W. Newey and K. West, A simple, positive semi-definite,
heteroskedasticity and autocorrelation consistent covariance matrix, 1987). With a the largest autocorrelation of a row,

    L = 1.1447 (4 a² N / (1 − a²)²)^⅓

suits noise of one lag (D. Andrews, Heteroskedasticity and autocorrelation consistent covariance matrix estimation,
1991). Errors of the motion correlate residuals, too, and `motion_errors` counts them: what is told is no
smaller in any direction than with these and white noise, nor than this, and where a is below a tenth this is left out.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ccpin.arrays import Array
from ccpin.identification.estimates.effort_samples import EffortSamples, by_log
from ccpin.identification.estimates.robust_fit import EffortRows, RobustFit

_WHITE, _MOST = 0.1, 0.99  # autocorrelations
_ROUNDING = 1e-14  # of the largest direction of a covariance of unit deviations


def with_coloured_noise(
    covariance: Array, samples: Sequence[EffortSamples], rows: EffortRows, fit: RobustFit, autocorrelation: Array
) -> Array:
    """Cov β̂, of shape (r, r), no smaller than one told, where the autocorrelation of a row, of shape (n,), is large."""
    a = min(float(autocorrelation.max(initial=0.0)), _MOST)
    if a < _WHITE:
        return covariance
    scale = np.sqrt(np.diag(covariance))
    share, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    root = np.sqrt(np.maximum(share, _ROUNDING * share[-1]))
    L, inverse = scale[:, None] * axes * root, (axes / root).T / scale
    size, turned = np.linalg.eigh(inverse @ coloured_covariance(samples, rows, fit, a) @ inverse.T)
    L = L @ turned * np.sqrt(np.maximum(size, 1.0))
    return np.asarray(L @ L.T)


def coloured_covariance(samples: Sequence[EffortSamples], rows: EffortRows, fit: RobustFit, a: float) -> Array:
    """Cov β̂ of what is left, of shape (r, r)."""
    from scipy.signal import oaconvolve  # most of a second to load, which few estimates need

    lags = int(1.1447 * (4.0 * a**2 * fit.counted.sum() / (1.0 - a**2) ** 2) ** (1.0 / 3.0))
    weights = fit.counted[:, None] / fit.deviation
    left, W, count = rows.left(fit.beta) * weights, rows.W * weights[..., None], fit.counted[:, None].astype(np.float64)
    e, X_of, counts = (_on_grids(samples, part, lags) for part in (left, W, count))
    R, pairs = (sum(_products(each, lags) for each in part) for part in (e, counts))
    w = 1.0 - np.abs(np.arange(-lags, lags + 1)) / (lags + 1.0)
    R = R / np.maximum(pairs, 1.0) * w[:, None, None]
    S = rows.P.T @ rows.P
    for X in X_of:
        felt = sum(oaconvolve(X[:, None, j], R[::-1, :, j, None], axes=0) for j in range(X.shape[1]))
        S = S + np.einsum("sir,siq->rq", X, felt[lags : lags + len(X)])
    return np.asarray(fit.covariance @ ((S + S.T) / 2.0) @ fit.covariance)


def _on_grids(samples: Sequence[EffortSamples], values: Array, lags: int) -> list[Array]:
    """Each log's samples at their places among its times, with zeros between them and after the last."""
    found = list[Array]()
    for each, own in zip(samples, by_log(samples, values), strict=True):
        found.append(np.zeros((int(each.chosen.max(initial=0)) + 1 + lags, *values.shape[1:])))
        found[-1][each.chosen] = own
    return found


def _products(values: Array, lags: int) -> Array:
    """Σ_s x_s x_{s+l}ᵀ for l = −lags, …, lags, of shape (2 lags + 1, n, n)."""
    ahead = np.array([values[: len(values) - k].T @ values[k:] for k in range(lags + 1)])
    return np.concatenate([np.swapaxes(ahead[:0:-1], 1, 2), ahead])
