"""Wrenches that act on links from outside, w in D′q̈′ + C′q̇′ + B′q̇′ + g′ = Sᵀu + Jᵀw + φ_q′ᵀλ.

A force and a moment are given in world axes, the force at a point fixed to the link; they keep their components in the
world while the link moves. With R the rotation of the joint that carries the link and p the point in that joint's axes,
f = RᵀF and m = RᵀM + p × f are the wrench in these axes; a turn δ changes them by f × δ and RᵀM × δ + p × (f × δ).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, skew, vector
from ccpin.description.names import choices
from ccpin.errors import InvalidInputError
from ccpin.kinematics.scratch import Scratch
from ccpin.kinematics.tree import Tree


class Wrench(NamedTuple):
    """A force at a point of a link, and a moment.

    Attributes:
        force: In world axes, N, of shape (3,).
        moment: In world axes, N m, of shape (3,).
        point: Where the force acts, in the link's own axes, m, of shape (3,).
    """

    force: ArrayLike
    moment: ArrayLike = (0.0, 0.0, 0.0)
    point: ArrayLike = (0.0, 0.0, 0.0)


Wrenches = Mapping[str, Wrench | ArrayLike]
"""By link name: a `Wrench`, or (force, moment) in world axes at the link's origin, six numbers."""


Pushes = Callable[[float, Any, Array], "Wrenches | None"]
"""Wrenches as a function of time, State and velocity."""


class Applied(NamedTuple):
    """A wrench on the body of a joint: force and moment (3,) in world axes, the point (3,) in the joint's own."""

    joint: int
    force: Array
    moment: Array
    point: Array


def applied_wrenches(tree: Tree, wrenches: Wrenches | None) -> tuple[Applied, ...]:
    """Check wrenches against a tree; those on links that the world carries move nothing and are left out.

    Raises:
        InvalidInputError: An unknown link, or a wrench of the wrong shape or not finite.
    """
    if wrenches is None:
        return ()
    if not isinstance(wrenches, Mapping):
        raise InvalidInputError('wrenches must be a mapping of link names, like {"hand": [fx, fy, fz, mx, my, mz]}')
    found = []
    for name, value in wrenches.items():
        if name not in tree.attachments:
            raise InvalidInputError(f"wrenches: '{name}' is no link; {choices(str(name), tree.attachments)}")
        carrier = tree.attachments[name]
        if not isinstance(value, Wrench):
            both = vector(value, f"the wrench on '{name}'", 6)
            value = Wrench(both[:3], both[3:])
        parts = zip(value, Wrench._fields, strict=True)
        force, moment, point = (vector(part, f"{word} of the wrench on '{name}'", 3) for part, word in parts)
        if carrier.joint:
            at = carrier.placement[:3, :3] @ point + carrier.placement[:3, 3]
            found.append(Applied(carrier.joint, force, moment, at))
    return tuple(found)


def wrench_rows(tree: Tree, wrenches: Wrenches | None) -> Array | None:
    """The same for the compiled core: rows of joint, force, moment and point, of shape (N, 10); ``None`` for none.

    Raises:
        InvalidInputError: As for `applied_wrenches`.
    """
    applied = applied_wrenches(tree, wrenches)
    return np.array([np.hstack(one) for one in applied]) if applied else None


def pushes_of(tree: Tree, wrenches: Wrenches | Pushes | None) -> Pushes:
    """Wrenches as a function (t, state, v): themselves, or constant ones, checked.

    Raises:
        InvalidInputError: As for `applied_wrenches`.
    """
    if callable(wrenches):
        return wrenches
    applied_wrenches(tree, wrenches)
    return lambda t, state, v: wrenches


def joint_loads(scratch: Scratch, q_free: Array, applied: Sequence[Applied]) -> Array:
    """Σ Jᵀw, of shape (n′,)."""
    model = scratch.model
    with scratch.lent() as data:
        pin.computeJointJacobians(model, data, q_free)
        loads = np.zeros(model.nv)
        for one in applied:
            jacobian = pin.getJointJacobian(model, data, one.joint, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            arm = data.oMi[one.joint].rotation @ one.point
            loads += jacobian[:3].T @ one.force + jacobian[3:].T @ (one.moment + np.cross(arm, one.force))
        return loads


def joint_loads_derivative(scratch: Scratch, q_free: Array, applied: Sequence[Applied]) -> Array:
    """∂(Σ Jᵀw)/∂q′ along tangent steps of q′, of shape (n′, n′): by Pinocchio for w fixed to its body, and its turn."""
    model = scratch.model
    with scratch.lent() as data:
        carried = pin.StdVec_Force([pin.Force.Zero() for _ in range(model.njoints)])
        weight = np.array(pin.computeGeneralizedGravityDerivatives(model, data, q_free))
        pin.computeJointJacobians(model, data, q_free)
        turning = np.zeros((model.nv, model.nv))
        for one in applied:
            rotation = data.oMi[one.joint].rotation
            force, moment = rotation.T @ one.force, rotation.T @ one.moment
            carried[one.joint] += pin.Force(force, moment + np.cross(one.point, force))
            jacobian = pin.getJointJacobian(model, data, one.joint, pin.ReferenceFrame.LOCAL)
            change = np.vstack([skew(force), skew(moment) + skew(one.point) @ skew(force)])
            turning += jacobian.T @ change @ jacobian[3:]
        statics = np.array(pin.computeStaticTorqueDerivatives(model, data, q_free, carried))
        return np.asarray(weight - statics + turning)
