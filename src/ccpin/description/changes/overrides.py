"""What a user states of joints and motors beside the file: damping, friction, springs, limits, gears."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from numbers import Real

from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import Joint, MechanismDescription, Motor
from ccpin.description.names import choices
from ccpin.errors import InvalidInputError

Stated = Mapping[str, Mapping[str, float]]
JOINT_FIELDS = tuple(field.name for field in fields(Joint) if field.type == "float")
MOTOR_FIELDS = ("gear", "lower", "upper")


def with_stated(
    description: MechanismDescription, joints: Stated | None = None, motors: Stated | None = None
) -> MechanismDescription:
    """The description with some numbers of its joints and motors replaced; it is to be checked again.

    Args:
        description: What the file says.
        joints: By joint name, of `Joint`: damping, friction, breakaway, stribeck_speed, stiffness, spring_reference,
            armature, effort, velocity, lower, upper.
        motors: By joint name, of `Motor`: gear, lower, upper. A joint that the file gives no motor gets one to be used
            where it is actuated.

    Raises:
        InvalidInputError: An unknown joint or field, or something else than a number.
    """
    names = {joint.name: joint.kind != FIXED for joint in description.joints}
    by_joint = _checked("joints", joints, names, JOINT_FIELDS)
    by_motor = _checked("motors", motors, names, MOTOR_FIELDS)
    known = {motor.joint: motor for motor in description.motors}
    known |= {name: replace(known.get(name, Motor(name, name)), **stated) for name, stated in by_motor.items()}  # type: ignore[arg-type]
    return replace(
        description,
        joints=tuple(replace(joint, **by_joint.get(joint.name, {})) for joint in description.joints),  # type: ignore[arg-type]
        motors=tuple(known.values()),
    )


def _checked(
    word: str, stated: Stated | None, names: dict[str, bool], allowed: tuple[str, ...]
) -> dict[str, dict[str, float]]:
    if stated is None:
        return {}
    if not isinstance(stated, Mapping):
        raise InvalidInputError(f'{word} must be a mapping like {{"knee": {{"{allowed[0]}": 0.1}}}}')
    found = {}
    for name, numbers in stated.items():
        if name not in names:
            movable = [joint for joint, moves in names.items() if moves]
            raise InvalidInputError(f"{word}: '{name}' is no joint; {choices(str(name), movable)}")
        if not isinstance(numbers, Mapping):
            raise InvalidInputError(f"{word}: what is stated of '{name}' must be a mapping of {', '.join(allowed)}")
        found[name] = {
            key: _number(f"{word}: {key} of '{name}'", key, value, allowed) for key, value in numbers.items()
        }
    return found


def _number(where: str, key: str, value: object, allowed: tuple[str, ...]) -> float:
    if key not in allowed:
        raise InvalidInputError(f"{where} cannot be stated; {choices(key, allowed)}")
    if isinstance(value, bool) or not isinstance(value, Real) or math.isnan(value):
        raise InvalidInputError(f"{where} is {value!r}; it must be a number")
    return float(value)
