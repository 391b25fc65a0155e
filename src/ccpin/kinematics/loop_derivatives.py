"""D_k (φ_q′ w_j): how a loop's Jacobian, applied to fixed velocity components w_j, changes along tangent steps of q′.

All pairs (j, k) at once, exact. The spatial Jacobian's columns turn with the bodies before them, D_k S_l = V_l × S_l
with V_l the velocity of column l's body under step k; points and directions of the two ends follow, and every row
of φ is linear in a point or a product of two vectors. The loop's nearest common ancestor C is at rest.
Arrays have the axes (vector, j, k).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.loops import Loop


class _Jet(NamedTuple):
    """A vector x (3, 1, 1), its rates under w_j (3, j, 1) and step k (3, 1, k), and the mixed one (3, j, k)."""

    x: Array
    by_w: Array
    by_step: Array
    mixed: Array

    def minus(self, other: _Jet) -> _Jet:
        return _Jet(*(mine - its for mine, its in zip(self, other, strict=True)))


class Brackets:
    """The rates of a model's spatial Jacobian columns along tangent steps of q′.

    Args:
        model: The free system.
    """

    def __init__(self, model: pin.Model) -> None:
        joint_of = np.repeat(np.arange(model.njoints), list(model.nvs))
        supports = np.zeros((model.njoints, model.njoints))
        for joint in range(1, model.njoints):
            supports[joint, list(model.supports[joint])] = 1.0
        self._before = supports[np.ix_(joint_of, joint_of)]
        self._moving = 1.0 - supports[:, joint_of]

    def rates(self, spatial: Array, steps: Array, ancestor: int) -> Array:
        """D_k S_l = V_l × S_l with one joint's body kept at rest, of shape (6, n′, k).

        Args:
            spatial: S, the spatial Jacobian at the world's origin, of shape (6, n′).
            steps: Tangent steps of q′, of shape (n′, k).
            ancestor: Index of the joint whose body is kept at rest (0: the world).
        """
        moved = self._moving[ancestor][:, None] * steps
        velocity = np.matmul(self._before, spatial[:, :, None] * moved)
        linear = _cross(velocity[3:], spatial[:3, :, None]) + _cross(velocity[:3], spatial[3:, :, None])
        return np.concatenate([linear, _cross(velocity[3:], spatial[3:, :, None])])


class _End:
    """One end of a loop: its frame, and its spatial velocities under w_j and step k with their mixed rate."""

    def __init__(
        self, data: pin.Data, joint: int, frame: Array, path: Array, rates: Array, w: Array, steps: Array
    ) -> None:
        placement, spatial = data.oMi[joint], data.J
        self.turn = placement.rotation @ frame[:3, :3]
        self.position = placement.rotation @ frame[:3, 3] + placement.translation
        self.by_w, self.by_step = (spatial @ (path * w))[:, :, None], (spatial @ (path * steps))[:, None, :]
        self.mixed = np.matmul((path * w).T, rates)

    def point(self) -> _Jet:
        """The frame's origin."""
        return self._carried(self.position, 1.0)

    def direction(self, local: Array) -> _Jet:
        """A vector fixed in the frame."""
        return self._carried(self.turn @ local, 0.0)

    def _carried(self, vector: Array, linear: float) -> _Jet:
        swap = -pin.skew(vector)  # ω × x = −x × ω
        by_w = linear * self.by_w[:3] + np.tensordot(swap, self.by_w[3:], 1)
        by_step = linear * self.by_step[:3] + np.tensordot(swap, self.by_step[3:], 1)
        mixed = linear * self.mixed[:3] + np.tensordot(swap, self.mixed[3:], 1) + _cross(self.by_w[3:], by_step)
        return _Jet(vector[:, None, None], by_w, by_step, mixed)


def loop_second_derivative(data: pin.Data, loop: Loop, rates: Array, w: Array, steps: Array) -> Array:
    """D_k (φ_q′ w_j) of one loop's rows, of shape (rows, j, k).

    Args:
        data: Where `pin.computeJointJacobians` was called.
        loop: The loop.
        rates: `Brackets.rates` with the loop's ancestor at rest.
        w: Velocity components, of shape (n′, j).
        steps: Tangent steps of q′, of shape (n′, k).
    """
    end_a = _End(data, loop.joint_a, loop.frame_a, loop.path_a[:, None], rates, w, steps)
    end_b = _End(data, loop.joint_b, loop.frame_b, loop.path_b[:, None], rates, w, steps)
    rows, gap = loop.rows, end_b.point().minus(end_a.point())
    parts = [-np.tensordot(loop.basis @ data.oMi[loop.ancestor].rotation.T, gap.mixed, 1)]
    for row in rows.directions:
        products = [weight * _product(end_a.direction(a), end_b.direction(b)) for weight, a, b in row.products]
        parts.append(np.sum(products, axis=0)[None])
    parts += [_product(end_a.direction(a), gap)[None] for a in rows.offsets]
    if rows.distance is not None:
        parts.append(_product(gap, gap)[None] / (2.0 * rows.distance))
    return np.concatenate(parts)


def _product(a: _Jet, b: _Jet) -> Array:
    """The mixed derivative of a·b, of shape (j, k)."""
    return np.asarray((a.mixed * b.x + a.by_w * b.by_step + a.by_step * b.by_w + a.x * b.mixed).sum(axis=0))


def _cross(a: Array, b: Array) -> Array:
    """a × b along the first axis, the others broadcast."""
    (ax, ay, az), (bx, by, bz) = a, b
    x = ay * bz - az * by
    product = np.empty((3, *x.shape))
    product[0], product[1], product[2] = x, az * bx - ax * bz, ax * by - ay * bx
    return product
