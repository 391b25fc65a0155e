"""Kinematics of a tree recorded on a tape, and with it φ(q′) of its closures.

The tree is that of `ccpin.kinematics.tree.Tree`: the doubles of its placements, inertias and rotor inertias are taken
as exact numbers, with two exceptions that make it a rigid-body system exactly. A rotation matrix stands for the exact
rotation of its quaternion (for the signed permutation within 1e-14 of it, where there is one); an axis for its exact
unit vector. Both differ from the doubles by rounding only.

A configuration is held by numbers x, joint by joint (`recorded_coordinates`): those of q′, but of
a circle the angle alone. A quaternion p stays four numbers, of which R(p) is a polynomial. With ω the turn's velocity
in its own axes ṗ = ½ p ⊗ ω, so that |p|² stays 1; ẋ = Γ(x) q̇′, Γ the identity but for turns about several axes and for
slides ahead of a turn, whose velocities are counted in the turned axes.

Vectors and matrices of expressions are NumPy arrays of objects; a factor that is one expression stands on their right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from operator import matmul, sub
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.description.closure_kinds import Gap, Vector
from ccpin.description.joint_kinds import JointKind
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure, ResolvedCoupling
from ccpin.kinematics.tree import Tree
from ccpin.programs.tape import Expression, Tape

Table = Any  # an array of expressions: mypy knows no arithmetic of arrays of objects
_SNAP = 1e-14  # of an entry: this near to −1, 0 and 1 a rotation is by quarter turns


class ExactJoint(NamedTuple):
    """A joint with exact constants.

    Attributes:
        number: Its number in the model (the world is 0).
        parent: The parent joint's number.
        kind: What it moves.
        axes: The directions of its steps' axes in its own frame, of shape (nv, 3); of about unit length.
        placement: Its frame in the parent's, of shape (4, 4).
        q, v, x: Where it stands in q′, q̇′ and x.
    """

    number: int
    parent: int
    kind: JointKind
    axes: Table
    placement: Table
    q: slice
    v: slice
    x: slice

    @property
    def turning_axes(self) -> bool:
        """Whether its velocities are counted in axes that turn with it, and so are not the rates of x."""
        return self.kind.unit == 4 or (self.kind.unit == 2 and self.kind.nv > 1)


def exact_joints(tree: Tree) -> tuple[ExactJoint, ...]:
    """The joints of a tree, in order."""
    found, first = list[ExactJoint](), 0
    for j in tree.joints:
        last = first + j.kind.nq - (j.kind.unit == 2)
        axes = exact(j.kind.directions(j.axis))
        place = slice(first, last)
        found.append(ExactJoint(j.number, j.parent, j.kind, axes, exact_placement(j.placement), j.q, j.v, place))
        first = last
    return tuple(found)


def rational(value: float) -> Fraction:
    """The exact value of a finite double."""
    return Fraction(float(value))


def exact(values: ArrayLike) -> Table:
    """Doubles as exact rationals, in an array of the same shape."""
    return np.vectorize(rational, otypes=[object])(values)


def exact_placement(placement: Array) -> Table:
    """The exact frame that a 4×4 matrix of doubles stands for, in rationals."""
    frame = exact(placement)
    frame[:3, :3] = _exact_rotation(placement[:3, :3])
    return frame


def unit_axes(tape: Tape, joint: ExactJoint) -> Table:
    """v/|v| of its axes v, of shape (nv, 3): rational where |v| is."""
    return np.array([axis * tape.reciprocal(tape.root(axis @ axis)) for axis in joint.axes], dtype=object)


def _exact_rotation(matrix: Array) -> Table:
    """The exact rotation a double matrix stands for, in rationals."""
    near = np.round(matrix)
    if np.abs(matrix - near).max() <= _SNAP:
        return exact(near)
    quaternion = exact(Rotation.from_matrix(matrix).as_quat())
    return _rotation(quaternion, 2 / (quaternion @ quaternion))


def _rotation(quaternion: Table, two: Expression) -> Table:
    """The rotation of a quaternion p (x, y, z, w), of shape (3, 3); `two` is 2/|p|²."""
    x, y, z, w = quaternion
    return np.array(
        [
            [1 - (y * y + z * z) * two, (x * y - z * w) * two, (x * z + y * w) * two],
            [(x * y + z * w) * two, 1 - (x * x + z * z) * two, (y * z - x * w) * two],
            [(x * z - y * w) * two, (y * z + x * w) * two, 1 - (x * x + y * y) * two],
        ],
        dtype=object,
    )


def poses(tape: Tape, joints: Sequence[ExactJoint], x: Table) -> dict[int, Table]:
    """The frame of every joint's body in the world (0), of shape (4, 4)."""
    found = {0: np.eye(4, dtype=object)}
    for joint in joints:
        found[joint.number] = found[joint.parent] @ joint.placement @ relative_motion(tape, joint, x[joint.x])
    return found


def relative_motion(tape: Tape, joint: ExactJoint, x: Table) -> Table:
    """The frame after a joint's own motion in that before it, of shape (4, 4): slides, then turns."""
    motion = np.eye(4, dtype=object)
    plain = len(x) - (4 if joint.kind.unit == 4 else 0)
    for axis, slides, value in zip(unit_axes(tape, joint)[:plain], joint.kind.slides, x, strict=False):
        if slides:
            motion[:3, 3] = motion[:3, 3] + axis * value
        else:
            motion[:3, :3] = motion[:3, :3] @ turn_about(tape, axis, value)
    if joint.kind.unit == 4:
        motion[:3, :3] = _rotation(x[plain:], 2)
    return motion


def turn_about(tape: Tape, axis: Table, angle: Expression) -> Table:
    """The rotation about a unit vector: c I + s [a]× + (1 − c) a aᵀ, of shape (3, 3)."""
    sine, cosine = tape.sincos(angle)
    outer = np.outer(axis, axis)
    across = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]], dtype=object)
    return (np.eye(3, dtype=object) - outer) * cosine + across * sine + outer


def rates(tape: Tape, joints: Sequence[ExactJoint], x: Table) -> Table:
    """Γ with ẋ = Γ q̇′, of shape (x, n′)."""
    table = np.zeros((joints[-1].x.stop, joints[-1].v.stop) if joints else (0, 0), dtype=object)
    half = rational(0.5)
    for joint in joints:
        kind, block = joint.kind, table[joint.x, joint.v]
        if not joint.turning_axes:
            block[...] = np.eye(kind.nv, dtype=object)
            continue
        count = kind.nq - kind.unit
        turned, slid = relative_motion(tape, joint, x[joint.x])[:3, :3], kind.entries[:count]
        block[:count, :count] = turned[np.ix_(slid, slid)]
        if kind.unit == 2:
            block[count:, count:] = 1
        else:
            a, b, c, w = x[joint.x][count:] * half
            block[count:, count:] = [[w, -c, b], [c, w, -a], [-b, a, w], [-a, -b, -c]]
    return table


def closure_rows(
    tape: Tape,
    constraints: Constraints,
    joints: Sequence[ExactJoint],
    x: Table,
    near: Array | None = None,
    ends: Callable[[ResolvedClosure], tuple[Table, Table]] | None = None,
) -> list[Expression]:
    """φ, row by row in the order of `Constraints`; directions and lengths are the exact doubles of its rows.

    Couplings of continuous joints hold modulo an angle: their rows are less the multiple of it that is nearest at the
    numbers `near` (default none). `ends` are a closure's frames on its bodies, default its own.
    """
    rows: list[Expression] = []
    for loop in constraints.loops:
        rows += _loop_rows(tape, loop, joints, x, (ends or own_ends)(loop))
    places = {joint.q.start: joint.x.start for joint in joints}
    rows += [_coupling_row(coupling, x, places, near) for coupling in constraints.couplings]
    return rows


def _coupling_row(coupling: ResolvedCoupling, x: Table, places: dict[int, int], near: Array | None) -> Expression:
    """Σ c (θ − θ_ref)ᵏ, less the whole turns there are."""
    total: Any = 0
    about = 0.0
    for term in coupling.terms:
        place = places[term.idx_q]
        displacement, power = x[place] - rational(term.reference), rational(1.0)
        for coefficient in term.coefficients:
            total = total + power * rational(coefficient)
            power = power * displacement
        if near is not None:
            about += float(np.polynomial.polynomial.polyval(near[place] - term.reference, term.coefficients))
    turns = round(about / coupling.modulus) if coupling.modulus else 0
    return total - turns * rational(coupling.modulus)


def own_ends(loop: ResolvedClosure) -> tuple[Table, Table]:
    """A closure's frames on its bodies, of shape (4, 4) each."""
    return exact_placement(loop.frame_a), exact_placement(loop.frame_b)


def chain_of(joints: Sequence[ExactJoint], tip: int, root: int) -> list[ExactJoint]:
    """The joints from a body to one that carries it, the tip's first."""
    found = list[ExactJoint]()
    while tip != root:
        found.append(joints[tip - 1])
        tip = found[-1].parent
    return found


def evaluated_rows(
    loop: ResolvedClosure,
    held: tuple[Table, Table],
    carried: Callable[[int, Table, bool], Any],
    less: Callable[[Any, Any], Any],
    fixed: Callable[[Table], Any],
    dot: Callable[[Any, Any], Any],
) -> list[Any]:
    """The rows of one loop over what `carried` makes of points (true) and directions of its joints' bodies."""
    ends = {"A": (loop.joint_a, held[0]), "B": (loop.joint_b, held[1])}

    def value(vector: Vector) -> Any:
        if isinstance(vector, Gap):
            return less(*(carried(joint, frame[:3, 3], True) for joint, frame in (ends["B"], ends["A"])))
        local = exact(vector.local)
        if vector.frame == "C":
            return fixed(local)
        joint, frame = ends[vector.frame]
        return carried(joint, frame[:3, :3] @ local, False)

    def combine(parts: Iterable[tuple[float, Any]]) -> Any:
        total: Any = 0
        for weight, product in parts:
            total = total + product * rational(weight)
        return total

    return loop.rows.evaluate(value, dot, combine)


def _loop_rows(
    tape: Tape, loop: ResolvedClosure, joints: Sequence[ExactJoint], x: Table, held: tuple[Table, Table]
) -> list[Expression]:
    """The rows of one loop: in a plane over whole frames, whose angles add up; else each vector down its own chain."""

    def carried(tip: int, vector: Table, is_point: bool) -> Table:
        chain = chain_of(joints, tip, loop.ancestor)
        if loop.normal is not None:
            whole = np.eye(4, dtype=object)
            for joint in reversed(chain):
                whole = whole @ joint.placement @ relative_motion(tape, joint, x[joint.x])
            return whole[:3, :3] @ vector + (whole[:3, 3] if is_point else 0)
        for joint in chain:
            moved, placed = relative_motion(tape, joint, x[joint.x]), joint.placement
            vector = moved[:3, :3] @ vector + (moved[:3, 3] if is_point else 0)
            vector = placed[:3, :3] @ vector + (placed[:3, 3] if is_point else 0)
        return vector

    return evaluated_rows(loop, held, carried, sub, lambda local: local, matmul)
