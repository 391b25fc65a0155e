"""The directional derivative of a loop's acceleration φ̈ = φ_q′ q̈′ + φ̇_q′ q̇′, exact.

Every row of φ is linear in a point or a product of two vectors, so it suffices to carry the points and
directions of the two ends as jets: value, rate and second rate along a motion with q̇′ and q̈′, each with its derivative
in k given directions. All is measured from the loop's nearest common ancestor C, which is kept at rest. Vectors are in
the world's axes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.loops import Loop


class Directions(NamedTuple):
    """k directions of (q′, q̇′) in which to differentiate.

    Attributes:
        dq: Tangent steps of q′ (right increments, as `pin.integrate` takes them), of shape (n′, k).
        dv: Changes of the components of q̇′, of shape (n′, k).
    """

    dq: Array
    dv: Array


class _Jet(NamedTuple):
    """A vector x, its rate and second rate, each (3,), and their directional derivatives, each (3, k)."""

    x: Array
    x_1: Array
    x_2: Array
    dx: Array
    dx_1: Array
    dx_2: Array

    def minus(self, other: _Jet) -> _Jet:
        return _Jet(*(mine - its for mine, its in zip(self, other, strict=True)))


class _End:
    """One end of a loop: the spatial motion (linear at the world's origin, angular) of its frame.

    To be built right after `pin.computeForwardKinematicsDerivatives` with C at rest. Pinocchio's derivatives
    of the components in the body's frame are carried to the world, which adds δ × V for the body's own step δ. (Its
    derivatives in the world's axes are wrong for joints of several degrees of freedom beyond the first.)
    """

    def __init__(self, model: pin.Model, data: pin.Data, loop: Loop, side: str, directions: Directions) -> None:
        a = side == "a"
        joint, frame, path = (
            (loop.joint_a, loop.frame_a, loop.path_a) if a else (loop.joint_b, loop.frame_b, loop.path_b)
        )
        placement = data.oMi[joint]
        self.turn = placement.rotation @ frame[:3, :3]
        self.position = placement.rotation @ frame[:3, 3] + placement.translation
        self.velocity, self.acceleration = np.zeros(6), np.zeros(6)
        self.step = self.d_velocity = self.d_acceleration = np.zeros((6, directions.dq.shape[1]))
        if path.any():
            dq, dv, to_world = path[:, None] * directions.dq, path[:, None] * directions.dv, placement.action
            by_q, second_by_q, second_by_v, columns = pin.getJointAccelerationDerivatives(
                model, data, joint, pin.ReferenceFrame.LOCAL
            )
            velocity, acceleration = placement.act(data.v[joint]), placement.act(data.a[joint])
            self.velocity, self.acceleration = velocity.vector, acceleration.vector
            self.step = to_world @ (columns @ dq)
            self.d_velocity = to_world @ (by_q @ dq + columns @ dv) - velocity.action @ self.step
            self.d_acceleration = to_world @ (second_by_q @ dq + second_by_v @ dv) - acceleration.action @ self.step

    def point(self) -> _Jet:
        """The frame's origin."""
        return self._carried(self.position, 1.0)

    def direction(self, local: Array) -> _Jet:
        """A vector fixed in the frame."""
        return self._carried(self.turn @ local, 0.0)

    def _carried(self, x: Array, linear: float) -> _Jet:
        """ẋ = linear·v₀ + ω × x and what follows from it by differentiation."""
        omega, alpha = pin.skew(self.velocity[3:]), pin.skew(self.acceleration[3:])
        x_1 = linear * self.velocity[:3] + omega @ x
        x_2 = linear * self.acceleration[:3] + alpha @ x + omega @ x_1
        cross, cross_1 = pin.skew(x), pin.skew(x_1)
        dx = linear * self.step[:3] - cross @ self.step[3:]
        dx_1 = linear * self.d_velocity[:3] - cross @ self.d_velocity[3:] + omega @ dx
        dx_2 = linear * self.d_acceleration[:3] - cross @ self.d_acceleration[3:] + alpha @ dx
        return _Jet(x, x_1, x_2, dx, dx_1, dx_2 - cross_1 @ self.d_velocity[3:] + omega @ dx_1)


def loop_acceleration_derivative(
    model: pin.Model, data: pin.Data, loop: Loop, motion: tuple[Array, Array, Array], directions: Directions
) -> Array:
    """D(φ_q′ q̈′ + φ̇_q′ q̇′) of one loop's rows in each direction, of shape (rows, k).

    Args:
        model: The free system.
        data: Scratch memory.
        loop: The loop.
        motion: q′, q̇′ and q̈′; the components of q̈′ are held.
        directions: Where to.
    """
    q_free, v_free, a_free = motion
    own = loop.path_a + loop.path_b
    pin.computeForwardKinematicsDerivatives(model, data, q_free, own * v_free, own * a_free)
    end_a, end_b = _End(model, data, loop, "a", directions), _End(model, data, loop, "b", directions)
    rows, gap = loop.rows, end_b.point().minus(end_a.point())
    parts = [-loop.basis @ data.oMi[loop.ancestor].rotation.T @ gap.dx_2]
    for row in rows.directions:
        products = [weight * _product(end_a.direction(a), end_b.direction(b)) for weight, a, b in row.products]
        parts.append(np.sum(products, axis=0)[None])
    parts += [_product(end_a.direction(a), gap)[None] for a in rows.offsets]
    if rows.distance is not None:
        parts.append(_product(gap, gap)[None] / (2.0 * rows.distance))
    return np.concatenate(parts)


def _product(a: _Jet, b: _Jet) -> Array:
    """The derivatives of (a·b)¨ = ä·b + 2 ȧ·ḃ + a·b̈, of shape (k,)."""
    return np.asarray(
        a.x_2 @ b.dx + b.x_2 @ a.dx + 2.0 * (a.x_1 @ b.dx_1 + b.x_1 @ a.dx_1) + a.x @ b.dx_2 + b.x @ a.dx_2
    )
