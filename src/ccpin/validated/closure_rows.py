"""φ(q′) on a tape: the rows of every closure and coupling, as `ccpin.kinematics.constraints` defines them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import Loop
from ccpin.validated.balls import rational
from ccpin.validated.chains import (
    ExactJoint,
    Pose,
    add,
    apply,
    dot,
    exact_rotation,
    exact_vector,
    multiply,
    poses,
    subtract,
)
from ccpin.validated.tape import Expression, Node, Tape


def closure_rows(
    tape: Tape, constraints: Constraints, joints: Sequence[ExactJoint], q_free: Sequence[Node]
) -> list[Expression]:
    """φ, row by row in the order of `Constraints`; directions and lengths are the exact doubles of its rows.

    Raises:
        UnsupportedMechanismError: A coupling holds a continuous joint.
    """
    rows: list[Expression] = []
    frames: dict[int, dict[int, Pose]] = {}
    for loop in constraints.loops:
        if loop.ancestor not in frames:
            frames[loop.ancestor] = poses(tape, joints, q_free, loop.ancestor)
        rows += _loop_rows(loop, frames[loop.ancestor])
    for gear in constraints.gears:
        total: Any = 0
        for term in gear.terms:
            if term.wrapped:
                raise UnsupportedMechanismError(
                    f"validated integration does not cover coupling '{gear.coupling.name}' of a continuous joint"
                )
            displacement, power = q_free[term.idx_q] - rational(term.reference), rational(1.0)
            for coefficient in term.coefficients:
                total = total + power * rational(coefficient)
                power = power * displacement
        rows.append(total)
    return rows


def _loop_rows(loop: Loop, frames: dict[int, Pose]) -> list[Expression]:
    """Point, direction, offset and distance rows of one loop."""
    turn_a, p_a = _end(frames[loop.joint_a], loop.frame_a)
    turn_b, p_b = _end(frames[loop.joint_b], loop.frame_b)
    gap = subtract(p_b, p_a)
    rows = [-1 * dot(exact_vector(direction), gap) for direction in loop.basis]
    for row in loop.rows.directions:
        total: Any = 0
        for weight, a, b in row.products:
            total = total + rational(weight) * dot(apply(turn_a, exact_vector(a)), apply(turn_b, exact_vector(b)))
        rows.append(total)
    rows += [dot(apply(turn_a, exact_vector(a)), gap) for a in loop.rows.offsets]
    if loop.rows.distance is not None:
        length = rational(loop.rows.distance)
        rows.append((dot(gap, gap) - length * length) * (1 / (2 * length)))
    return rows


def _end(body: Pose, frame: Any) -> Pose:
    """A closure frame carried by a body."""
    return Pose(
        multiply(body.rotation, exact_rotation(frame[:3, :3])),
        add(body.position, apply(body.rotation, exact_vector(frame[:3, 3]))),
    )
