"""Motors as they are, between a law's command and the efforts on the joints: lag, rate, torque–speed curve.

The command c is constant from one instant of a sampled law to the next, so what a current loop makes of it is known in
closed form: u̇ = (c − u)/τ, no faster than r, is a ramp as long as |c − u| > rτ and an exponential from there on. The
ramp's end is a switching time of the run. What leaves the loop is cut off at what the motor can give at its speed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, numbers
from ccpin.control.sampling import Numbers
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.simulation.plant.limits import motor_velocities


@dataclass(frozen=True)
class MotorModel:
    """What stands between a command and an effort; all of it is off by default.

    Gears, rotor inertias and bounds of u belong to the mechanism (`ccpin.load(…, motors=…, joints=…)`), encoders and
    their noise to the `Sampling`.

    Attributes:
        lag: τ of the current loops, s.
        rate: The fastest change of u, in units of u a second.
        speeds: Speeds of the motors' joints, rad/s or m/s, from 0 on and increasing: where `efforts` are known.
        efforts: The largest |u| that motors can give at these speeds when they drive, linear in between and constant
            beyond; when they brake, that at speed 0. So ``speeds=(0, 20), efforts=(5, 0)`` is a DC motor of 5 units
            stalled that runs free at 20 rad/s.

    `lag` and `rate` are one number for all motors or one each. They need a held command: `Sampling`, or
    `Simulator.step`.

    Raises:
        InvalidInputError: A number out of its range.
    """

    lag: Numbers = 0.0
    rate: Numbers = np.inf
    speeds: tuple[float, ...] = ()
    efforts: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        for name in ("lag", "rate"):
            array = numbers(getattr(self, name), f"motors: {name}")
            if array.ndim > 1 or not (array >= 0).all() or (name == "rate" and not (array > 0).all()):
                raise InvalidInputError(f"motors: {name} = {getattr(self, name)!r} must be positive numbers")
        speeds, efforts = numbers(self.speeds, "motors: speeds"), numbers(self.efforts, "motors: efforts")
        sound = speeds.shape == efforts.shape and speeds.ndim == 1 and np.isfinite([speeds, efforts]).all()
        if not sound or (len(speeds) and (speeds[0] != 0 or (np.diff(speeds) <= 0).any() or (efforts < 0).any())):
            raise InvalidInputError(
                f"motors: speeds = {self.speeds} and efforts = {self.efforts} must be as many each, finite, speeds "
                "from 0 on and increasing, efforts at least 0"
            )

    @property
    def held(self) -> bool:
        """Whether it needs commands that are held."""
        return bool(np.any(np.asarray(self.lag) > 0) or np.any(np.isfinite(self.rate)))


class CurrentLoops:
    """The motors' current loops under way: u from the last command on, in closed form.

    Args:
        motors: τ and r.
        count: How many motors there are.

    Raises:
        InvalidInputError: τ or r of another number of motors.
    """

    def __init__(self, motors: MotorModel, count: int) -> None:
        each = []
        for name in ("lag", "rate"):
            value = np.asarray(getattr(motors, name), dtype=np.float64)
            if value.shape not in ((), (count,)):
                raise InvalidInputError(f"motors: {name} has {value.size} values; it must be one or {count}")
            each.append(np.broadcast_to(value, (count,)))
        self._lag, self._rate = each
        self._start, self._from = -np.inf, np.zeros(count)
        self._command = np.zeros(count)

    def command(self, t: float, command: Array) -> None:
        """Give a command from t on."""
        if not np.array_equal(command, self._command):
            self._from, self._start, self._command = self.effort(t), t, np.array(command)

    def settle(self, u: Array) -> None:
        """Be at a u, and commanded to be there."""
        self._from, self._command = np.array(u), np.array(u)

    def effort(self, t: float) -> Array:
        """u at a time after the last command."""
        gap, ramp, since = self._command - self._from, self._ramp(), max(0.0, t - self._start)
        rate = np.where(ramp > 0, self._rate, 0.0)
        left = np.abs(gap) - rate * np.minimum(since, ramp)
        fading = np.exp(-np.maximum(0.0, since - ramp) / np.where(self._lag > 0, self._lag, 1.0))
        return np.asarray(self._command - np.sign(gap) * left * np.where(self._lag > 0, fading, since < ramp))

    def next_switch(self, t: float) -> float:
        """The first end of a ramp after t, infinite where there is none."""
        ends = self._start + self._ramp()
        later = ends[ends > t]
        return float(later.min()) if len(later) else np.inf

    def memory(self) -> dict[str, Array]:
        """What is remembered, as arrays; `recall` brings it back."""
        return {"loop_start": np.array(self._start), "loop_from": self._from, "loop_command": self._command}

    def recall(self, memory: Mapping[str, Any]) -> None:
        """Go on from what another run remembered."""
        self._start, self._from = float(memory["loop_start"]), np.array(memory["loop_from"])
        self._command = np.array(memory["loop_command"])

    def _ramp(self) -> Array:
        """How long each loop climbs at its fastest rate."""
        gap = np.abs(self._command - self._from)
        return np.where(np.isfinite(self._rate), np.maximum(0.0, gap / self._rate - self._lag), 0.0)


class TorqueSpeed:
    """What motors can give at the speed of their joints.

    Args:
        model: The reduced model.
        motors: The curve.
    """

    def __init__(self, model: ReducedModel, motors: MotorModel) -> None:
        mechanism = model.mechanism
        self.acts = bool(motors.speeds)
        self._speeds, self._efforts = np.array(motors.speeds), np.array(motors.efforts)
        self._v, self._gears = motor_velocities(mechanism), mechanism.motors.gears

    def bounds(self, state: State, v: ArrayLike) -> tuple[Array, Array]:
        """The least and largest u there, of shape (motors,) each."""
        ahead = state.v_free(v)[self._v] * np.sign(self._gears)
        driving = np.interp(np.abs(ahead), self._speeds, self._efforts)
        braking = self._efforts[0]
        return np.where(ahead < 0, -driving, -braking), np.where(ahead > 0, driving, braking)
