"""Inverses and solutions of many small matrices, NaN instead of an exception where one is singular."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def inverses(matrices: Array) -> Array:
    """Inverses of a batch; where there is none, NaN."""
    result = np.full_like(matrices, np.nan)
    usable = np.asarray(np.isfinite(matrices).all(axis=(1, 2)))
    try:
        result[usable] = np.linalg.inv(matrices[usable])
    except np.linalg.LinAlgError:
        for k in np.flatnonzero(usable):
            result[k] = _single_inverse(matrices[k])
    return result


def _single_inverse(matrix: Array) -> Array:
    try:
        return np.asarray(np.linalg.inv(matrix))
    except np.linalg.LinAlgError:
        return np.full_like(matrix, np.nan)


def solve_many(matrices: Array, right: Array) -> Array:
    """Solve a batch of m×m systems; NaN where singular."""
    if matrices.shape[1] == 2:
        a, b, c, d = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 0], matrices[:, 1, 1]
        det = a * d - b * c
        x, y = right[:, 0], right[:, 1]
        return np.stack([(d * x - b * y) / det, (a * y - c * x) / det], axis=1)
    try:
        return np.asarray(np.linalg.solve(matrices, right[..., None])[..., 0])
    except np.linalg.LinAlgError:
        return np.asarray((inverses(matrices) @ right[..., None])[..., 0])
