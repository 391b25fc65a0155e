"""Which stated limits a motion went beyond, read off its samples."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, NamedTuple

from ccpin.arrays import Array, instance
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.mechanism.joint_limits import position_bounds
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.results.trajectory import Trajectory


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

    @property
    def note(self) -> str:
        """That there is one, for whoever did not ask."""
        return (
            f"{self.joint} is beyond its limit of {self.quantity}, {self.limit:.4g}; `simulation.exceeded` tells more"
        )


def exceeded(model: ReducedModel | Mechanism, trajectory: Trajectory) -> tuple[Exceeded, ...]:
    """The limits of positions, velocities and efforts that samples of a motion are beyond, in that order.

    What `Limits` ignores is told here; between samples nothing is looked at (`Limits` does).

    Raises:
        DifferentSubjectsError: The trajectory is not this model's.
    """
    instance(trajectory, "trajectory", Trajectory)
    model = trajectory.of("limits", model, "closures", "plant")
    return beyond_limits(model.mechanism, trajectory.t, trajectory.q_free, trajectory.v_free, trajectory.u)


def at_effort_limits(mechanism: Mechanism, u: Array) -> dict[str, float]:
    """The joints of the motors whose u (T, motors) was cut off at a limit, and for which share of the samples."""
    lower, upper = mechanism.motors.limits.T
    at = (((u == lower) | (u == upper)) & (u != 0.0)).mean(axis=0)
    shares = dict[str, float]()
    for motor, share in zip(mechanism.motors.each, at, strict=True):
        shares[motor.joint] = max(shares.get(motor.joint, 0.0), float(share))
    return {name: share for name, share in shares.items() if share > 0.0}


def shares_in_words(shares: Mapping[str, float]) -> str:
    """Joints, and for which share of the samples."""
    return ", ".join(f"{name} for {share:.0%}" for name, share in shares.items())


def beyond_limits(mechanism: Mechanism, t: Array, q_free: Array, v_free: Array, u: Array) -> tuple[Exceeded, ...]:
    """The same of samples: times (T,), q′ (T, nq), q̇′ (T, n′) and u (T, motors)."""
    found = [
        _beyond(t, bound.joint, "position", bound.limit, q_free[:, bound.q], bound.sign)
        for bound in position_bounds(mechanism)
    ]
    joints = mechanism.joints
    for k, most in enumerate(joints.velocity):
        if most > 0:
            found += [_beyond(t, joints.names[k], "velocity", s * most, v_free[:, k], s) for s in (-1.0, 1.0)]
    for k, (motor, bounds) in enumerate(zip(mechanism.motors.each, mechanism.motors.limits, strict=True)):
        pairs = zip((-1.0, 1.0), bounds.tolist(), strict=True)
        found += [_beyond(t, motor.joint, "effort", b, u[:, k], sign) for sign, b in pairs]
    return tuple(one for one in found if one is not None)


def _beyond(
    t: Array, joint: str, quantity: Literal["position", "velocity", "effort"], limit: float, values: Array, sign: float
) -> Exceeded | None:
    over = sign * (values - limit)
    if not (over > 0).any():
        return None
    return Exceeded(joint, quantity, float(limit), float(values[over.argmax()]), float(t[(over > 0).argmax()]))
