"""Second and third derivatives of φ, exact: of φ_q′ w along steps of q′, and of φ̈ along changes of (q′, q̇′).

Rows are sums of scalar products (`ccpin.kinematics.rows`), so it suffices to differentiate vectors. A vector fixed in a
body with spatial velocity V, acceleration A obeys ẋ = ω × x, ẍ = α × x + ω × ẋ, an end's point alike with the linear
parts added, and these relations are differentiated once more. Arrays have the vector axis last.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, cross
from ccpin.kinematics.rows import Placed, RowStack


class Directions(NamedTuple):
    """k directions of (q′, q̇′) in which to differentiate.

    Attributes:
        dq: Tangent steps of q′ (right increments, as `pin.integrate` takes them), of shape (n′, k).
        dv: Changes of the components of q̇′, of shape (n′, k).
    """

    dq: Array
    dv: Array


def column_rates(before: Array, spatial: Array, steps: Array) -> Array:
    """D_k S_l = V_l × S_l, V_l the velocity of column l's body under step k, of shape (6, n′, k).

    Args:
        before: 1.0 where a velocity component moves the body of another, of shape (n′, n′).
        spatial: S, of shape (6, n′).
        steps: Tangent steps of q′, of shape (n′, k).
    """
    columns = spatial.T[:, None]
    velocity = np.einsum("lm,cm,mk->lkc", before, spatial, steps, optimize=True)
    linear = cross(velocity[..., 3:], columns[..., :3]) + cross(velocity[..., :3], columns[..., 3:])
    return np.moveaxis(np.concatenate([linear, cross(velocity[..., 3:], columns[..., 3:])], axis=-1), 2, 0)


def second_derivative(stack: RowStack, placed: Placed, rates: Array, w: Array, steps: Array) -> Array:
    """D_k (φ_q′ w_j) for velocity components w (n′, j) held and tangent steps (n′, k), of shape (R, j, k).

    Args:
        stack: The rows.
        placed: The configuration.
        rates: `column_rates` along the steps.
        w: Velocity components.
        steps: Tangent steps of q′.
    """
    by_w, by_step = (np.moveaxis((stack.supports[:, None] * placed.spatial) @ each, 2, 1) for each in (w, steps))
    mixed = np.einsum("nl,lj,clk->njkc", stack.supports, w, rates, optimize=True)
    x = placed.vectors[:, None]
    x_w, x_s = stack.moved(x, by_w)[:, :, None], stack.moved(x, by_step)[:, None]
    x_ws = stack.moved(x[:, None], mixed) + stack.turned(x_s, by_w[:, :, None])
    (a, b), (a_w, b_w), (a_s, b_s), (a_ws, b_ws) = (stack.sides(each) for each in (x[:, None], x_w, x_s, x_ws))
    return stack.weighted((a_ws * b + a_w * b_s + a_s * b_w + a * b_ws).sum(axis=-1))


def acceleration_derivative(
    stack: RowStack, placed: Placed, data: pin.Data, model: pin.Model, directions: Directions
) -> Array:
    """D(φ_q′ q̈′ + φ̇_q′ q̇′) in each direction, the components of q̈′ held, of shape (R, k).

    Args:
        stack: The rows.
        placed: The configuration.
        data: After `pin.computeForwardKinematicsDerivatives` at (q′, q̇′, q̈′).
        model: The free system.
        directions: Where to.
    """
    jets = [_jet(model, data, joint, directions) for joint in stack.joints]
    twist, second, step, d_twist, d_second = (np.array(each) for each in zip(*jets, strict=True))
    twist, second, x = twist[:, None], second[:, None], placed.vectors[:, None]
    x_1 = stack.moved(x, twist)
    x_2 = stack.moved(x, second) + stack.turned(x_1, twist)
    dx = stack.moved(x, step)
    dx_1 = stack.moved(x, d_twist) + stack.turned(dx, twist)
    dx_2 = stack.moved(x, d_second) + stack.turned(dx, second) + stack.turned(x_1, d_twist) + stack.turned(dx_1, twist)
    (a, b), (a_1, b_1), (a_2, b_2), (da, db), (da_1, db_1), (da_2, db_2) = (
        stack.sides(each) for each in (x, x_1, x_2, dx, dx_1, dx_2)
    )
    change = a_2 * db + b_2 * da + 2.0 * (a_1 * db_1 + b_1 * da_1) + a * db_2 + b * da_2
    return stack.weighted(change.sum(axis=-1))


class _Jet(NamedTuple):
    """A body's spatial velocity and acceleration (6,), and in each direction its step and their changes, (k, 6)."""

    velocity: Array
    acceleration: Array
    step: Array
    d_velocity: Array
    d_acceleration: Array


def _jet(model: pin.Model, data: pin.Data, joint: int, directions: Directions) -> _Jet:
    """Pinocchio's derivatives of the components in the body's frame, carried to the world (linear at its origin).

    That adds δ × V for the body's own step δ. Its derivatives in the world's axes are wrong for joints of several
    degrees of freedom beyond the first.
    """
    if joint == 0:
        return _Jet(np.zeros(6), np.zeros(6), *(np.zeros((directions.dq.shape[1], 6)) for _ in range(3)))
    dq, dv, placement = directions.dq, directions.dv, data.oMi[joint]
    by_q, second_by_q, second_by_v, columns = pin.getJointAccelerationDerivatives(
        model, data, joint, pin.ReferenceFrame.LOCAL
    )
    velocity, acceleration, to_world = placement.act(data.v[joint]), placement.act(data.a[joint]), placement.action
    step = to_world @ (columns @ dq)
    d_velocity = to_world @ (by_q @ dq + columns @ dv) - velocity.action @ step
    d_acceleration = to_world @ (second_by_q @ dq + second_by_v @ dv) - acceleration.action @ step
    return _Jet(velocity.vector, acceleration.vector, step.T, d_velocity.T, d_acceleration.T)
