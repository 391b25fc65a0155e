"""What motors give at their joints: stated limits, a torque–speed line, and their friction."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Indices, instance, one_each
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.state import State
from ccpin.errors import InvalidInputError
from ccpin.simulation.plant.motors import MotorModel, TorqueSpeed


def stated_efforts(model: ReducedModel, motors: tuple[str, ...], effort: ArrayLike | None) -> tuple[Array, Array]:
    """−effort and effort, or what the mechanism states of its motors, behind their gears, of shape (n,) each.

    Raises:
        InvalidInputError: A negative effort, or none stated.
    """
    if effort is not None:
        most = one_each(effort, "effort", len(motors))
        return -most, most
    ends = model.mechanism.motors.joint_limits
    unknown = [name for name, each in zip(motors, ends, strict=True) if not np.isfinite(each).all()]
    if unknown:
        raise InvalidInputError(f"no limit of effort is stated of {', '.join(unknown)}: give effort=")
    return ends[:, 0], ends[:, 1]


def at_speed(
    model: ReducedModel, motors: MotorModel, state: State, v_joint: Array, lower: Array, upper: Array
) -> tuple[Array, Array]:
    """The bounds that a torque–speed line leaves at a velocity."""
    ends = np.array(TorqueSpeed(model, motors).bounds(state, v_joint)) * model.mechanism.motors.gears
    return np.maximum(lower, ends.min(axis=0)), np.minimum(upper, ends.max(axis=0))


def up_to_speed(model: ReducedModel, motors: MotorModel | None, damping: Array, speed: Array, room: Array) -> Array:
    """What motors give either way at any speed of their joints up to a largest, damping there taken off.

    Args:
        model: The reduced model.
        motors: Their torque–speed line, in units of u; none, or one without, cuts nothing off.
        damping: Of the motors' joints.
        speed: The largest, of shape (n,).
        room: What they give either way at rest.
    """
    if motors is not None and instance(motors, "motors", MotorModel).speeds:
        known = np.array(motors.speeds)
        passed = np.where(known <= speed[:, None], np.array(motors.efforts), np.inf).min(axis=1)
        line = np.minimum(passed, np.interp(speed, known, motors.efforts))  # linear in between
        room = np.minimum(room, line * np.abs(model.mechanism.motors.gears))
    return room - damping * speed


def less_friction(lower: Array, upper: Array, level: Array, moving: Array) -> tuple[Array, Array]:
    """The bounds of what arrives past friction of a level, which opposes the motors' velocity.

    It takes its level off what drives and adds it to what brakes. At rest it is taken off both ways, and what is left,
    if anything, sets the joints in motion.
    """
    way = np.sign(moving)
    rest = way == 0.0
    return (
        np.where(rest, np.minimum(lower + level, 0.0), lower - way * level),
        np.where(rest, np.maximum(upper - level, 0.0), upper - way * level),
    )


def stated_speeds(model: ReducedModel, motors: tuple[str, ...], rows: Indices, speed: ArrayLike | None) -> Array:
    """The largest speeds of the motors' joints, as given or as the file states them, of shape (n,).

    Raises:
        InvalidInputError: A speed that is not positive, or none stated.
    """
    most = model.mechanism.joints.velocity[rows] if speed is None else one_each(speed, "speed", len(motors))
    if not (np.isfinite(most) & (most > 0.0)).all():
        raise InvalidInputError(f"speeds of {', '.join(motors)} are {most}; they must be positive: give speed=")
    return np.array(most)
