"""What usual shortcuts cost along a motion: joints' efforts that are missing, and where the joints are for it.

The serial robot's own efforts τ_s (its links alone) go to the motors by a shortcut in place of

    τ_m = J(q)⁻ᵀ (τ_s + τ_linkage),

static_map: J(q)⁻ᵀ τ_s; constant_armature: J(q)⁻ᵀ (τ_s + A q̈), A the diagonal of the rotors' inertia at the reference;
serial: J(q_reference)⁻ᵀ τ_s. What the joints then lack is Jᵀ of the difference. What they do for it is simulated: the
shortcut as feed-forward, with a PD law at the joints through the exact map.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import trapezoid
from scipy.interpolate import CubicSpline

from ccpin.arrays import Array, choice, instance, positive, whole
from ccpin.control.references import Reference
from ccpin.dynamics.state import Near
from ccpin.simulation.integration.single_run import simulate
from ccpin.simulation.plant.limits import Limits
from ccpin.transmission.posture import Posture
from ccpin.transmission.transmission import Transmission


class MotorLoads(NamedTuple):
    """What a motion asks of the motors, of shape (motors,) each: N m and rad/s (N and m/s) at their joints.

    Attributes:
        motors: Names.
        rms_effort: √(∫τ²dt/T): what heats them.
        peak_effort: Largest |τ|. peak_speed: largest |rate|.
        used: peak_effort as a part of the stated limit, 0 where none is stated.
    """

    motors: tuple[str, ...]
    rms_effort: Array
    peak_effort: Array
    peak_speed: Array
    used: Array

    @property
    def first(self) -> str:
        """The motor that is nearest to its limit of effort."""
        return self.motors[int(np.argmax(self.used))]


class Comparison(NamedTuple):
    """A shortcut along a motion.

    Attributes:
        shortcut: Its name.
        joints, motors: Names.
        t: Times, of shape (T,).
        exact: Motors' efforts that the motion takes, of shape (T, n).
        used: Those of the shortcut, of shape (T, n).
        wanted: Joints' efforts of the whole motion, Jᵀ of `exact`, of shape (T, n).
        missing: What the joints lack, Jᵀ(exact − used), of shape (T, n).
        deviation: q_d − q under a PD law with the shortcut as feed-forward, of shape (T, n), rad or m; with no rows
            where it was not asked for.
    """

    shortcut: str
    joints: tuple[str, ...]
    motors: tuple[str, ...]
    t: Array
    exact: Array
    used: Array
    wanted: Array
    missing: Array
    deviation: Array

    @property
    def torque_error(self) -> float:
        """RMS of what is missing over RMS of what is wanted, all joints together."""
        return float(np.sqrt(_mean_square(self.t, self.missing).sum() / _mean_square(self.t, self.wanted).sum()))

    @property
    def torque_errors(self) -> Array:
        """RMS of what each joint lacks, N m or N, of shape (n,)."""
        return np.sqrt(_mean_square(self.t, self.missing))

    @property
    def motion_errors(self) -> Array:
        """Largest |q_d − q| of each joint, rad or m, of shape (n,)."""
        return (
            np.asarray(np.abs(self.deviation).max(axis=0)) if len(self.deviation) else np.full(len(self.joints), np.nan)
        )

    def as_json(self) -> dict[str, Any]:
        """The figures as numbers and lists."""
        return {
            "shortcut": self.shortcut,
            "torque_error": self.torque_error,
            "torque_errors": self.torque_errors.tolist(),
            "motion_errors": [None if np.isnan(x) else x for x in self.motion_errors.tolist()],
        }


def _mean_square(t: Array, rows: Array) -> Array:
    return np.asarray(trapezoid(rows**2, t, axis=0) / (t[-1] - t[0]))


class _Shortcut(NamedTuple):
    """What shortcuts know: the posture, the serial robot's efforts there, the acceleration, and the reference."""

    posture: Posture
    serial: Array
    acceleration: Array
    home: Posture


def _static(known: _Shortcut) -> Array:
    return known.posture.motor_effort(known.serial)


def _armature(known: _Shortcut) -> Array:
    constant = np.diag(known.home.rotor_inertia)
    return known.posture.motor_effort(known.serial + constant * known.acceleration)


def _serial(known: _Shortcut) -> Array:
    return known.home.motor_effort(known.serial)


SHORTCUTS: dict[str, Callable[[_Shortcut], Array]] = {
    "static_map": _static,
    "constant_armature": _armature,
    "serial": _serial,
}


class _Along(NamedTuple):
    """A motion at instants, each row one."""

    t: Array
    postures: list[Posture]
    v: Array
    a: Array


def _along(transmission: Transmission, motion: Reference, near: Near | Posture, samples: int) -> _Along:
    t = np.linspace(0.0, positive(instance(motion, "motion", Reference).duration, "motion.duration"), samples)
    states = [motion.at(float(each)) for each in t]
    postures, here = list[Posture](), near
    for state in states:
        here = transmission.at(transmission.joint_side.positions(state.q), here)
        postures.append(here)
    return _Along(t, postures, np.array([s.v for s in states]), np.array([s.a for s in states]))


def _exact(along: _Along) -> Array:
    """Motors' efforts of the whole motion, (T, n)."""
    rows = zip(along.postures, along.v, along.a, strict=True)
    return np.array([posture.motor_effort(posture.state.tau(v, a)) for posture, v, a in rows])


def motor_loads(
    transmission: Transmission, motion: Reference, near: Near | Posture = None, *, samples: int = 201
) -> MotorLoads:
    """What a motion of the joints asks of the motors, the serial robot and the linkage being moved.

    Args:
        transmission: The transmission.
        motion: A reference of its joints (`Swing`, or one of `ccpin.control` made with `joint_model`).
        near: Chooses the assembly mode.
        samples: Instants along it.

    Raises:
        UnreachableError, SingularConfigurationError: The motion leaves the branch.
        InvalidInputError: No reference.
    """
    along = _along(instance(transmission, "transmission", Transmission), motion, near, whole(samples, "samples", 2))
    efforts = _exact(along)
    speeds = np.array([posture.motor_velocity(v) for posture, v in zip(along.postures, along.v, strict=True)])
    most = np.abs(transmission.joint_model.mechanism.motors.joint_limits).min(axis=1)
    peak = np.abs(efforts).max(axis=0)
    rms = np.sqrt(_mean_square(along.t, efforts))
    return MotorLoads(transmission.motors, rms, peak, np.abs(speeds).max(axis=0), peak / most)


def compare(
    transmission: Transmission,
    motion: Reference,
    shortcut: str = "static_map",
    near: Near | Posture = None,
    *,
    samples: int = 201,
    bandwidth: float | None = None,
) -> Comparison:
    """What a shortcut costs along a motion of the joints.

    Args:
        transmission: The transmission.
        motion: A reference of its joints (`Swing`, or one of `ccpin.control` made with `joint_model`).
        shortcut: ``static_map``, ``constant_armature`` or ``serial``.
        near: Chooses the assembly mode.
        samples: Instants along it.
        bandwidth: f of the joints' PD law K_p = (2πf)² diag D, K_v = 4πf diag D, Hz, D at the reference, with which
            deviations are simulated, without friction and limits; default: none is simulated.

    Raises:
        UnreachableError, SingularConfigurationError: The motion leaves the branch.
        InvalidInputError: No reference, or a word that is none of the three.
    """
    rule = SHORTCUTS[choice(shortcut, "shortcut", tuple(SHORTCUTS))]
    along = _along(instance(transmission, "transmission", Transmission), motion, near, whole(samples, "samples", 2))
    exact, home = _exact(along), transmission.reference
    rows = list(zip(along.postures, along.v, along.a, strict=True))
    used = np.array([rule(_Shortcut(posture, posture.serial_effort(v, a), a, home)) for posture, v, a in rows])
    wanted = np.array([p.joint_effort(u) for p, u in zip(along.postures, exact, strict=True)])
    missing = np.array([p.joint_effort(u) for p, u in zip(along.postures, exact - used, strict=True)])
    deviation = np.empty((0, transmission.n))
    if bandwidth is not None:
        deviation = _deviation(transmission, motion, along, used, positive(bandwidth, "bandwidth"))
    return Comparison(
        shortcut, transmission.joints, transmission.motors, along.t, exact, used, wanted, missing, deviation
    )


def _deviation(transmission: Transmission, motion: Reference, along: _Along, used: Array, bandwidth: float) -> Array:
    """q_d − q at the instants, simulated."""
    model, side = transmission.joint_model, transmission.joint_side
    gears = model.mechanism.motors.gears
    inertia = np.diag(transmission.reference.state.D)
    w = 2.0 * np.pi * bandwidth
    feedforward = CubicSpline(along.t, used)
    back = CubicSpline(along.t, np.array([posture.inverse.T for posture in along.postures]))

    def law(t: float, q: Array, v: Array) -> Array:
        state = motion.at(t)
        error = side.positions(state.q) - side.positions(q)
        feedback = inertia * (w * w * error + 2.0 * w * (state.v - v))
        return np.asarray((feedforward(t) + back(t) @ feedback) / gears)

    period = float(along.t[1] - along.t[0])
    start = along.postures[0].state
    run = simulate(
        model, law, start.q, along.v[0], duration=motion.duration, near=start, sample_period=period,
        limits=Limits(effort="ignore"), friction={},
    )  # fmt: skip
    if run.cause is not None:
        raise run.cause
    desired = np.array([side.positions(motion.at(float(t)).q) for t in run.t])
    return np.asarray(desired - np.array([side.positions(q) for q in run.q]))
