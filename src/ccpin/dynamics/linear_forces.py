"""The equations of motion as a matrix times constants: Y(q, q̇, q̈) π = D q̈ + C q̇ + damping q̇ + g + ρᵀf (22).

π is `ccpin.dynamics.parameters`, f the dry friction [c + (s − c) exp(−(q̇′/v_s)²)] sign(q̇′) of every joint, driven
or not. For Slotine and Li's law the velocity that C multiplies is another one, Y_r π = D q̈_r + C(q̇) q̇_r + g, with
the C of (24): Christoffel's in the free system, so that Ḋ − 2C is skew symmetric.

Each body brings its part in its own axes. With G (6, n) its twist for unit q̇, V = G q̇, V_r = G q̇_r,
A_r = G q̈_r + Ġ q̇_r − (gravity, 0), and M its inertia, the wrench that it takes is

    M A_r + ½ [V ×* (M V_r) + V_r ×* (M V) − M (V × V_r)]

(S. Echeandia and P. M. Wensing, Numerical methods to compute the Coriolis matrix and Christoffel symbols, 2021), and
M V = K(V) π_b is linear in the body's ten numbers.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, cross, skew
from ccpin.dynamics.free_system import FreeSystem
from ccpin.dynamics.parameters import BODY, joint_kinds
from ccpin.kinematics.scratch import six_rows
from ccpin.kinematics.tree import Tree, TreeJoint

_INERTIA = np.zeros((3, 6, 3))  # I ω = Σ_j,k of it times the k-th of (Ixx, Ixy, Iyy, Ixz, Iyz, Izz) and ω_j
for _k, (_i, _j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))):
    _INERTIA[_i, _k, _j] = _INERTIA[_j, _k, _i] = 1.0


class _Placed(NamedTuple):
    """Joint frames and velocities at a configuration, in world axes.

    Attributes:
        rotation, position: Of the bodies' frames, of shapes (B, 3, 3) and (B, 3).
        jacobian, rate: Twists about the world's origin for unit q̇′, as if all joints carried one body, and their
            rates, of shape (6, n′).
    """

    rotation: Array
    position: Array
    jacobian: Array
    rate: Array


def regressor(
    tree: Tree, free: FreeSystem, q_free: Array, rho: Array, rho_dot: Array, v: Array, a: Array, v_r: Array
) -> Array:
    """Y at one state, of shape (n, p).

    Args:
        tree: The free system's tree.
        free: Its masses are not asked for; its gravity is.
        q_free: A closed configuration, of shape (nq,).
        rho: ρ, of shape (n′, n).
        rho_dot: ρ̇ along v, of shape (n′, n).
        v: q̇: what the bodies do, and which way joints rub, of shape (n,).
        a: q̈_r, of shape (n,).
        v_r: q̇_r: what C and dampers multiply, of shape (n,).
    """
    v_free, v_r_free, a_free = rho @ v, rho @ v_r, rho @ a + rho_dot @ v_r
    placed, masks = _moved(free, q_free, v_free), _supports(tree)
    twists = _carried(placed, placed.jacobian, masks, rho)
    V, V_r = twists @ v, twists @ v_r
    pulled = _carried(placed, placed.jacobian, masks, a_free[:, None])
    A = (pulled + _carried(placed, placed.rate, masks, v_r_free[:, None]))[..., 0]
    A[:, :3] -= free.model.gravity.linear @ placed.rotation
    wrench = _momentum(A - 0.5 * _crossed(V, V_r))
    wrench += 0.5 * (_force_crossed(V, _momentum(V_r)) + _force_crossed(V_r, _momentum(V)))
    bodies = np.einsum("bin,bik->nbk", twists, wrench)
    joints = [_joint_columns(j, rho, q_free, a_free, v_r_free, v_free) for j in tree.joints]
    return np.concatenate([bodies.reshape(rho.shape[1], BODY * len(tree.joints)), *joints], axis=1)


def energy_regressor(tree: Tree, free: FreeSystem, q_free: Array, v_free: Array) -> Array:
    """Y_E at one state, of shape (p,): Y_E π is kinetic and potential energy, springs' less ½ k θ₀², a constant."""
    placed = _moved(free, q_free, v_free)
    V = _carried(placed, placed.jacobian, _supports(tree), v_free[:, None])[..., 0]
    bodies = 0.5 * np.einsum("bi,bik->bk", V, _momentum(V))
    gravity = free.model.gravity.linear
    bodies[:, 0] -= placed.position @ gravity
    bodies[:, 1:4] -= gravity @ placed.rotation
    return np.concatenate([bodies.ravel(), *(_joint_energy(j, q_free, v_free) for j in tree.joints)])


def _moved(free: FreeSystem, q_free: Array, v_free: Array) -> _Placed:
    """Where the bodies are and how joints move them."""
    with free.scratch.lent() as data:
        pin.computeJointJacobiansTimeVariation(free.model, data, q_free, v_free)
        frames = [data.oMi[b] for b in range(1, free.model.njoints)]
        rotation = np.array([frame.rotation for frame in frames]).reshape(-1, 3, 3)
        position = np.array([frame.translation for frame in frames]).reshape(-1, 3)
        return _Placed(rotation, position, six_rows(data.J).copy(), six_rows(data.dJ).copy())


def _supports(tree: Tree) -> Array:
    """Which velocities carry each body, of shape (B, n′)."""
    return np.array([tree.support(joint.number) for joint in tree.joints]).reshape(-1, tree.model.nv)


def _carried(placed: _Placed, jacobian: Array, masks: Array, along: Array) -> Array:
    """Twists of the bodies about their origins in their axes, along columns of q̇′: (n′, k) → (B, 6, k)."""
    world = (jacobian * masks[:, None]) @ along
    linear, angular = world[:, :3], world[:, 3:]
    linear = linear - skew(placed.position) @ angular
    turned = placed.rotation.swapaxes(-1, -2)
    return np.concatenate([turned @ linear, turned @ angular], axis=1)


def _momentum(V: Array) -> Array:
    """K(V) with M V = K(V) π_b, of shape (…, 6, 10): (linear, angular) of a body's ten numbers."""
    linear, angular = V[..., :3], V[..., 3:]
    K = np.zeros((*V.shape, BODY))
    K[..., :3, 0] = linear
    K[..., :3, 1:4], K[..., 3:, 1:4] = skew(angular), -skew(linear)
    K[..., 3:, 4:] = np.einsum("ikj,...j->...ik", _INERTIA, angular)
    return K


def _crossed(V: Array, W: Array) -> Array:
    """V × W of twists."""
    linear = cross(V[..., 3:], W[..., :3]) + cross(V[..., :3], W[..., 3:])
    return np.concatenate([linear, cross(V[..., 3:], W[..., 3:])], axis=-1)


def _force_crossed(V: Array, wrenches: Array) -> Array:
    """V ×* F of the columns of F, of shape (…, 6, k)."""
    turn = skew(V[..., 3:])
    linear, moment = wrenches[..., :3, :], wrenches[..., 3:, :]
    return np.concatenate([turn @ linear, turn @ moment + skew(V[..., :3]) @ linear], axis=-2)


def _joint_columns(joint: TreeJoint, rho: Array, q_free: Array, a: Array, v_r: Array, v: Array) -> Array:
    """Columns of a joint's own constants, of shape (n, kinds)."""
    own, kinds = joint.v, joint_kinds(joint)
    each = {"armature": a[own], "damping": v_r[own], "friction": np.sign(v[own]), "offset": -np.ones(1)}
    if "stiffness" in kinds:
        each["stiffness"] = _stretch(joint, q_free)
    if "stribeck" in kinds:
        each["stribeck"] = each["friction"] * np.exp(-((v[own] / joint.stated.stribeck_speed) ** 2))
    return np.asarray(rho[own].T @ np.stack([each[kind] for kind in kinds], axis=1))


def _joint_energy(joint: TreeJoint, q_free: Array, v_free: Array) -> Array:
    """Energy for a unit of a joint's own constants: dampers and friction hold none."""
    stretch = _stretch(joint, q_free) if joint.kind.springs else np.zeros(1)
    each = {"armature": 0.5 * v_free[joint.v] @ v_free[joint.v], "stiffness": 0.5 * stretch @ stretch}
    return np.array([each.get(kind, -stretch[0] if kind == "offset" else 0.0) for kind in joint_kinds(joint)])


def _stretch(joint: TreeJoint, q_free: Array) -> Array:
    """A spring's displacement from zero, of shape (nv,): log R of a ball."""
    if joint.kind.unit:
        return np.asarray(joint.kind.rotation_vector(q_free[joint.q])).ravel()
    return q_free[joint.q]
