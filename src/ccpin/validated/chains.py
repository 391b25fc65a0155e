"""Kinematics of a tree of revolute and prismatic joints recorded on a tape, and with it φ(q′) of its closures.

The tree is that of `ccpin.kinematics.tree.Tree`: the doubles of its placements, inertias and rotor inertias are taken
as exact numbers, with two exceptions that make it a rigid-body system exactly. A rotation matrix stands for the exact
rotation of its quaternion (for the signed permutation within 1e-14 of it, where there is one); an axis for its exact
unit vector. Both differ from the doubles by rounding only.

Vectors and matrices of expressions are NumPy arrays of objects; a factor that is one expression stands on their right.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from operator import matmul
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.description.closure_kinds import Gap, Vector
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.tree import Tree
from ccpin.validated.balls import flint, rational
from ccpin.validated.tape import Expression, Node, Tape

Table = Any  # an array of expressions: mypy knows no arithmetic of arrays of objects
_SNAP = 1e-14


class ExactJoint(NamedTuple):
    """A joint with exact constants.

    Attributes:
        number: Its number in the model (the world is 0), and one more than its place in q′.
        parent: The parent joint's number.
        revolute: Whether it turns (else it slides).
        axis: Unit axis in its own frame, of shape (3,).
        placement: Its frame in the parent's, of shape (4, 4).
    """

    number: int
    parent: int
    revolute: bool
    axis: Table
    placement: Table


def exact_joints(tree: Tree) -> tuple[ExactJoint, ...]:
    """The joints of a tree, in order.

    Raises:
        UnsupportedMechanismError: A joint is neither revolute nor prismatic.
    """
    for joint in tree.joints:
        if joint.kind.nq != 1:
            raise UnsupportedMechanismError(
                f"validated integration covers revolute and prismatic joints; joint '{joint.name}' is {joint.kind.name}"
            )
    return tuple(
        ExactJoint(j.number, j.parent, j.kind.angle, _unit_vector(j.axis), exact_placement(j.placement))
        for j in tree.joints
    )


def exact(values: ArrayLike) -> Table:
    """Doubles as exact rationals, in an array of the same shape."""
    return np.vectorize(rational, otypes=[object])(values)


def exact_placement(placement: Array) -> Table:
    """The exact frame that a 4×4 matrix of doubles stands for, in rationals."""
    frame = exact(placement)
    frame[:3, :3] = _exact_rotation(placement[:3, :3])
    return frame


def _unit_vector(values: Array) -> Table:
    """v/|v|: exact where |v| = 1 exactly, else in balls."""
    vector = exact(values)
    square = vector @ vector
    if square == 1:
        return vector
    length = flint().arb(square).sqrt()
    return np.array([flint().arb(entry) / length if entry else entry for entry in vector], dtype=object)


def _exact_rotation(matrix: Array) -> Table:
    """The exact rotation a double matrix stands for, in rationals."""
    near = np.round(matrix)
    if np.abs(matrix - near).max() <= _SNAP:
        return exact(near)
    x, y, z, w = exact(Rotation.from_matrix(matrix).as_quat())
    two = 2 / (x * x + y * y + z * z + w * w)
    return [
        [1 - two * (y * y + z * z), two * (x * y - z * w), two * (x * z + y * w)],
        [two * (x * y + z * w), 1 - two * (x * x + z * z), two * (y * z - x * w)],
        [two * (x * z - y * w), two * (y * z + x * w), 1 - two * (x * x + y * y)],
    ]


def poses(tape: Tape, joints: Sequence[ExactJoint], q_free: Table, root: int = 0) -> dict[int, Table]:
    """The frame of every joint's body beyond `root`, of shape (4, 4), in the root's frame (0: the world's)."""
    found = {root: np.eye(4, dtype=object)}
    for joint in joints:
        if joint.parent in found and joint.number != root:
            motion = _motion(tape, joint, q_free[joint.number - 1])
            found[joint.number] = found[joint.parent] @ joint.placement @ motion
    return found


def _motion(tape: Tape, joint: ExactJoint, q: Node) -> Table:
    """A slide along the axis, or the turn about it: c I + s [a]× + (1 − c) a aᵀ; of shape (4, 4)."""
    motion, axis = np.eye(4, dtype=object), joint.axis
    if not joint.revolute:
        motion[:3, 3] = axis * q
        return motion
    sine, cosine = tape.sincos(q)
    outer = np.outer(axis, axis)
    turned = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]], dtype=object)
    motion[:3, :3] = (np.eye(3, dtype=object) - outer) * cosine + turned * sine + outer
    return motion


def closure_rows(tape: Tape, constraints: Constraints, joints: Sequence[ExactJoint], q_free: Table) -> list[Expression]:
    """φ, row by row in the order of `Constraints`; directions and lengths are the exact doubles of its rows.

    Raises:
        UnsupportedMechanismError: A coupling holds a continuous joint.
    """
    rows: list[Expression] = []
    frames = {root: poses(tape, joints, q_free, root) for root in {loop.ancestor: None for loop in constraints.loops}}
    for loop in constraints.loops:
        rows += _loop_rows(loop, frames[loop.ancestor])
    for coupling in constraints.couplings:
        total: Any = 0
        for term in coupling.terms:
            if term.wrapped:
                raise UnsupportedMechanismError(
                    f"validated integration does not cover coupling '{coupling.coupling.name}' of a continuous joint"
                )
            displacement, power = q_free[term.idx_q] - rational(term.reference), rational(1.0)
            for coefficient in term.coefficients:
                total = total + power * rational(coefficient)
                power = power * displacement
        rows.append(total)
    return rows


def _loop_rows(loop: ResolvedClosure, frames: dict[int, Table]) -> list[Expression]:
    """The rows of one loop."""
    ends = {
        "A": frames[loop.joint_a] @ exact_placement(loop.frame_a),
        "B": frames[loop.joint_b] @ exact_placement(loop.frame_b),
    }

    def value(vector: Vector) -> Table:
        if isinstance(vector, Gap):
            return ends["B"][:3, 3] - ends["A"][:3, 3]
        local = exact(vector.local)
        return local if vector.frame == "C" else ends[vector.frame][:3, :3] @ local

    def combine(parts: Iterable[tuple[float, Expression]]) -> Expression:
        total: Any = 0
        for weight, product in parts:
            total = total + rational(weight) * product
        return total

    return loop.rows.evaluate(value, matmul, combine)
