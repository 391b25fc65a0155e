"""Weights λ for Theorem E, which prove cells without closed configurations empty where legs meet in one platform."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array, Mask, rows_of
from ccpin.proof.chains import ClosureSystem
from ccpin.proof.emptiness import Platform, empty_by, ends_over

_RIDGES = (1e-2, 1e-3)  # in turn
_TURNS = 8  # of the platform that are averaged
_CHUNK = 20_000  # boxes at a time: their linear systems of K + 1 rows take 8 MB at six legs


def platform_empty(system: ClosureSystem, platform: Platform, centre: Array, half: Array) -> tuple[Mask, Array]:
    """Which boxes of q-space (B, n) are proved to hold no closed configuration, and by which weights, (B, K).

    The theorem's gap between its sides is min over R of g(λ, R), concave in λ and linear in R. λ is sought as the best
    answer to the mean of the turns R that were the best answers to the λ before.
    """
    if len(centre) > _CHUNK:
        parts = [slice(k, k + _CHUNK) for k in range(0, len(centre), _CHUNK)]
        each = [platform_empty(system, platform, centre[part], half[part]) for part in parts]
        return np.concatenate([empty for empty, _ in each]), np.concatenate([weights for _, weights in each])
    ends = ends_over(system, platform, centre, half)
    count, _, size = ends.places.shape
    empty, rows, by = np.zeros(count, dtype=np.bool_), np.arange(count), np.zeros(ends.places.shape[:2])
    turned = np.broadcast_to(np.eye(size), (count, size, size))
    for turn in range(1, _TURNS + 1):
        here = rows_of(ends, rows)
        weights = _weights(here.places, platform.places, turned, platform.lengths, _RIDGES[turn % 2])
        found, best = empty_by(platform, here, weights)
        empty[rows[found]], by[rows[found]] = True, weights[found]
        rows, turned = rows[~found], (turned + (best - turned) / (turn + 1))[~found]
        if not rows.size:
            break
    return empty, by


def _weights(a: Array, b: Array, turned: Array, lengths: Array, ridge: float) -> Array:
    """Weights λ (B, K), Σ λ = 1, about best for turns R (B, r, r), those of points that lie together alike.

    With R they maximise Σ λ(|a|² + |b|² − 2aᵀRb − l²) − |ā|² − |b̄|² + 2āᵀRb̄ less a ridge, which keeps them small.
    """
    a, b = a - a.mean(axis=1, keepdims=True), b - b.mean(axis=0)
    count, crossed = a.shape[1], a @ turned @ b.T
    gram = a @ np.swapaxes(a, 1, 2) + b @ b.T - crossed - np.swapaxes(crossed, 1, 2)
    system = np.zeros((len(a), count + 1, count + 1))
    scale = np.trace(gram, axis1=1, axis2=2)[:, None, None] + 1e-9
    system[:, :count, :count] = 2.0 * (gram + ridge * scale * np.eye(count))
    system[:, :count, count] = system[:, count, :count] = 1.0
    right = np.ones((len(a), count + 1))
    right[:, :count] = np.diagonal(gram, axis1=1, axis2=2) - lengths**2
    found = np.linalg.solve(system, right[..., None])[:, :count, 0]
    return np.asarray(found / found.sum(axis=1, keepdims=True))
