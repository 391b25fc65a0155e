"""How late the efforts' clock is: of each log the delay that leaves least of them.

Where efforts carry stamps that are late by τ, what is measured at t is F(t − τ) ≈ F(t) − τ Ḟ(t) for F = Y π. Ḟ of what
is told has an encoder's noise twice differentiated, of which least squares would make too small a τ; Ḟ of what is
measured has the efforts' noise. The two are independent: with A the columns −Ḟ of each log as told, less what W
explains of them, and M as measured,

    τ = (Aᵀ M)⁻¹ Aᵀ left,    Cov τ = σ² (Aᵀ M)⁻¹ Aᵀ A (Mᵀ A)⁻¹

(instrumental variables; T. Söderström and P. Stoica, Instrumental variable methods for system identification, 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.identification.estimates.robust_fit import RobustFit

_SHOWS = 1e-6  # of a rate: less is what constants explain as well, or rounding


class Delay(NamedTuple):
    """By how many seconds a log's efforts are late, its standard deviation, and how much of it was set right."""

    log: str
    seconds: float
    deviation: float
    taken: float


def slopes(t: Array, stretch: Indices, force: Array) -> Array:
    """Ḟ (N, n) by differences of neighbours in one stretch; 0 at its ends, beyond which friction may jump."""
    found = np.zeros_like(force)
    inner = np.flatnonzero(stretch[2:] == stretch[:-2]) + 1
    found[inner] = (force[inner + 1] - force[inner - 1]) / (t[inner + 1] - t[inner - 1])[:, None]
    return found


def further_delays(
    fit: RobustFit, left: Array, told: Sequence[Array], measured: Sequence[Array]
) -> tuple[Array, Array]:
    """τ of each log and its standard deviation; 0 and ∞ where its motion shows none.

    Args:
        fit: Of all samples of all logs.
        left: What it leaves of them, of shape (N, n).
        told: Ḟ of each log's samples as told, one log after the other.
        measured: Ḟ as measured, likewise.
    """
    A, M = (_columns(each)[fit.counted] / fit.deviation[:, None] for each in (told, measured))
    A, M = (each.reshape(-1, len(told)) for each in (A, M))
    size = np.linalg.norm(A, axis=0)
    A = A - fit.orthogonal @ (fit.orthogonal.T @ A)
    shown = np.linalg.norm(A, axis=0) > _SHOWS * size
    seconds, deviation = np.zeros(len(told)), np.full(len(told), np.inf)
    if shown.any():
        A, M = A[:, shown], M[:, shown]
        inverse = np.linalg.pinv(A.T @ M)
        seconds[shown] = inverse @ (A.T @ (left[fit.counted] / fit.deviation).ravel())
        deviation[shown] = np.sqrt(np.diag(inverse @ (A.T @ A) @ inverse.T))
    return seconds, deviation


def _columns(rates: Sequence[Array]) -> Array:
    """−Ḟ of each log in a column of its own, of shape (N, n, logs)."""
    found, first = np.zeros((sum(map(len, rates)), rates[0].shape[1], len(rates))), 0
    for k, rate in enumerate(rates):
        found[first : first + len(rate), :, k] = -rate
        first += len(rate)
    return found
