"""The joints' springs: V_s = Σ ½ k (θ − θ₀)², and ½ k |log R|² of ball joints; forces, energy and stiffness.

With r = log R the rotation vector and ω the body's angular velocity in its own axes, ṙ = J(r) ω and J(r)ᵀ r = r: the
moment of a ball joint's spring is its gradient k r, and that one's derivative along right increments k J(r)
(`ccpin.description.rotations`); smooth but for half a turn.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.description.rotations import log_jacobian
from ccpin.kinematics.tree import Tree


class Springs:
    """The springs of a tree's joints.

    Args:
        tree: The free system.
    """

    def __init__(self, tree: Tree) -> None:
        self._size = int(tree.model.nv)
        sprung = [joint for joint in tree.joints if joint.stated.stiffness]
        plain = [joint for joint in sprung if not joint.kind.unit]
        self._q = np.array([joint.q.start for joint in plain], dtype=np.intp)
        self._v = np.array([joint.v.start for joint in plain], dtype=np.intp)
        self._stiffness = np.array([joint.stated.stiffness for joint in plain])
        self._reference = np.array([joint.stated.spring_reference for joint in plain])
        self._balls = [joint for joint in sprung if joint.kind.unit]

    def __bool__(self) -> bool:
        """Whether there is any."""
        return bool(len(self._v) or self._balls)

    def force(self, q_free: Array) -> Array:
        """∂V_s/∂q′, of shape (n′,): what holds the springs as they are."""
        force = np.zeros(self._size)
        force[self._v] = self._stiffness * (q_free[self._q] - self._reference)
        for ball in self._balls:
            force[ball.v] = ball.stated.stiffness * ball.kind.rotation_vector(q_free[ball.q])
        return force

    def energy(self, q_free: Array) -> float:
        """V_s ≥ 0, in joules."""
        energy = 0.5 * float(self._stiffness @ (q_free[self._q] - self._reference) ** 2)
        for ball in self._balls:
            r = ball.kind.rotation_vector(q_free[ball.q])
            energy += 0.5 * ball.stated.stiffness * float(r @ r)
        return energy

    def derivative(self, q_free: Array) -> Array:
        """∂²V_s/∂q′² along tangent steps of q′, of shape (n′, n′)."""
        derivative = np.zeros((self._size, self._size))
        derivative[self._v, self._v] = self._stiffness
        for ball in self._balls:
            r = ball.kind.rotation_vector(q_free[ball.q])
            derivative[ball.v, ball.v] = ball.stated.stiffness * log_jacobian(r)
        return derivative
