"""Solving with ψ_q′, square or tall, with a reciprocal condition number to judge it by."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from ccpin.arrays import Array


class Factor(NamedTuple):
    """A factorised ψ_q′ of full column rank.

    Attributes:
        lu, pivots: LAPACK's LU where ψ_q′ is square (``None`` pivots: tall).
        q, r: The reduced QR where redundant rows make ψ_q′ tall.
        rcond: Reciprocal condition number in the 1-norm, 0 where exactly singular.
        sign: Sign of det ψ_q′, 0 where ψ_q′ is tall.
    """

    lu: Array | None
    pivots: NDArray[np.int32] | None
    q: Array | None
    r: Array | None
    rcond: float
    sign: int

    @property
    def columns(self) -> int:
        """n′."""
        factor = self.lu if self.lu is not None else self.r
        return 0 if factor is None else int(factor.shape[1])

    def solve(self, right: Array) -> Array:
        """ψ_q′⁺ right: the solution where the rows agree, in the least-squares sense where they do not."""
        if not right.size:
            return np.zeros((self.columns, *right.shape[1:]))
        if right.ndim == 2:
            return _by_columns(self.solve, right)
        if self.pivots is not None:
            return np.asarray(lapack.dgetrs(self.lu, self.pivots.copy(), right)[0])  # SciPy writes to the pivots
        assert self.q is not None
        return np.asarray(lapack.dtrtrs(self.r, self.q.T.dot(right))[0])

    def solve_transposed(self, right: Array) -> Array:
        """The least-norm solution x of ψ_q′ᵀ x = right."""
        if right.ndim == 2:
            return _by_columns(self.solve_transposed, right)
        if self.pivots is not None:
            return np.asarray(lapack.dgetrs(self.lu, self.pivots.copy(), right, trans=1)[0])
        assert self.q is not None
        return np.asarray(self.q.dot(lapack.dtrtrs(self.r, right, trans=1)[0]))


def _by_columns(solve: Callable[[Array], Array], right: Array) -> Array:
    """Solve column by column: OpenBLAS starts threads for several right sides at once, which costs milliseconds."""
    solution = np.empty((0, right.shape[1]))
    for k in range(right.shape[1]):
        column = solve(right[:, k])
        if k == 0:
            solution = np.empty((len(column), right.shape[1]))
        solution[:, k] = column
    return solution


def factorize(matrix: Array) -> Factor:
    """Factorise a square or tall matrix; a singular one comes back with rcond = 0, never as NaN."""
    rows, columns = matrix.shape
    if rows < columns:
        return Factor(None, None, None, None, 0.0, 0)
    if rows == columns:
        norm = float(np.abs(matrix).sum(axis=0).max()) if rows else 1.0
        lu, pivots, info = lapack.dgetrf(matrix)
        if info != 0 or not np.isfinite(norm):
            return Factor(lu, pivots, None, None, 0.0, 0)
        rcond = float(lapack.dgecon(lu, norm)[0])
        swaps = int(np.count_nonzero(pivots != np.arange(rows)))
        negative = int(np.count_nonzero(lu.diagonal() < 0))
        return Factor(lu, pivots, None, None, rcond, 1 if (swaps + negative) % 2 == 0 else -1)
    if not np.all(np.isfinite(matrix)):
        return Factor(None, None, None, None, 0.0, 0)
    q, r = np.linalg.qr(matrix)
    rcond = float(lapack.dtrcon(r)[0]) if np.all(r.diagonal() != 0) else 0.0
    return Factor(None, None, q, r, rcond, 0)
