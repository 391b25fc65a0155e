"""What errors of the motion do to constants found along it.

Off the true motion by δq⁽ᵈ⁾, of each log's spline (`SplineErrors`), samples are off by −L δ with
L = ∂(Y π − ρᵀSᵀu)/∂(q, q̇, q̈), and least squares with C = (Wᵀ Σ⁻¹ W + Pᵀ P)⁻¹ by −C Σ_t Wᵀ Σ⁻¹ L δ to first order: an
error that is correlated over many samples, though little of it shows in the residuals. Counted with these,

    Cov β̂ = C + C S C,    S = Cov Σ_t Wᵀ Σ⁻¹ L δ

(W. Fuller, Measurement error models, 1987). L is taken along the motion every 0.04 s, between which it
is interpolated, and without dry friction: no sample counts at which a joint may turn back, and between reversals only
δq changes what is felt of a passive joint's, ∂ρᵀ/∂q f sign q̇′ δq, which is little beside the inertial forces of δq̈.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import make_interp_spline

from ccpin.arrays import Array
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.identification.estimates.effort_samples import EffortSamples, by_log
from ccpin.identification.estimates.motor_constants import as_logged
from ccpin.identification.estimates.robust_fit import EffortRows, RobustFit
from ccpin.identification.estimates.shooting import force_slopes

_APART = 0.04  # s between the states at which L is taken


def with_motion_errors(
    model: ReducedModel,
    samples: Sequence[EffortSamples],
    rows: EffortRows,
    fit: RobustFit,
    constants: DynamicParameters,
    k: Array | None,
) -> Array:
    """Cov β̂, of shape (r, r), of a fit of all samples, L of constants π; with motors' k it is M L, L of efforts k u."""
    scores = np.where(fit.counted[:, None, None], rows.W / (fit.deviation**2)[:, None], 0.0)
    S = np.zeros_like(fit.covariance)
    for each, X in zip(samples, by_log(samples, scores), strict=True):
        if not len(each.chosen):
            continue
        pi = np.array(constants.plus(each.added).values)
        pi[constants.of("friction", "stribeck")] = 0.0
        at = _apart(each.t)
        motion, places = each.motion, each.chosen[at]
        u = motion.u[places] if k is None else k * motion.u[places]
        L = force_slopes(model, pi, (motion.q[places], motion.v[places], motion.a[places]), u)
        if len(at) > 1:
            L = make_interp_spline(each.t[at], L, k=1)(each.t)
        if k is not None:
            X = np.swapaxes(as_logged(motion.transmission(model, each.chosen), k), 1, 2) @ X
        felt = np.swapaxes(L, 1, 2) @ X
        S += motion.errors.covariance(each.chosen, felt.reshape(len(X), 3, model.n, -1).swapaxes(0, 1))
    return np.asarray(fit.covariance + fit.covariance @ S @ fit.covariance)


def _apart(t: Array) -> Array:
    """Some of increasing times, by number, the first and the last among them."""
    step = np.floor((t - t[0]) / _APART)
    return np.union1d(np.flatnonzero(np.diff(step)) + 1, [0, len(t) - 1])
