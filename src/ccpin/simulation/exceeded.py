"""Which stated limits a motion went beyond, read off its samples."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array, instance
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.limits import position_bounds
from ccpin.simulation.trajectory import Trajectory


class Exceeded(NamedTuple):
    """One limit that a motion went beyond.

    Attributes:
        joint: The joint (or its component), or the motor's.
        quantity: What of it.
        limit: As stated, in rad, m, rad/s, m/s or units of u.
        extreme: The value furthest beyond.
        since: Time of the first sample beyond, s.
    """

    joint: str
    quantity: Literal["position", "velocity", "effort"]
    limit: float
    extreme: float
    since: float


def exceeded(model: ReducedModel | Mechanism, trajectory: Trajectory) -> tuple[Exceeded, ...]:
    """The limits of positions, velocities and efforts that samples of a motion are beyond, in that order.

    What `Limits` ignores is told here; between samples nothing is looked at (`Limits` does).

    Raises:
        DifferentSubjectsError: The trajectory is not this model's.
    """
    instance(trajectory, "trajectory", Trajectory)
    model = trajectory.of("limits", model, "closures", "plant")
    mechanism = model.mechanism
    rates = np.array([state.v_free(v) for state, v, _ in trajectory.states(model)])
    found = [
        _beyond(trajectory.t, joint, "position", limit, trajectory.q_free[:, q], sign)
        for joint, _, q, _, sign, limit in position_bounds(mechanism)
    ]
    joints = mechanism.joints
    for k, most in enumerate(joints.velocity):
        if most > 0:
            found += [_beyond(trajectory.t, joints.names[k], "velocity", s * most, rates[:, k], s) for s in (-1.0, 1.0)]
    for k, (motor, bounds) in enumerate(zip(mechanism.motors.each, mechanism.motors.limits, strict=True)):
        pairs = zip((-1.0, 1.0), bounds.tolist(), strict=True)
        found += [_beyond(trajectory.t, motor.joint, "effort", b, trajectory.u[:, k], sign) for sign, b in pairs]
    return tuple(one for one in found if one is not None)


def _beyond(
    t: Array, joint: str, quantity: Literal["position", "velocity", "effort"], limit: float, values: Array, sign: float
) -> Exceeded | None:
    over = sign * (values - limit)
    if not (over > 0).any():
        return None
    return Exceeded(joint, quantity, float(limit), float(values[over.argmax()]), float(t[(over > 0).argmax()]))
