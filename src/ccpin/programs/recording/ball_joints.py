"""Rotation vectors of ball joints on a tape: single turns as coordinates, and the springs of balls.

With the quaternion (a, w) relative to a reference, of the sign for which w > 0, and g(w) = 2 arccos(w)/√(1 − w²), the
rotation vector is r = g(w) a, and its rate is J ω with ω the angular velocity in the turning frame,

    J = ½ (g w I + g [a]× − g′ a aᵀ),

which is `ccpin.description.rotations`' J, as g′ = (w g − 2)/(1 − w²). A coordinate r_k is a number of its own beside
those of q′, held by the equation r_k − g(w) a_k = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.programs.recording.recorded_tree import ExactJoint, Table, exact, rational
from ccpin.programs.tape import Expression, Tape


class BallTurn(NamedTuple):
    """The turn of a joint from a reference.

    Attributes:
        joint: The joint.
        reference: A quaternion of doubles whose direction is that of the unit one it is counted from, of the sign for
            which w > 0 where it was recorded; of shape (4,).
    """

    joint: ExactJoint
    reference: Array

    def relative(self, tape: Tape, x: Table) -> tuple[Table, Expression]:
        """A and w at the numbers x."""
        stated = exact(self.reference)
        a, b, c, s = stated * tape.reciprocal(tape.root(stated @ stated))
        p = list(x[self.joint.x.stop - 4 : self.joint.x.stop])
        rows = (s, c, -b, -a), (-c, s, a, -b), (b, -a, s, -c), (a, b, c, s)
        *vector, cosine = (sum(k * e for k, e in zip(row, p, strict=True)) for row in rows)
        return np.array(vector, dtype=object), cosine


class BallAngle(NamedTuple):
    """A single turn of a ball as a coordinate: entry `axis` of its rotation vector, held by the number at `place`."""

    ball: BallTurn
    axis: int
    place: int


def ball_at(joint: ExactJoint, reference: Array, near: Array) -> BallTurn:
    """The turn of a joint from a quaternion of doubles (the unit one nearest to it), about numbers near."""
    sign = 1.0 if float(near[joint.x.stop - 4 : joint.x.stop] @ reference) >= 0.0 else -1.0
    return BallTurn(joint, sign * reference)


def turns_of(coordinates: IndependentCoordinates, joints: Sequence[ExactJoint], near: Array) -> tuple[BallAngle, ...]:
    """The single turns among independent coordinates; their numbers come after the joints'."""
    by_place, found = {joint.v.start: joint for joint in joints}, list[BallAngle]()
    for part in coordinates.parts:
        if part.component is not None and part.kind.unit == 4 and not part.slides[0]:
            joint = by_place[part.v_free.start]
            turned = ball_at(joint, coordinates.q_reference[joint.q][-4:], near)
            found.append(BallAngle(turned, "xyz".index(part.component[1]), joints[-1].x.stop + len(found)))
    return tuple(found)


def turn_rows(tape: Tape, turns: Sequence[BallAngle], x: Table) -> list[Expression]:
    """r_k − g(w) a_k."""
    rows = []
    for turn in turns:
        vector, cosine = turn.ball.relative(tape, x)
        rows.append(x[turn.place] - tape.gain(tape.node(cosine)) * vector[turn.axis])
    return rows


def turn_rates(tape: Tape, turns: Sequence[BallAngle], x: Table, n_free: int) -> Table:
    """Rows of Γ for the turns' numbers: those of J, of shape (turns, n′)."""
    table = np.zeros((len(turns), n_free), dtype=object)
    half = rational(0.5)
    for row, turn in zip(table, turns, strict=True):
        (a, b, c), w = turn.ball.relative(tape, x)
        k, cosine = turn.axis, tape.node(w)
        vector, gain = np.array([a, b, c], dtype=object), tape.gain(cosine)
        across = np.array([[0, -c, b], [c, 0, -a], [-b, a, 0]], dtype=object)[k]
        along = np.eye(3, dtype=object)[k] * w
        stop = turn.ball.joint.v.stop
        row[stop - 3 : stop] = ((along + across) * gain - vector * (vector[k] * tape.gain(cosine, 1))) * half
    return table
