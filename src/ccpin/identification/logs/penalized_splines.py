"""Penalised quintic splines: motions whose accelerations are smooth, from samples that are noisy and may be missing.

Of c, the coefficients of q(t) = Σ_j B_j(t) c_j (quintic B-splines on even knots, c_j ∈ Rⁿ), the minimiser of

    Σ_r (y_r − g_r·B⁽ᵈ⁾(t_r) c)² / s_r² + Σ_i λ_i ∫ q⃛_i² dt

(P. Eilers and B. Marx, Flexible smoothing with B-splines and penalties, Statistical Science 11, 1996). It has no phase:
time reversed, the answer is. The normal matrix A = N + P, N the measurements' share, is banded, (6n − 1) below the
diagonal, where c is ordered knot by knot; its inverse within the band (K. Takahashi, J. Fagan and M. Chen, 1973) tells
how sure q and its derivatives are. How many numbers the fit has free is tr A⁻¹N, the derivative of log det(s N + P) at
s = 1, which one factorisation at s = 1 + iε tells to rounding.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.interpolate import BSpline
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.linalg.lapack import zgbtrf

from ccpin.arrays import Array, Indices
from ccpin.errors import InvalidInputError

DEGREE = 5
"""Of the spline; its third derivative is penalised."""
_STEP = 1e-30  # so far off the real line that its square is nothing
_GAUSS = np.polynomial.legendre.leggauss(3)  # exact for squares of third derivatives of quintics


class Knots(NamedTuple):
    """Even knots over [begin, end] and the basis on them."""

    t: Array

    @classmethod
    def over(cls, begin: float, end: float, spacing: float) -> Knots:
        """Knots at most `spacing` apart, and as many again outside as the basis needs."""
        count = max(1, int(np.ceil((end - begin) / spacing)))
        t = np.asarray(begin + (end - begin) / count * np.arange(-DEGREE, count + DEGREE + 1), dtype=np.float64)
        t[DEGREE], t[-DEGREE - 1] = begin, end  # exactly: no time is outside by rounding
        return cls(t)

    @property
    def size(self) -> int:
        """How many coefficients a coordinate has."""
        return len(self.t) - DEGREE - 1

    def basis(self, times: Array, derivative: int = 0) -> Any:
        """B⁽ᵈ⁾_j(t_r) as a sparse matrix (R, size)."""
        if not derivative:
            return BSpline.design_matrix(times, self.t, DEGREE)
        spans = np.clip(np.searchsorted(self.t, times, side="right") - 1, DEGREE, self.size - 1)
        columns, step = spans[:, None] + np.arange(-DEGREE, 1), self.t[1] - self.t[0]
        one = BSpline.basis_element(np.arange(DEGREE + 2.0)).derivative(
            derivative
        )  # knots are even: all are it, shifted
        values = one(np.clip((times[:, None] - self.t[columns]) / step, 0.0, DEGREE + 1.0)) / step**derivative
        ends = np.arange(0, values.size + 1, DEGREE + 1)
        return sparse.csr_array((values.ravel(), columns.ravel(), ends), shape=(len(times), self.size))

    def roughness(self) -> Any:
        """∫ B⃛_i B⃛_j dt as a sparse matrix."""
        inner = self.t[DEGREE:-DEGREE]
        half = (inner[1] - inner[0]) / 2.0
        points = (inner[:-1, None] + half * (1.0 + _GAUSS[0])).ravel()
        third = self.basis(points, 3)
        return third.T @ sparse.diags_array(np.tile(half * _GAUSS[1], len(inner) - 1)) @ third


class Measurements(NamedTuple):
    """Measurements that are linear in c: y_r = g_r·B⁽ᵈ⁾(t_r) c with a standard deviation of s_r.

    Attributes:
        matrix: The rows, a sparse matrix (R, size · n), c knot by knot.
        y: What was measured, of shape (R,).
        s: Standard deviations, of shape (R,).
    """

    matrix: Any
    y: Array
    s: Array


class NormalEquations(NamedTuple):
    """N c = r of measurements.

    Attributes:
        band: N, a lower band: entry (k, j) is N's (j + k, j).
        right: r, of shape (size · n,).
        rows: The measurements.
        n: Coordinates.
    """

    band: Array
    right: Array
    rows: Measurements
    n: int


class SplineFit(NamedTuple):
    """A minimiser.

    Attributes:
        c: Coefficients, of shape (size, n).
        factor: L of A = L Lᵀ, a lower band.
        residuals: y − g·B c, of shape (R,).
    """

    c: Array
    factor: Array
    residuals: Array


class SplineErrors(NamedTuple):
    """How far a fit's motion may be off: by the measurements' errors, and by its smoothness.

    P is κ times what cross-validation asks for, which is as if c ~ N(0, (P/κ)⁻¹) (G. Wahba, Bayesian "confidence
    intervals" for the cross-validated smoothing spline, Journal of the Royal Statistical Society B 45, 1983). Then

        Cov δc = A⁻¹ (N + κ P) A⁻¹ = A⁻¹ − (1 − κ) A⁻¹ P A⁻¹

    Attributes:
        basis: B, Ḃ and B̈ at the log's times, sparse matrices (T, size).
        factor: L of A = L Lᵀ, a lower band.
        penalty: P, sparse.
        smoothness: κ.
    """

    basis: list[Any]
    factor: Array
    penalty: Any
    smoothness: float

    def covariance(self, rows: Indices, slopes: Array) -> Array:
        """Of Σ_t Σ_d slopes_dᵀ δq⁽ᵈ⁾(t), of shape (r, r), t some of the log's times, slopes of shape (3, K, n, r)."""
        _, count, n, r = slopes.shape
        G = sum(
            design.tocsr()[rows].T @ each.reshape(count, n * r) for design, each in zip(self.basis, slopes, strict=True)
        ).reshape(-1, r)
        X = cho_solve_banded((self.factor, True), G)
        return np.asarray(G.T @ X - (1.0 - self.smoothness) * X.T @ (self.penalty @ X))


def normal_equations(rows: Measurements, n: int) -> NormalEquations:
    """N and r of measurements that are weighted by their deviations."""
    weighted = sparse.diags_array(1.0 / rows.s) @ rows.matrix
    return NormalEquations(banded((weighted.T @ weighted).tocsr(), n), weighted.T @ (rows.y / rows.s), rows, n)


def fitted(normal: NormalEquations, penalty: Array) -> SplineFit:
    """The minimiser for a penalty Σ λ_i ∫ q⃛_i² = cᵀ P c, P a lower band.

    Raises:
        InvalidInputError: The measurements do not determine a motion.
    """
    try:
        factor = cholesky_banded(normal.band + penalty, lower=True)
    except np.linalg.LinAlgError:
        raise InvalidInputError("too few samples: they do not determine a smooth motion") from None
    c = cho_solve_banded((factor, True), normal.right)
    return SplineFit(c.reshape(-1, normal.n), factor, normal.rows.y - normal.rows.matrix @ c)


def freedom(normal: NormalEquations, penalty: Array) -> float:
    """The effective degrees of freedom of a fit, the trace of its hat matrix: tr A⁻¹N."""
    band = normal.band + penalty + 1j * _STEP * normal.band
    width = len(band) - 1
    both = np.zeros((3 * width + 1, band.shape[1]), dtype=np.complex128, order="F")  # LAPACK's: room above for pivoting
    both[2 * width :] = band
    for k in range(1, width + 1):
        both[2 * width - k, k:] = band[k, :-k]
    pivots = zgbtrf(both, width, width, overwrite_ab=True)[0][2 * width]
    return float((pivots.imag / pivots.real).sum() / _STEP)


def variances(inverse: Array, rows: Any) -> Array:
    """x_rᵀ A⁻¹ x_r for rows within the band of A⁻¹ (`inverse_band`), of shape (R,)."""
    rows = rows.tocsr()
    count = np.diff(rows.indptr)[0]
    columns, values = rows.indices.reshape(-1, count), rows.data.reshape(-1, count)
    low = np.minimum(columns[:, :, None], columns[:, None, :])
    apart = np.abs(columns[:, :, None] - columns[:, None, :])
    found: Array = np.einsum("ri,rij,rj->r", values, inverse[apart, low], values)
    return found


def spread(design: Any, slopes: Array) -> Any:
    """Rows Σ_k slope_rk B_j(t_r) c_jk over all coefficients, knot by knot: (R, size), (R, n) → (R, size · n)."""
    design, n = design.tocsr(), slopes.shape[1]
    count = DEGREE + 1
    columns = design.indices.reshape(-1, count, 1) * n + np.arange(n)
    values = design.data.reshape(-1, count, 1) * slopes[:, None, :]
    ends = np.arange(0, columns.size + 1, count * n)
    return sparse.csr_array((values.ravel(), columns.ravel(), ends), shape=(len(slopes), design.shape[1] * n))


def apart(design: Any, n: int) -> list[Any]:
    """Rows Σ_j B_j(t) c_jk of each coordinate k alone: sparse matrices (R, size · n)."""
    design, columns = design.tocsr(), design.shape[1] * n
    shape = (design.shape[0], columns)
    return [sparse.csr_array((design.data, design.indices * n + k, design.indptr), shape=shape) for k in range(n)]


def banded(matrix: Any, n: int) -> Array:
    """The lower band of a symmetric matrix over n coordinates' coefficients, as SciPy's banded routines take it."""
    width, size = (DEGREE + 1) * n - 1, matrix.shape[0]
    band = np.zeros((width + 1, size))
    for k in range(min(width + 1, size)):
        band[k, : size - k] = matrix.diagonal(-k)
    return band


def inverse_band(factor: Array) -> Array:
    """The entries of (L Lᵀ)⁻¹ within the band of L, both lower bands."""
    width, size = len(factor) - 1, factor.shape[1]
    inverse = np.zeros_like(factor)
    near = np.zeros((width, width))  # entries of the inverse between the `width` columns that follow
    for j in range(size - 1, -1, -1):
        below = factor[1:, j] / factor[0, j]
        column = -near @ below
        inverse[0, j] = 1.0 / factor[0, j] ** 2 - below @ column
        inverse[1:, j] = column
        near[1:, 1:] = near[:-1, :-1].copy()
        near[0, 0], near[0, 1:], near[1:, 0] = inverse[0, j], column[:-1], column[:-1]
    return inverse
