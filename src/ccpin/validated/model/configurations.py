"""Numbers that hold a configuration, in balls: exact ones from doubles, and back to q′."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ccpin.description.joint_kinds import JointKind
from ccpin.programs.recording.recorded_tree import ExactJoint
from ccpin.validated.arithmetic.balls import Ball, ball, flint


def on_manifold(kind: JointKind, held: Sequence[Ball]) -> list[Ball]:
    """The numbers of an exact configuration of a joint: of a circle or quaternion the point nearest to its doubles."""
    plain = list(held[: kind.nq - kind.unit])
    if kind.unit == 2:
        return [*plain, flint().arb.atan2(held[-1], held[-2])]
    length = sum((x * x for x in held[len(plain) :]), ball(0)).sqrt()
    return [*plain, *(x / length for x in held[len(plain) :])]


def unwound(angle: Ball, near: float) -> Ball:
    """An angle less the whole turns that bring it within about half a turn of another."""
    turns = round((near - float(angle.mid())) / math.tau)
    return angle + 2 * turns * flint().arb.pi()


def configuration(joints: Sequence[ExactJoint], box: Sequence[Ball]) -> list[Ball]:
    """The box of q′ of a box of numbers."""
    held = list[Ball]()
    for joint in joints:
        part = list(box[joint.x])
        if joint.kind.unit == 2:
            sine, cosine = part[-1].sin_cos()
            part = [*part[:-1], cosine, sine]
        held += part
    return held
