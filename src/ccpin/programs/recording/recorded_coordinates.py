"""Numbers that hold a configuration in programs: q′, but of every circle the angle alone.

With them every joint of one degree of freedom is one number, and y of φ(q, y) = 0 has as many numbers as there are
equations: of the closures' rows, and of |p|² = 1 for every quaternion p in y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.kinematics.coordinates import Coordinate, IndependentCoordinates
from ccpin.programs.recording.ball_joints import BallAngle
from ccpin.programs.recording.recorded_tree import ExactJoint


class StateLayout(NamedTuple):
    """Independent coordinates in x and in q̇′.

    Attributes:
        places: Where q stands in x.
        velocities: Where each entry of q̇ stands in q̇′, or the negative number −1 − k where it is the rate of x_k.
        scalar: Whether q̇ is the rate of the numbers at `places`, one each.
        circles: Entries of q̇ that are an angle known up to whole turns.
    """

    places: tuple[int, ...]
    velocities: tuple[int, ...]
    scalar: bool
    circles: tuple[int, ...]


def layout_of(coordinates: IndependentCoordinates, joints: Sequence[ExactJoint]) -> StateLayout:
    """Where the independent coordinates stand; single turns of balls in numbers after the joints'."""
    extra = joints[-1].x.stop if joints else 0
    places, velocities, scalar, circles = list[int](), list[int](), True, list[int]()
    by_place = {k: joint for joint in joints for k in range(joint.v.start, joint.v.stop)}
    for part in coordinates.parts:
        joint = by_place[part.v_free.start]
        if part.component is not None and part.kind.unit == 4 and not part.slides[0]:
            places.append(extra)
            velocities.append(-1 - extra)
            extra += 1
            continue
        if part.wraps or (part.whole is not None and not joint.turning_axes):
            circles.append(len(velocities))
        where, moving = _windows(part, joint)
        places += where
        velocities += moving
        scalar = scalar and (part.whole is None or not joint.turning_axes)
    return StateLayout(tuple(places), tuple(velocities), scalar, tuple(circles))


def _windows(part: Coordinate, joint: ExactJoint) -> tuple[list[int], list[int]]:
    """Places in x and entries of q̇′ (−1 − k: the rate of x_k) of one coordinate."""
    x, v = range(joint.x.start, joint.x.stop), range(joint.v.start, joint.v.stop)
    if part.component is not None:
        k = part.kind.components.index(part.component)
        return [x[k]], [-1 - x[k] if part.slides[0] else v[k]]
    if part.whole is not None:
        return list(x), list(v)
    first = part.v_free.start - joint.v.start
    window = slice(first, first + part.v_free.stop - part.v_free.start)
    return list(x[window]), list(v[window])


def numbers_of(
    joints: Sequence[ExactJoint], q_free: Array, near: Array | None = None, turns: Sequence[BallAngle] = ()
) -> Array:
    """The numbers of a configuration of shape (nq,), rounded; angles within half a turn of those `near`."""
    numbers = list[float]()
    for joint in joints:
        held = q_free[joint.q].tolist()
        if joint.kind.unit == 2:
            angle = math.atan2(held[-1], held[-2])
            if near is not None:
                angle += math.tau * round((near[joint.x.stop - 1] - angle) / math.tau)
            held = [*held[:-2], angle]
        numbers += held
    for turn in turns:
        joint, reference = turn.ball.joint, turn.ball.reference
        unit = reference / np.linalg.norm(reference)
        numbers.append(float(joint.kind.rotation_vector(q_free[joint.q], unit)[turn.axis]))
    return np.array(numbers)
