"""Storage functions V = xᵀP x of the tracking errors x = (e, ė), and what a deviation Δ of the law does to them.

`ccpin/proof/theorems/storage.md` has P, W and S of both laws, the lemma and its rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.tracking.error_equations import Feedback, StorageChoice
from ccpin.proof.balls import Affine, affine, joined
from ccpin.proof.rounding import SLACK, UNIT_ROUNDOFF

_CLEAR = 1e-9  # relative: covers the rounding of eigenvalues and of lower bounds
_DEFINITE = 1e-7  # of matrices with a diagonal of ones: a million times what eigenvalues are computed to


class Storage(NamedTuple):
    """P, W and S over K cells, for all states in them.

    Attributes:
        P, W: Of shape (K, 2n, 2n).
        S: Of shape (2n, n).
    """

    P: Affine
    W: Affine
    S: Array


def storage_of(law: Feedback, plan: StorageChoice, D: Affine, C: Affine, damping: Affine) -> Storage:
    """The storage function of a plan over cells with these D, C and damping (K, n, n)."""
    n = len(plan.scale)
    if plan.P is not None:
        return Storage(affine(plan.P[None]), *_constant(law, plan.P))
    c = plan.cross
    corner = affine(c * law.K_p) + D * 0.0
    mixed, low = (damping - C.transposed()) * (0.5 * c), damping + law.K_v - D * c
    half = D * (0.5 * c)
    P = _blocks(0.5 * (law.K_p + c * law.K_v) + D * 0.0, half, D * 0.5)
    return Storage(P, _blocks(corner, mixed, low), np.vstack([c * np.eye(n), np.eye(n)]))


def _constant(law: Feedback, P: Array) -> tuple[Affine, Array]:
    """W with its rounding, of shape (1, 2n, 2n), and S of computed torque."""
    n = len(law.K_p)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-law.K_p, -law.K_v]])
    sizes = np.abs(P) @ np.abs(A)
    rounding = (2 * n + 2) * UNIT_ROUNDOFF * (sizes + sizes.T) * SLACK
    W = -(P @ A + A.T @ P)
    return Affine(W[None], np.zeros((0, 1, *W.shape)), rounding[None]), 2.0 * P[:, n:]


def _blocks(first: Affine, mixed: Affine, last: Affine) -> Affine:
    """The symmetric matrices [first mixed; mixedᵀ last]."""
    return joined([joined([first, mixed], -1), joined([mixed.transposed(), last], -1)], -2)


def floor(matrix: Affine) -> Array:
    """A matrix below all symmetric ones of a form (K, k, k): x_i x_j δ_ij ≤ ½|δ_ij|(r x_i² + x_j²/r) for any r > 0."""
    size = np.sqrt(np.abs(np.diagonal(matrix.mid, axis1=1, axis2=2)))
    with np.errstate(all="ignore"):
        ratio = size[:, :, None] / size[:, None, :]
        lost = np.sum(matrix.spread * ratio, axis=2) * SLACK
    lowered = matrix.mid.copy()
    k = np.arange(matrix.mid.shape[1])
    lowered[:, k, k] -= lost + _CLEAR * np.abs(lowered[:, k, k])
    return lowered


def gain(storage: Storage, plan: StorageChoice) -> Array:
    """g of each cell, of shape (K,), as in the lemma; infinite where W − αP is not proved positive definite."""
    M = floor(storage.W - storage.P * plan.decay)
    S = storage.S * plan.scale
    squared = _inverse_form(M, S) / (4.0 * plan.decay)
    return np.sqrt(squared)


def widths(storage: Storage) -> Array:
    """(P⁻¹)_ii^½ at the worst of each cell, of shape (K, 2n); infinite where P may be indefinite."""
    lowest = floor(storage.P)
    inverse = inverted(lowest)
    return np.sqrt(np.diagonal(inverse, axis1=1, axis2=2)) * SLACK


def _inverse_form(M: Array, S: Array) -> Array:
    """λ_max(SᵀM⁻¹S) of each matrix; infinite where it is not positive definite."""
    inner = np.swapaxes(S, -1, -2) @ (inverted(M) @ S)
    usable = np.isfinite(inner).all(axis=(1, 2))
    result = np.full(len(M), np.inf)
    result[usable] = np.linalg.eigvalsh(inner[usable])[:, -1] * (1.0 + _CLEAR)
    return result


def inverted(M: Array) -> Array:
    """Matrices above the inverses of those (K, k, k) that are proved positive definite; infinite for the others."""
    result = np.full(M.shape, np.inf)
    k = M.shape[1]
    size = np.sqrt(np.abs(np.diagonal(M, axis1=1, axis2=2)))
    outer = size[:, :, None] * size[:, None, :]
    usable = np.isfinite(M).all(axis=(1, 2)) & np.all(size > 0.0, axis=1)
    scaled = M[usable] / outer[usable]
    least = np.linalg.eigvalsh(scaled)[:, 0] * (1.0 - _CLEAR)
    definite = least > _DEFINITE
    scaled, least = scaled[definite], least[definite]
    inverse = np.linalg.inv(scaled)
    inverse = 0.5 * (inverse + np.swapaxes(inverse, 1, 2))
    off = np.abs(np.eye(k) - inverse @ scaled) + (k + 4) * UNIT_ROUNDOFF * (np.abs(inverse) @ np.abs(scaled))
    off = np.linalg.norm(off, axis=(1, 2)) / least + 4.0 * UNIT_ROUNDOFF * np.linalg.norm(inverse, axis=(1, 2))
    rows = np.flatnonzero(usable)[definite]
    result[rows] = (inverse + off[:, None, None] * SLACK * np.eye(k)) / outer[rows]
    return result
