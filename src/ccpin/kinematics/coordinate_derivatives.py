"""The directional derivative of α's acceleration bias α̇_q′ q̇′, exact; it is zero where whole joints are independent.

A translation component of a joint is an entry of R v with R the joint's rotation and v its velocity in the moving
frame, so its bias is that entry of R (ω × v). A rotation component is an entry of the rotation vector r, with
ṙ = J(r) ω, J = I + ½[r]× + c [r]ײ, c a function of t = |r|² alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.row_derivatives import Directions

# |B₂ₖ|/(2k)! for k = 1, 2, …: c(t) = Σ of these times tᵏ⁻¹, convergent for t < 4π².
_SERIES = np.array([
    1 / 12,
    1 / 720,
    1 / 30240,
    1 / 1209600,
    1 / 47900160,
    691 / 1307674368000,
    1 / 74724249600,
    3617 / 10670622842880000,
    43867 / 5109094217170944000,
    174611 / 802857662698291200000,
])  # fmt: skip
_SERIES_BELOW = 1.0


class _Local(NamedTuple):
    """A multi-dof joint's rotation R, and its velocity and the directions split into (linear, angular), 3 rows each."""

    rotation: Array
    v: Array
    omega: Array
    step: Array
    dv: Array
    domega: Array


def alpha_bias_derivative(
    coordinates: IndependentCoordinates, q_free: Array, v_free: Array, directions: Directions
) -> Array:
    """D(α̇_q′ q̇′) in each direction, of shape (n, k)."""
    derivative = np.zeros((coordinates.n, directions.dq.shape[1]))
    for part in coordinates.parts:
        if part.component is None or (part.kind == "planar" and part.component == "rz"):
            continue
        axis = "xyz".index(part.component[1])
        local = _split(part.kind, q_free[part.q_free], v_free[part.v_free], directions, part.v_free)
        if part.component[0] == "t":
            derivative[part.v] = (local.rotation @ _translation(local))[axis]
        else:
            reference = pin.Quaternion(coordinates.q_reference[part.q_free][-4:]).matrix()
            derivative[part.v] = _rotation_vector(np.asarray(pin.log3(reference.T @ local.rotation)), local)[axis]
    return derivative


def _split(kind: str, configuration: Array, velocity: Array, directions: Directions, window: slice) -> _Local:
    """The joint's motion as of a free body: a planar joint has entries (x, y, angle about z)."""
    dq, dv = directions.dq[window], directions.dv[window]
    if kind == "planar":
        cosine, sine = configuration[2:]
        rotation = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        entries = [0, 1, 5]
    else:
        rotation = np.asarray(pin.Quaternion(configuration[-4:]).matrix())
        entries = [3, 4, 5] if kind == "spherical" else [0, 1, 2, 3, 4, 5]
    whole = np.zeros((6, 1 + 2 * dq.shape[1]))
    whole[entries] = np.column_stack([velocity, dq, dv])
    k = dq.shape[1]
    return _Local(rotation, whole[:3, 0], whole[3:, 0], whole[3:, 1 : 1 + k], whole[:3, 1 + k :], whole[3:, 1 + k :])


def _translation(local: _Local) -> Array:
    """Rᵀ D(R (ω × v)), of shape (3, k)."""
    turned = np.cross(local.step.T, np.cross(local.omega, local.v))
    return np.asarray((turned + np.cross(local.domega.T, local.v) + np.cross(local.omega, local.dv.T)).T)


def _rotation_vector(r: Array, local: _Local) -> Array:
    """D(J̇ ω) of ṙ = J(r) ω, of shape (3, k), with b = [r]ײ ω = r (r·ω) − t ω."""
    omega, t = local.omega, float(r @ r)
    c, c_t, c_tt = _coefficients(t)
    b = r * (r @ omega) - t * omega
    r_1 = omega + 0.5 * np.cross(r, omega) + c * b
    t_1 = 2.0 * float(r @ r_1)
    b_1 = r_1 * (r @ omega) + r * (r_1 @ omega) - t_1 * omega
    columns = []
    for step, domega in zip(local.step.T, local.domega.T, strict=True):
        dr = step + 0.5 * np.cross(r, step) + c * (r * (r @ step) - t * step)
        dt = 2.0 * float(r @ dr)
        db = dr * (r @ omega) + r * (dr @ omega + r @ domega) - dt * omega - t * domega
        dr_1 = domega + 0.5 * (np.cross(dr, omega) + np.cross(r, domega)) + c_t * dt * b + c * db
        dt_1 = 2.0 * float(dr @ r_1 + r @ dr_1)
        db_1 = dr_1 * (r @ omega) + r_1 * (dr @ omega + r @ domega) - dt_1 * omega - t_1 * domega
        db_1 += dr * (r_1 @ omega) + r * (dr_1 @ omega + r_1 @ domega)
        dc_1 = c_tt * dt * t_1 + c_t * dt_1
        turning = 0.5 * (np.cross(dr_1, omega) + np.cross(r_1, domega))
        columns.append(turning + dc_1 * b + c_t * t_1 * db + c_t * dt * b_1 + c * db_1)
    return np.array(columns).T.reshape(3, -1)


def _coefficients(t: float) -> tuple[float, float, float]:
    """c(t) = 1/t − cot(θ/2)/(2θ) with θ = √t, c′(t) and c″(t)."""
    if t < _SERIES_BELOW:
        series = np.polynomial.Polynomial(_SERIES)
        return float(series(t)), float(series.deriv()(t)), float(series.deriv(2)(t))
    theta = float(np.sqrt(t))
    cot = 1.0 / float(np.tan(0.5 * theta))
    square = 1.0 + cot * cot
    c = 1.0 / t - cot / (2.0 * theta)
    c_t = -1.0 / t**2 + cot / (4.0 * theta**3) + square / (8.0 * t)
    c_tt = 2.0 / t**3 - 3.0 * cot / (8.0 * theta**5) - 3.0 * square / (16.0 * t**2) - cot * square / (16.0 * theta**3)
    return c, c_t, c_tt
