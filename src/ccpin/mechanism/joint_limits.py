"""The limits of a mechanism's joints, one by one."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from ccpin.mechanism.mechanism import Mechanism


class PositionBound(NamedTuple):
    """One finite limit of a joint with one displacement.

    Attributes:
        joint: The joint's name.
        side: Which of the two it is.
        q, v: Where the joint stands in q′ and in q̇′.
        sign: −1 for the lower limit, 1 for the upper one.
        limit: Its value, rad or m.
    """

    joint: str
    side: Literal["lower", "upper"]
    q: int
    v: int
    sign: float
    limit: float


def position_bounds(mechanism: Mechanism) -> tuple[PositionBound, ...]:
    """Every finite limit of the joints with one displacement."""
    found: list[PositionBound] = []
    lower, upper = mechanism.position_limits
    for joint in mechanism.tree.joints:
        if joint.kind.nq == joint.kind.nv == 1:
            q, v = joint.q.start, joint.v.start
            found.append(PositionBound(joint.name, "lower", q, v, -1.0, float(lower[q])))
            found.append(PositionBound(joint.name, "upper", q, v, 1.0, float(upper[q])))
    return tuple(bound for bound in found if np.isfinite(bound.limit))
