"""What a URDF says of its joints' forces: <dynamics>, the springs of <gazebo> elements, and motors' <transmission>s."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

from ccpin.description.elements.xml import XmlElement, children, fail, number, numeric_attributes, tag, text_attribute
from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import Joint, Motor
from ccpin.description.names import nearest

DYNAMICS = dict.fromkeys(("damping", "friction", "armature", "breakaway", "stribeck_speed"), 1)
"""The attributes of <dynamics>, one number each; the last three are ccpin's own."""
_GAZEBO = {"springStiffness": "stiffness", "springReference": "spring_reference"}
_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
_SIMPLE = "SimpleTransmission"


def read_dynamics(element: XmlElement, notes: list[str]) -> dict[str, float]:
    """What the <dynamics> of a <joint> say, or its <joint_properties> as they were called once.

    URDF has no word for the rotor inertia of a joint without a motor; ``armature`` is MuJoCo's, and ccpin's own here,
    as are ``breakaway`` and ``stribeck_speed``.

    Raises:
        DescriptionError: An attribute is not a number, or nearly the name of one that exists.
    """
    found: dict[str, float] = {}
    for name in ("joint_properties", "dynamics"):
        for stated in element.iterfind(name):
            found |= {key: value for key, (value,) in numeric_attributes(stated, DYNAMICS).items()}
            for attribute in set(stated.attrib) - set(DYNAMICS):
                meant = nearest(attribute, DYNAMICS)
                if meant:
                    raise fail(stated, f"unknown attribute '{attribute}'; did you mean '{meant}'?")
                notes.append(f"joint '{element.get('name')}': {attribute} of its <{name}> is not read")
    return found


class Actuation(NamedTuple):
    """Motors and what else acts on joints, by joint name.

    Attributes:
        actuated: The joints of transmissions, or ``None`` where there is none.
        motors: One an actuated joint.
        armature: Reflected rotor inertias.
        springs: ``stiffness`` and ``spring_reference`` of joints with a spring.
        notes: What was left out.
    """

    actuated: tuple[str, ...] | None
    motors: tuple[Motor, ...]
    armature: dict[str, float]
    springs: dict[str, dict[str, float]]
    notes: list[str]


def read_drive(root: XmlElement, kinds: Mapping[str, str]) -> Actuation:
    """Read transmissions, the springs of <gazebo reference="joint">, and name what is not read.

    `kinds` are the file's joints. A motor's gear is its transmission's mechanicalReduction: u is the motor's own
    effort. Drake's gear_ratio says how fast the rotor turns and reflects its inertia; there u is the joint's effort,
    and so it is here. A transmission left on a fixed or absent joint drives nothing.

    Raises:
        DescriptionError: A transmission names no joint, or a number is malformed.
    """
    notes: list[str] = []
    motors: dict[str, Motor] = {}
    armature: dict[str, float] = {}
    for element in _transmissions(root):
        driven = list(children(element, "joint"))
        for joint in driven:
            name = text_attribute(joint, "name")
            if kinds.get(name, FIXED) == FIXED:
                what = "is fixed" if name in kinds else "does not exist"
                notes.append(f"{_named(element)} is left out, since joint '{name}' {what}")
                continue
            actuators = list(children(element, "actuator"))
            for actuator in actuators:
                armature[name] = armature.get(name, 0.0) + _reflected(actuator)
            motor = Motor(_motor_name(element, actuators, name), name, _gear(element, joint, actuators, notes))
            if name in motors:
                notes.append(f"{_named(element)} drives joint '{name}', which has a motor already: it is left out")
            motors.setdefault(name, motor)
    springs = _springs(root, kinds, notes)
    _note_guarded(root, notes)
    return Actuation(tuple(motors) or None, tuple(motors.values()), armature, springs, notes)


def _transmissions(root: XmlElement) -> Iterator[XmlElement]:
    """Those of ROS and Drake, and those inside ros2_control."""
    yield from children(root, "transmission")
    for control in children(root, "ros2_control"):
        yield from children(control, "transmission")


def _reflected(actuator: XmlElement) -> float:
    rotor, gear = (next(children(actuator, name), None) for name in ("rotor_inertia", "gear_ratio"))
    ratio = 1.0 if gear is None else number(gear, "value")
    return 0.0 if rotor is None else ratio * ratio * number(rotor, "value")


def _motor_name(element: XmlElement, actuators: list[XmlElement], joint: str) -> str:
    return (actuators[0].get("name") if len(actuators) == 1 else None) or element.get("name") or joint


def _gear(element: XmlElement, joint: XmlElement, actuators: list[XmlElement], notes: list[str]) -> float:
    """The mechanical reduction between motor and joint, of either sign; 1 where the transmission is not simple."""
    kind = element.get("type") or next((str(e.text or "").strip() for e in children(element, "type", "plugin")), "")
    several = len(actuators) > 1 or len(list(children(element, "joint"))) > 1
    if several or (kind and not kind.endswith(_SIMPLE)):
        notes.append(
            f"{_named(element)} couples motors and joints in a way that ccpin does not model ({kind or 'no type'}, "
            f"{len(actuators)} actuators): u acts on joint '{joint.get('name')}' itself"
        )
        return 1.0
    ratio = 1.0
    for place in (*actuators, joint, element):
        for stated in children(place, *_REDUCTIONS):
            ratio *= _number_in(stated)
    if ratio == 0.0:
        raise fail(element, "the mechanical reduction is zero, so its motor would move nothing")
    return ratio


def _number_in(element: XmlElement) -> float:
    """The finite number an element holds as its text."""
    try:
        value = float(element.text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise fail(element, f"{(element.text or '').strip()[:80]!r} is not a finite number")
    return value


def _springs(root: XmlElement, known: Container[str], notes: list[str]) -> dict[str, dict[str, float]]:
    """Gazebo's springs: ``<gazebo reference="joint"><springStiffness>k</springStiffness>…``."""
    springs: dict[str, dict[str, float]] = {}
    for element in children(root, "gazebo"):
        name, stated = element.get("reference"), list(children(element, *_GAZEBO))
        if stated and name not in known:
            notes.append(f"the spring of <gazebo reference='{name}'> is left out: there is no such joint")
        elif stated:
            springs.setdefault(str(name), {}).update({_GAZEBO[tag(e)]: _number_in(e) for e in stated})
    return springs


def _note_guarded(root: XmlElement, notes: list[str]) -> None:
    """Name the joints whose soft limits are not kept."""
    guarded = [str(j.get("name")) for j in root.iterfind("joint") if j.find("safety_controller") is not None]
    if guarded:
        notes.append(f"the safety_controller of {', '.join(guarded)} is left out")


def _named(element: XmlElement) -> str:
    return f"transmission '{element.get('name') or ''}'"


def with_forces(joint: Joint, drive: Actuation) -> Joint:
    """A joint with the rotor and the spring that the rest of the file states."""
    spring = drive.springs.get(joint.name, {})
    return replace(joint, armature=joint.armature + drive.armature.get(joint.name, 0.0), **spring)  # type: ignore[arg-type]
