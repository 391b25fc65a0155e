"""Where a sensor stands: turns in three angles, the frame that fits points best, and what turns poses leave."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array

_AXES = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(0, 2, 1)  # [e_x]×, [e_y]×, [e_z]×


def turned(angles: Array) -> tuple[Array, tuple[Array, Array, Array]]:
    """R = R_z R_y R_x, of shape (3, 3), and its derivatives by the three angles."""
    x, y, z = (
        np.eye(3) + np.sin(angle) * way + (1.0 - np.cos(angle)) * way @ way
        for angle, way in zip(angles, _AXES, strict=True)
    )
    X, Y, Z = _AXES
    whole = z @ y @ x
    return whole, (z @ y @ X @ x, z @ Y @ y @ x, Z @ whole)


def best_frame(points: Array, measured: Array, axes: Array, measured_axes: Array) -> Array:
    """The frame, 4×4, that carries points of shape (N, 3), and axes (N, 3, 3) where there are any, to those measured.

    R maximises tr RᵀM, M = Σ (m − m̄)(x − x̄)ᵀ of unit length, and the mean of R_m Aᵀ (W. Kabsch, Acta Crystallographica
    A32, 1976).
    """
    centre, about = points.mean(axis=0), measured.mean(axis=0)
    moment = (measured - about).T @ (points - centre)
    size = np.linalg.norm(moment)
    moment = moment / size if size else moment
    if len(axes):
        moment = moment + np.einsum("Nij,Nkj->ik", measured_axes, axes) / len(axes)
    U, _, Vt = np.linalg.svd(moment)
    found = np.eye(4)
    found[:3, :3] = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    found[:3, 3] = about - found[:3, :3] @ centre
    return found


def turn_between(axes: Array, measured: Array) -> Array:
    """½(AᵀM − MᵀA)ᵛ of axes A and M of shape (N, 3, 3): log(AᵀM) but for terms of third order, of shape (N, 3)."""
    return 0.5 * np.asarray(np.einsum("lji,Nkj,Nki->Nl", _AXES, axes, measured))


def turn_slopes(measured: Array) -> Array:
    """∂/∂A of `turn_between`, of shape (N, 3, 9), the entries of A row by row."""
    return 0.5 * np.asarray(np.einsum("lji,Nki->Nlkj", _AXES, measured)).reshape(-1, 3, 9)
