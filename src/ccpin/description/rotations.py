"""Rotations by their rotation vector r (axis times angle θ), unit quaternions (x, y, z, w), and the logarithm's rate.

With ω the angular velocity in the turning frame, ṙ = J(r) ω, J = I + ½[r]× + c [r]ײ, where c = 1/t − cot(θ/2)/(2θ)
is a function of t = θ² = |r|² alone.
"""

from __future__ import annotations

import math

import numpy as np

from ccpin.arrays import Array, cross, skew

# c = Σ cₖ tᵏ with cₖ = |B₂ₖ₊₂|/(2k + 2)!, convergent for t < 4π²; the columns are the series of c, c′ and c″.
_C = np.polynomial.Polynomial([
    1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160,
    691 / 1307674368000, 1 / 74724249600, 3617 / 10670622842880000,
    43867 / 5109094217170944000, 174611 / 802857662698291200000,
])  # fmt: skip
_SERIES: Array = np.column_stack([np.pad(_C.deriv(k).coef, (0, k)) for k in range(3)])
_SERIES_BELOW = 1.0  # of t: the closed forms cancel near 0, and ten terms of the series are enough up to here


def quaternion_matrix(quaternion: Array) -> Array:
    """The rotation of a unit quaternion, of shape (3, 3)."""
    x, y, z, w = (float(entry) for entry in quaternion)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_difference(quaternion_from: Array, quaternion_to: Array) -> Array:
    """log(R_fromᵀ R_to), of shape (3,), |r| ≤ π, without forming the matrices."""
    a, b, c, s = quaternion_from.tolist()
    x, y, z, w = quaternion_to.tolist()
    vector = (s * x - w * a + c * y - b * z, s * y - w * b + a * z - c * x, s * z - w * c + b * x - a * y)
    sine, cosine = math.hypot(*vector), a * x + b * y + c * z + s * w
    gain = math.atan2(math.copysign(sine, cosine), abs(cosine)) / sine if sine else math.copysign(1.0, cosine)
    return 2.0 * gain * np.array(vector)


def quaternion_rate(quaternion: Array, omega: Array) -> Array:
    """½ q ⊗ ω, of shape (4,)."""
    x, y, z, w = quaternion
    return np.asarray(0.5 * np.array([[w, -z, y], [z, w, -x], [-y, x, w], [-x, -y, -z]]) @ omega)


def log_jacobian(r: Array) -> Array:
    """J(r), of shape (3, 3); J(−r) is the inverse of the left Jacobian that the logarithm on SE(3) applies to p."""
    turned = skew(r)
    return np.asarray(np.eye(3) + 0.5 * turned + _coefficients(float(r @ r))[0] * turned @ turned)


def log_jacobian_rate(r: Array, omega: Array) -> Array:
    """d/dt J(r) for ṙ = J(r) ω, of shape (3, 3)."""
    r_1 = log_jacobian(r) @ omega
    turned, turned_1 = skew(r), skew(r_1)
    c, c_t, _ = _coefficients(float(r @ r))
    turning = 2.0 * c_t * float(r @ r_1)
    return np.asarray(0.5 * turned_1 + turning * turned @ turned + c * (turned_1 @ turned + turned @ turned_1))


def log_bias_derivative(r: Array, omega: Array, step: Array, domega: Array) -> Array:
    """D(J̇ ω), of shape (3,), where the frame turns by `step` (3,) and ω changes by `domega` (3,).

    With b = [r]ײ ω = r (r·ω) − t ω, ṙ = ω + ½ r × ω + c b.
    """
    t = float(r @ r)
    c, c_t, c_tt = _coefficients(t)
    b = r * (r @ omega) - t * omega
    r_1 = omega + 0.5 * cross(r, omega) + c * b
    t_1 = 2.0 * float(r @ r_1)
    b_1 = r_1 * (r @ omega) + r * (r_1 @ omega) - t_1 * omega
    dr = step + 0.5 * cross(r, step) + c * (r * (r @ step) - t * step)
    dt = 2.0 * float(r @ dr)
    db = dr * (r @ omega) + r * (dr @ omega + r @ domega) - dt * omega - t * domega
    dr_1 = domega + 0.5 * (cross(dr, omega) + cross(r, domega)) + c_t * dt * b + c * db
    dt_1 = 2.0 * float(dr @ r_1 + r @ dr_1)
    db_1 = dr_1 * (r @ omega) + r_1 * (dr @ omega + r @ domega) - dt_1 * omega - t_1 * domega
    db_1 += dr * (r_1 @ omega) + r * (dr_1 @ omega + r_1 @ domega)
    dc_1 = c_tt * dt * t_1 + c_t * dt_1
    turning = 0.5 * (cross(dr_1, omega) + cross(r_1, domega))
    return np.asarray(turning + dc_1 * b + c_t * t_1 * db + c_t * dt * b_1 + c * db_1)


def _coefficients(t: float) -> tuple[float, float, float]:
    """c(t), c′(t) and c″(t); h = 1 − t c = (θ/2) cot(θ/2) has h′ = (h − h² − t/4)/(2t)."""
    if t < _SERIES_BELOW:
        c, c_t, c_tt = (t ** np.arange(len(_SERIES)) @ _SERIES).tolist()
        return c, c_t, c_tt
    half = 0.5 * math.sqrt(t)
    h = half / math.tan(half)
    h_t = (h - h * h - 0.25 * t) / (2.0 * t)
    h_tt = (h_t * (1.0 - 2.0 * h) - 0.25 - 2.0 * h_t) / (2.0 * t)
    c = (1.0 - h) / t
    c_t = -(h_t + c) / t
    return c, c_t, -(h_tt + 2.0 * c_t) / t
