"""Kinematics of a tree of revolute and prismatic joints, recorded on a tape.

The tree is that of `ccpin.kinematics.tree.Tree`: the doubles of its placements, inertias and rotor inertias are taken
as exact numbers, with two exceptions that make it a rigid-body system exactly. A rotation matrix stands for the exact
rotation of its quaternion (for the signed permutation within 1e-14 of it, where there is one); an axis for its exact
unit vector. Both differ from the doubles by rounding only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.tree import Tree
from ccpin.validated.balls import flint, rational
from ccpin.validated.tape import Expression, Node, Tape

Vector = list[Expression]  # three entries
Matrix = list[Vector]  # three rows
_SNAP = 1e-14


class ExactJoint(NamedTuple):
    """A joint with exact constants.

    Attributes:
        number: Its number in the model (the world is 0), and one more than its place in q′.
        parent: The parent joint's number.
        revolute: Whether it turns (else it slides).
        axis: Unit axis in its own frame.
        rotation, position: Its placement in the parent's frame.
    """

    number: int
    parent: int
    revolute: bool
    axis: Vector
    rotation: Matrix
    position: Vector


class Pose(NamedTuple):
    """Where a body is: its axes as columns, and its origin."""

    rotation: Matrix
    position: Vector


def exact_joints(tree: Tree) -> tuple[ExactJoint, ...]:
    """The joints of a tree, in order.

    Raises:
        UnsupportedMechanismError: A joint is neither revolute nor prismatic.
    """
    joints = []
    for joint in tree.joints:
        if joint.kind.nq != 1:
            raise UnsupportedMechanismError(
                f"validated integration covers revolute and prismatic joints; joint '{joint.name}' is {joint.kind.name}"
            )
        joints.append(
            ExactJoint(
                joint.number,
                joint.parent,
                joint.kind.angle,
                unit_vector(joint.axis),
                exact_rotation(joint.placement[:3, :3]),
                exact_vector(joint.placement[:3, 3]),
            )
        )
    return tuple(joints)


def exact_vector(values: Array) -> Vector:
    """Three doubles as exact rationals."""
    return [rational(value) for value in values]


def unit_vector(values: Array) -> Vector:
    """v/|v|: exact where |v| = 1 exactly, else in balls."""
    vector = exact_vector(values)
    square = dot(vector, vector)
    if square == 1:
        return vector
    length = flint().arb(square).sqrt()
    return [flint().arb(entry) / length if entry else entry for entry in vector]


def exact_rotation(matrix: Array) -> Matrix:
    """The exact rotation a double matrix stands for, in rationals."""
    near = np.round(matrix)
    if np.abs(matrix - near).max() <= _SNAP:
        return [[rational(entry) for entry in row] for row in near]
    x, y, z, w = (rational(entry) for entry in Rotation.from_matrix(matrix).as_quat())
    two = 2 / (x * x + y * y + z * z + w * w)
    return [
        [1 - two * (y * y + z * z), two * (x * y - z * w), two * (x * z + y * w)],
        [two * (x * y + z * w), 1 - two * (x * x + z * z), two * (y * z - x * w)],
        [two * (x * z - y * w), two * (y * z + x * w), 1 - two * (x * x + y * y)],
    ]


def identity() -> Pose:
    """The frame everything is measured in."""
    return Pose([[int(i == j) for j in range(3)] for i in range(3)], [0, 0, 0])


def poses(tape: Tape, joints: Sequence[ExactJoint], q_free: Sequence[Node], root: int = 0) -> dict[int, Pose]:
    """The pose of every joint's body beyond `root`, in the root's frame (0: the world's)."""
    found = {root: identity()}
    for joint in joints:
        if joint.parent not in found or joint.number == root:
            continue
        parent = found[joint.parent]
        rotation = multiply(parent.rotation, joint.rotation)
        position = add(parent.position, apply(parent.rotation, joint.position))
        angle = q_free[joint.number - 1]
        if joint.revolute:
            rotation = multiply(rotation, _turn(tape, joint.axis, angle))
        else:
            position = add(position, scale(angle, apply(rotation, joint.axis)))
        found[joint.number] = Pose(rotation, position)
    return found


def _turn(tape: Tape, axis: Vector, angle: Node) -> Matrix:
    """The rotation by an angle about a unit axis: c I + s [a]× + (1 − c) a aᵀ."""
    sine, cosine = tape.sincos(angle)
    cross_matrix = [[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]]
    turn = []
    for i in range(3):
        row: Vector = []
        for j in range(3):
            outer = axis[i] * axis[j]
            row.append((int(i == j) - outer) * cosine + cross_matrix[i][j] * sine + outer)
        turn.append(row)
    return turn


def add(a: Vector, b: Vector) -> Vector:
    """The sum a + b."""
    return [x + y for x, y in zip(a, b, strict=True)]


def subtract(a: Vector, b: Vector) -> Vector:
    """The difference a − b."""
    return [x - y for x, y in zip(a, b, strict=True)]


def scale(factor: Expression, a: Vector) -> Vector:
    """The product factor · a."""
    return [factor * x for x in a]


def dot(a: Vector, b: Vector) -> Expression:
    """The inner product a·b."""
    total: Any = 0
    for x, y in zip(a, b, strict=True):
        total = total + x * y
    return total


def cross(a: Vector, b: Vector) -> Vector:
    """The vector product a × b."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def apply(matrix: Matrix, vector: Vector) -> Vector:
    """The product matrix · vector."""
    return [dot(row, vector) for row in matrix]


def transposed(matrix: Matrix) -> Matrix:
    """The transpose."""
    return [list(column) for column in zip(*matrix, strict=True)]


def multiply(a: Matrix, b: Matrix) -> Matrix:
    """Matrix product."""
    columns = transposed(b)
    return [[dot(row, column) for column in columns] for row in a]
