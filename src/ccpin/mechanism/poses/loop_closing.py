"""Closing loops from one open configuration."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, cross, skew
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.least_squares import Linearized, levenberg_marquardt
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.scratch import six_rows

TOLERANCE = 1e-12  # of |φ|, m and rad
_NEARLY_PARALLEL = 1e-6  # sin θ below which θ/sin θ is taken in its limit


class Attempt(NamedTuple):
    """Where closing ended, and whether it is closed there."""

    q_free: Array
    closed: bool


def close(constraints: Constraints, start: Array, tolerance: float = TOLERANCE) -> Attempt:
    """Close the loops from `start` up to a few times a tolerance: Levenberg–Marquardt on φ."""

    def linearize(q_free: Array) -> Linearized:
        point = constraints.value(q_free)
        return Linearized(point.phi, point.jacobian)

    return solve(constraints.model, linearize, start, tolerance)


def solve(
    model: pin.Model, linearize: Callable[[Array], Linearized], start: Array, tolerance: float = TOLERANCE
) -> Attempt:
    """Solve equations in q′ from a start of shape (nq,) up to a few times a tolerance."""
    found = levenberg_marquardt(start, linearize, lambda q, step: np.asarray(pin.integrate(model, q, step)), tolerance)
    return Attempt(found.place, found.error <= max(10 * TOLERANCE, 3 * tolerance))


def close_from_afar(constraints: Constraints, start: Array, tolerance: float = TOLERANCE) -> Attempt:
    """Close the loops from any pose, the right way round.

    Where the loops do not close directly, or close with axes turned end for end, they are closed in position
    first, then with rotation rows that vanish one way round only, then exactly.
    """
    attempt = close(constraints, start, tolerance)
    if attempt.closed and constraints.aligned(attempt.q_free):
        return attempt
    if any(loop.turnable for loop in constraints.loops):
        for rows in (position_rows, aligning_rows):
            start = solve(constraints.model, partial(rows, constraints), start, tolerance).q_free
        staged = close(constraints, start, tolerance)
        if staged.closed and constraints.aligned(staged.q_free):
            return staged
    return attempt._replace(closed=False)


def position_rows(constraints: Constraints, q_free: Array) -> Linearized:
    """φ without its direction rows: loops closed in position, whatever way their ends are turned."""
    point = constraints.value(q_free)
    turning = [turns for loop in constraints.loops for turns in loop.rows.direction_rows]
    keep = ~np.array([*turning, *(False for _ in constraints.couplings)], dtype=bool)
    return Linearized(point.phi[keep], point.jacobian[keep])


def aligning_rows(constraints: Constraints, q_free: Array) -> Linearized:
    """`position_rows` followed by three rows θ n of every closure that asks for directions to coincide.

    The direction rows of φ vanish, and attract, where axes are turned end for end as well. These vanish at θ = 0 only:
    the smallest rotation that takes a closure's directions on B to those on A is by θ about the unit vector n. They
    lead away from θ = π, where n is one of several. A single direction's rows are in axes that turn with the ancestor.
    """
    with constraints.scratch.lent() as data:
        pin.computeJointJacobians(constraints.model, data, q_free)
        turns = [_rotation(loop, data) for loop in constraints.loops if loop.turnable]
    rows, derivatives = zip(position_rows(constraints, q_free), *turns, strict=True)
    return Linearized(np.concatenate(rows), np.vstack(derivatives))


def _rotation(loop: ResolvedClosure, data: pin.Data) -> tuple[Array, Array]:
    """The rows θ n of one closure and their derivative."""
    turn_a, turn_b = loop.orientations(data)
    turning = six_rows(data.J)[3:]
    turning_a, turning_b = turning * loop.mask_a, turning * loop.mask_b
    if len(loop.rows.alignment) == 3:
        rotation = turn_b.T @ turn_a
        body_rate = turn_a.T @ turning_a - rotation.T @ (turn_b.T @ turning_b)
        return np.array(pin.log3(rotation)), pin.Jlog3(rotation) @ body_rate
    a_local, b_local = loop.rows.alignment[0]
    return _between(turn_a @ a_local, turn_b @ b_local, turning_a, turning_b)


def _between(a: Array, b: Array, turning_a: Array, turning_b: Array) -> tuple[Array, Array]:
    """θ n from the unit vector b to a, and its derivative: θ n = f k with k = b × a = sin θ n, f = θ / sin θ."""
    k, c = cross(b, a), float(a @ b)
    s = float(np.linalg.norm(k))
    theta = float(np.arctan2(s, c))
    if s < _NEARLY_PARALLEL and c < 0:
        axis = cross(a, np.eye(3)[int(np.argmin(np.abs(a)))])
        axis = axis / np.linalg.norm(axis)
        return theta * axis, np.outer(axis, axis) @ (turning_a - turning_b)
    da, db = -skew(a) @ turning_a, -skew(b) @ turning_b
    dk, dc = skew(b) @ da - skew(a) @ db, b @ da + a @ db
    if s < _NEARLY_PARALLEL:
        return k, dk
    return theta / s * k, theta / s * dk + np.outer(k, (theta * c - s) / s**3 * dc)
