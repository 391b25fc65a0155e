"""The marginal posterior of motors' constants: how far its mode is from that of k and β together, and its curvature.

Of A u = Wₖ β + ε with Wₖ = M(k) W and ε ~ N(0, Σ), noise of what columns say, u's density has no further factor of k,
and β, linear at each k and with P β = p of unit deviation known beforehand, is integrated out exactly:

    log p(k | u) = −½ misfit(k) − ½ log det H + ½ log det H⁰ + log p(k),    H = WₖᵀΣ⁻¹Wₖ + PᵀP,

misfit the least of |A u − Wₖβ|² + |P β − p|² over β, H⁰ = NᵀHN and N the null space of P. √det H⁰ is the prior of what
nothing is known of (at each k that of H. Jeffreys, An invariant form for the prior probability in estimation problems,
1946): with one flat in β each unknown constant would say that k is large. With F_j = A_j (A⁻¹)_j,

    ∂Wₖ/∂log k_j = −F_j Wₖ,    ∂(−½ log det H)/∂log k_j = tr C_j,    C_j = H^−½ Wₖᵀ Σ⁻¹ F_j Wₖ H^−½,

h_j = tr C_j the leverage of motor j's rows where motors are on coordinates, and h⁰_j = tr Π C_j Π that of H⁰, Π onto
H^½N. The marginal's slope has h_j − h⁰_j ≥ 0 besides: how many constants the prior states and logs show. The mode of k
and β together, without it, is √m d deviations low where a scale multiplies m such constants, each known to a share d.

*Curvature.* With β ~ N(b, S), A u ~ N(Wₖb, V), V = Σ + WₖSWₖᵀ, has the information of log k

    E (what Gauss and Newton's rows have, at the posterior's β) + tr C_i C_j,

since ½ tr V⁻¹V_iV⁻¹V_j = tr C_iC_j + tr (F_iWₖ)ᵀV⁻¹F_jWₖ(S − H⁻¹), and S − H⁻¹ is the covariance of the posterior's
mean. tr C_iC_j − tr ΠC_iΠC_j is added, of C_j's symmetric parts: at least zero, and exact along the scale, of all
motors alike (where motors are on other joints, F_j is not symmetric; ratios logs tell far better than that counts).

Where nothing is known of a motor p(k) is flat in log k, and the mode that over log k; where something is, it is
Gaussian about 1, and the mode that over k: both ask for the same slope.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.identification.estimates.robust_fit import EffortRows

_ROUNDING = 1e-9  # of a constant


def marginal_rows(rows: EffortRows, A: Array, inverse: Array, deviation: Array) -> tuple[Array, Array]:
    """Rows R δ = x of unit deviation of steps δ of log k, (e, m) and (e,): RᵀR the curvature besides, Rᵀx the slope.

    Args:
        rows: Wₖ β = A u of the samples that count, and P β = p, of independent rows.
        A: The columns of ρᵀSᵀ of m motors, of shape (N, n, m).
        inverse: The rows of its inverse, of shape (N, m, n).
        deviation: Of each of the n rows of a sample.
    """
    C = shown_shares(rows, A, inverse, deviation)
    size, turned = np.linalg.eigh(np.einsum("irs,jrs->ij", C, C))
    kept = size > _ROUNDING
    root = np.sqrt(size[kept])
    return root[:, None] * turned.T[kept], turned.T[kept] @ np.trace(C, axis1=1, axis2=2) / root


def shown_shares(rows: EffortRows, A: Array, inverse: Array, deviation: Array) -> Array:
    """C_j − Π C_j Π of m motors, its symmetric part, of shape (m, r, r), in a basis of its own."""
    known, r = rows.P.shape
    turned = np.roll(np.linalg.qr(rows.P.T, mode="complete")[0], -known, axis=1)  # the null space of P first
    weighted = (rows.W / deviation[:, None] @ turned).reshape(-1, r)
    q = np.linalg.qr(np.concatenate([weighted, rows.P @ turned]))[0][: len(weighted)].reshape(rows.W.shape)
    left = np.einsum("sij,sir->jrs", A / deviation[:, None], q)
    C = left @ np.einsum("sji,sir->jsr", inverse * deviation, q)
    C = (C + np.swapaxes(C, 1, 2)) / 2.0
    C[:, : r - known, : r - known] = 0.0
    return np.asarray(C)
