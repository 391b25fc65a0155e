"""MJCF's actuators as motors: their gears, bounds and, where a loop is closed around them, its gains.

MuJoCo's actuator puts gear × force on its joint, force = gain·ctrl + b₀ + b₁ length + b₂ rate with length and rate the
gear times the joint's displacement and velocity. Where the biases are zero and nothing filters ctrl, the actuator is a
motor: u is ctrl and gear × gain its gear here. All others keep their numbers, and u is their force.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import FrozenMapping
from ccpin.description.mjcf.defaults import Defaults
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.joints import WorldBody
from ccpin.description.model import Motor
from ccpin.description.xml import XmlElement, label

_X_AXIS = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_TYPES = ("dyntype", "gaintype", "biastype")
_KEPT = ("dynprm", "kp", "ki", "kv", "dampratio")


class Actuators(NamedTuple):
    """What the file's actuators are to a mechanism.

    Attributes:
        driven: The joints they drive, in order, or ``None`` where there is none.
        motors: One a driven joint.
        armature, damping: What they add to their joints', reflected by the gear squared.
        notes: What was left out.
    """

    driven: tuple[str, ...] | None
    motors: tuple[Motor, ...]
    armature: dict[str, float]
    damping: dict[str, float]
    notes: list[str]


def read_actuators(sections: Sequence[XmlElement], tree: WorldBody, defaults: Defaults, autolimits: bool) -> Actuators:
    """Read every actuator; those that drive no joint, or a joint that has a motor already, are noted.

    Raises:
        DescriptionError: An attribute is unknown or malformed, or the joint does not exist.
    """
    motors: dict[str, Motor] = {}
    armature: dict[str, float] = {}
    damping: dict[str, float] = {}
    notes: list[str] = []
    kinds = {joint.name: joint.kind for joint in tree.joints}
    for xml in (xml for section in sections for xml in section.iterchildren("*")):
        said = defaults.actuator(xml)
        joint = said.text("joint") or said.text("jointinparent")
        if joint is None:
            notes.append(f"The actuator {label(xml)} drives no joint; it is left out.")
            continue
        if joint not in tree.reference:
            raise said.fail(f"there is no joint '{joint}'; there are: {', '.join(tree.reference) or 'none'}")
        single = kinds[joint] in ("revolute", "prismatic")
        ratio = _first(said, "gear", 1.0) if single else 1.0
        motor = _motor(said, xml, joint, ratio, autolimits)
        if motor is None:
            notes.append(f"The actuator {label(xml)} has a gear or a gain of 0 and drives nothing; it is left out.")
            continue
        if not single:
            motor = _on_many(motor, said, kinds[joint], notes)
        else:
            armature[joint] = armature.get(joint, 0.0) + ratio**2 * said.number("armature", 0.0)
            damping[joint] = damping.get(joint, 0.0) + ratio**2 * _first(said, "damping", 0.0)
            if any(said.some_numbers("damping", 3)[1:]):
                notes.append(f"Left out: the nonlinear part of the damping of actuator {label(xml)}.")
        if joint in motors:
            notes.append(f"The actuator {label(xml)} is left out: u has one entry for joint '{joint}', of its first.")
            continue
        motors[joint] = motor
        if motor.kind != "motor":
            notes.append(
                f"The loop of actuator '{motor.name}' ({motor.kind}) is not simulated: u is its force before the gear; "
                "mechanism.motors has its gains, for a law."
            )
    return Actuators(tuple(motors) or None, tuple(motors.values()), armature, damping, notes)


def _motor(said: Element, xml: XmlElement, joint: str, gear: float, autolimits: bool) -> Motor | None:
    """One actuator; ``None`` where it moves nothing."""
    gain = _first(said, "gainprm", 1.0)
    bias = (*said.some_numbers("biasprm", 10), 0.0, 0.0, 0.0)[:3]
    activation, gains_as, biased = (said.text(name) or "none" for name in _TYPES)
    plain = activation == "none" and gains_as in ("none", "fixed")
    linear = plain and (biased == "none" or (biased == "affine" and not any(bias)))
    if gear == 0.0 or (linear and gain == 0.0):
        return None
    name = said.text("name") or joint
    lower, upper = _interval(said, "forcelimited", "forcerange", autolimits)
    if not linear:
        gains = {key: said.some_numbers(key, 10) for key in _KEPT if said.text(key)}
        if gains_as in ("none", "fixed") and biased in ("none", "affine"):
            gains |= {"gain": (gain,), "bias": bias if biased == "affine" else (0.0, 0.0, 0.0)}
        return Motor(name, joint, gear, lower, upper, xml.tag, FrozenMapping(gains))
    low, high = _interval(said, "ctrllimited", "ctrlrange", autolimits)
    first, last = sorted((lower / gain, upper / gain))
    return Motor(name, joint, gear * gain, max(low, first), min(high, last))


def _on_many(motor: Motor, said: Element, kind: str, notes: list[str]) -> Motor:
    """The motor of a joint with several velocities: u has an entry for each of them, whatever the gear's axis."""
    axis = " ".join(f"{number:g}" for number in said.some_numbers("gear", 6) or _X_AXIS)
    notes.append(
        f"The actuator '{motor.name}' drives the {kind} joint '{motor.joint}' along one axis (gear {axis}): "
        "here u has an entry for each of that joint's velocities, without gear or bounds."
    )
    return Motor(motor.name, motor.joint, kind=motor.kind, gains=motor.gains)


def _interval(said: Element, switch: str, range_name: str, autolimits: bool) -> tuple[float, float]:
    bounds = said.bounds(switch, range_name, autolimits)
    return (-np.inf, np.inf) if bounds is None else (float(bounds[0]), float(bounds[1]))


def _first(said: Element, name: str, default: float) -> float:
    return (*said.some_numbers(name, 10), default)[0]
