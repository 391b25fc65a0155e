"""φ(q′) on a tape: the rows of every closure and coupling, as `ccpin.kinematics.constraints` defines them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from ccpin.description.closure_kinds import Gap
from ccpin.description.closure_kinds import Vector as ClosureVector
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.validated.balls import rational
from ccpin.validated.chains import (
    ExactJoint,
    Pose,
    Vector,
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


def _loop_rows(loop: ResolvedClosure, frames: dict[int, Pose]) -> list[Expression]:
    """The rows of one loop."""
    ends = {"A": _end(frames[loop.joint_a], loop.frame_a), "B": _end(frames[loop.joint_b], loop.frame_b)}
    gap = subtract(ends["B"].position, ends["A"].position)

    def value(vector: ClosureVector) -> Vector:
        if isinstance(vector, Gap):
            return gap
        local = exact_vector(vector.local)
        return local if vector.frame == "C" else apply(ends[vector.frame].rotation, local)

    def combine(parts: Iterable[tuple[float, Expression]]) -> Expression:
        total: Any = 0
        for weight, product in parts:
            total = total + rational(weight) * product
        return total

    return loop.rows.evaluate(value, dot, combine)


def _end(body: Pose, frame: Any) -> Pose:
    """A closure frame carried by a body."""
    return Pose(
        multiply(body.rotation, exact_rotation(frame[:3, :3])),
        add(body.position, apply(body.rotation, exact_vector(frame[:3, 3]))),
    )
