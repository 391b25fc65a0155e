"""Residuals for closing loops from afar: positions alone, and rotations with a single zero.

The direction rows of φ vanish, and attract, where axes are turned end for end as well. Here each closure that asks
for directions to coincide has instead the rows θ n, where the smallest rotation that takes its directions on B to those
on A is by θ about the unit vector n. They vanish at θ = 0 only, and lead away from θ = π, where n is one of several.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ccpin.constraints import Constraints, ConstraintValue
from ccpin.loops import Loop

Array = NDArray[np.float64]
_NEARLY_PARALLEL = 1e-6


class PointConstraints:
    """The rows of φ without its direction rows: loops closed in position, whatever way their ends are turned.

    Holds scratch memory: one instance a thread.
    """

    def __init__(self, constraints: Constraints) -> None:
        self.model = constraints.model
        self._constraints = constraints
        keep = np.ones(constraints.size, dtype=bool)
        for loop, window in zip(constraints.loops, constraints.row_slices().values(), strict=False):
            first = window.start + len(loop.basis)
            keep[first : first + len(loop.rows.directions)] = False
        self._keep = keep

    def value(self, q_free: Array) -> ConstraintValue:
        """The rows and their Jacobian."""
        phi, jacobian = self._constraints.value(q_free)
        return ConstraintValue(phi[self._keep], jacobian[self._keep])


class AligningConstraints:
    """The rows of `PointConstraints` followed by three rows θ n of every closure that asks for directions to coincide.

    Holds scratch memory: one instance a thread.
    """

    def __init__(self, constraints: Constraints) -> None:
        self.model = constraints.model
        self._constraints = PointConstraints(constraints)
        self._loops = tuple(loop for loop in constraints.loops if loop.rows.alignment)
        self._data = constraints.model.createData()

    def value(self, q_free: Array) -> ConstraintValue:
        """The rows and their Jacobian; a single direction's rows are in axes that turn with the common ancestor."""
        phi, jacobian = self._constraints.value(q_free)
        pin.computeJointJacobians(self.model, self._data, q_free)
        rows, derivatives = [phi], [jacobian]
        for loop in self._loops:
            row, derivative = self._rotation(loop)
            rows.append(row)
            derivatives.append(derivative)
        return ConstraintValue(np.concatenate(rows), np.vstack(derivatives))

    def _rotation(self, loop: Loop) -> tuple[Array, Array]:
        """The rows θ n of one closure and their derivative."""
        turn_a = self._data.oMi[loop.joint_a].rotation @ loop.frame_a[:3, :3]
        turn_b = self._data.oMi[loop.joint_b].rotation @ loop.frame_b[:3, :3]
        turning_a, turning_b = self._data.J[3:] * loop.path_a, self._data.J[3:] * loop.path_b
        if len(loop.rows.alignment) == 3:
            rotation = turn_b.T @ turn_a
            body_rate = turn_a.T @ turning_a - rotation.T @ (turn_b.T @ turning_b)
            return np.array(pin.log3(rotation)), pin.Jlog3(rotation) @ body_rate
        (a_local, b_local) = loop.rows.alignment[0]
        return _between(turn_a @ a_local, turn_b @ b_local, turning_a, turning_b)


def _between(a: Array, b: Array, turning_a: Array, turning_b: Array) -> tuple[Array, Array]:
    """θ n from the unit vector b to a, and its derivative: θ n = f k with k = b × a = sin θ n, f = θ / sin θ."""
    k, c = np.cross(b, a), float(a @ b)
    s = float(np.linalg.norm(k))
    theta = float(np.arctan2(s, c))
    if s < _NEARLY_PARALLEL and c < 0:
        axis = np.cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        axis = axis / np.linalg.norm(axis)
        return theta * axis, np.outer(axis, axis) @ (turning_a - turning_b)
    da, db = -pin.skew(a) @ turning_a, -pin.skew(b) @ turning_b
    dk, dc = pin.skew(b) @ da - pin.skew(a) @ db, b @ da + a @ db
    if s < _NEARLY_PARALLEL:
        return k, dk
    return theta / s * k, theta / s * dk + np.outer(k, (theta * c - s) / s**3 * dc)
