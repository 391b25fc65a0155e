"""Which stated limits a motion went beyond, read off its samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

import numpy as np

from ccpin.arrays import Array, instance
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.mechanism.joint_limits import position_bounds
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.results.trajectory import Trajectory

_Quantity = Literal["position", "velocity", "effort"]


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
    quantity: _Quantity
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
    columns = {"position": q_free, "velocity": v_free, "effort": u}
    ends = {(name, -1.0): values.min(axis=0, initial=np.inf) for name, values in columns.items()}
    ends |= {(name, 1.0): values.max(axis=0, initial=-np.inf) for name, values in columns.items()}
    found = []
    for joint, quantity, limit, column, sign in _limits(mechanism):
        extreme = float(ends[quantity, sign][column])
        if sign * (extreme - limit) > 0:
            over = sign * (columns[quantity][:, column] - limit) > 0
            found.append(Exceeded(joint, quantity, limit, extreme, float(t[over.argmax()])))
    return tuple(found)


def _limits(mechanism: Mechanism) -> Iterator[tuple[str, _Quantity, float, int, float]]:
    """Each limit: whose, of what, its value, the column of that, and −1 for a lower one, 1 for an upper."""
    for bound in position_bounds(mechanism):
        yield bound.joint, "position", bound.limit, bound.q, bound.sign
    for k, most in enumerate(mechanism.joints.velocity.tolist()):
        if most > 0:
            yield from ((mechanism.joints.names[k], "velocity", sign * most, k, sign) for sign in (-1.0, 1.0))
    for k, (motor, bounds) in enumerate(zip(mechanism.motors.each, mechanism.motors.limits.tolist(), strict=True)):
        yield from ((motor.joint, "effort", bound, k, sign) for sign, bound in zip((-1.0, 1.0), bounds, strict=True))
