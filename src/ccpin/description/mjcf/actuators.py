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
from ccpin.description.elements.xml import XmlElement, label
from ccpin.description.mjcf.defaults import Defaults
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.joints import WorldBody
from ccpin.description.model import Joint, Motor

_X_AXIS = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # MuJoCo's own gear
_TYPES = ("dyntype", "gaintype", "biastype")
_KEPT = ("kp", "ki", "kv", "dampratio")


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
    joints = {joint.name: joint for joint in tree.joints}
    for xml in (xml for section in sections for xml in section.iterchildren("*")):
        said = defaults.actuator(xml)
        joint = said.text("joint") or said.text("jointinparent")
        if joint is None:
            notes.append(f"The actuator {label(xml)} drives no joint; it is left out.")
            continue
        if joint not in tree.reference:
            raise said.fail(f"there is no joint '{joint}'; there are: {', '.join(tree.reference) or 'none'}")
        single = joints[joint].kind in ("revolute", "prismatic")
        ratio = _first(said, "gear", 1.0) if single else 1.0
        motor = _motor(said, joints[joint], ratio, autolimits)
        if motor is None:
            notes.append(f"The actuator {label(xml)} has a gear or a gain of 0 and drives nothing; it is left out.")
            continue
        if not single:
            motor = _on_many(motor, said, joints[joint].kind, notes)
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
                "ccpin.control.Servos plays it, or a law with the gains in mechanism.motors."
            )
    return Actuators(tuple(motors) or None, tuple(motors.values()), armature, damping, notes)


def _motor(said: Element, joint: Joint, gear: float, autolimits: bool) -> Motor | None:
    """One actuator; ``None`` where it moves nothing."""
    gain = _first(said, "gainprm", 1.0)
    bias = (*said.some_numbers("biasprm", 10), 0.0, 0.0, 0.0)[:3]
    activation, gains_as, biased = (said.text(name) or "none" for name in _TYPES)
    plain = activation == "none" and gains_as in ("none", "fixed")
    linear = plain and (biased == "none" or (biased == "affine" and not any(bias)))
    if gear == 0.0 or (linear and gain == 0.0):
        return None
    name = said.text("name") or joint.name
    lower, upper = _interval(said, "forcelimited", "forcerange", autolimits)
    low, high = _interval(said, "ctrllimited", "ctrlrange", autolimits)
    if said.text("inheritrange") and not linear:
        low, high = _inherited(said, joint)
    if not linear:
        gains = {key: said.some_numbers(key, 10) for key in _KEPT if said.text(key)}
        if gains_as in ("none", "fixed") and biased in ("none", "affine"):
            gains |= {"gain": (gain,), "bias": bias if biased == "affine" else (0.0, 0.0, 0.0)}
        if np.isfinite(low):
            gains["inputs"] = (low, high)
        if activation != "none":
            gains |= _dynamics(said, activation)
        return Motor(name, joint.name, gear, lower, upper, str(said.xml.tag), FrozenMapping(gains))
    first, last = sorted((lower / gain, upper / gain))
    return Motor(name, joint.name, gear * gain, max(low, first), min(high, last))


def _dynamics(said: Element, activation: str) -> dict[str, tuple[float, ...]]:
    """The numbers of an actuator's state as MuJoCo's compiler has them; none of one that has no state."""
    if activation == "muscle" and said.xml.tag == "muscle":
        first, second = (*said.some_numbers("timeconst", 2), 0.01, 0.04)[:2] if said.text("timeconst") else (0.01, 0.04)
        return {"dynprm": (first, second, said.number("tausmooth", 0.0))}
    if activation == "dcmotor":
        inductance, te = (*said.some_numbers("inductance", 2), 0.0, 0.0)[:2]
        resistance = said.number("resistance", 0.0)
        electric = inductance / resistance if inductance and resistance else te
        thermal, friction = (*said.some_numbers("thermal", 10), *[0.0] * 3), (*said.some_numbers("lugre", 10), 0.0, 0.0)
        numbers = (electric, 0.0, thermal[0], thermal[2], 0.0, friction[0], friction[1])
        return {"dynprm": numbers} if any(numbers) else {}
    return {"dynprm": said.some_numbers("dynprm", 10) or said.some_numbers("timeconst", 2) or (1.0,)}


def _inherited(said: Element, joint: Joint) -> tuple[float, float]:
    """Bounds of ctrl that `inheritrange` takes from the joint's: about their middle, so many times as wide."""
    share = said.number("inheritrange", 0.0)
    if share <= 0.0 or said.xml.tag == "intvelocity":
        return -np.inf, np.inf
    if said.text("ctrlrange"):
        raise said.fail("give ctrlrange or inheritrange, not both")
    if not np.isfinite(joint.upper - joint.lower):
        raise said.fail(f"inheritrange takes the range of joint '{joint.name}', which has none")
    middle, half = 0.5 * (joint.lower + joint.upper), 0.5 * share * (joint.upper - joint.lower)
    return float(middle - half), float(middle + half)


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
