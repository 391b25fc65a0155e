"""The words of a URDF: which elements and attributes stand where, and which of them bear on the mechanism.

What is not known is named in a note, with the nearest known word, once for each place it stands in. Where that nearest
word bears on the mechanism the file is refused: dropped, a misspelt ``<limits>`` or ``<orign>`` would be another
mechanism without a word. Elements with a prefix of their own, and what stands inside ``<gazebo>``, ``<ros2_control>``
and sensors, belong to others and are theirs to check.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from typing import NamedTuple

from ccpin.description.elements.xml import XmlElement, doubled, fail, tag
from ccpin.description.names import meant


class Words(NamedTuple):
    """What may stand in an element.

    Attributes:
        bearing: Child elements that bear on the mechanism.
        idle: Child elements that do not (pictures, contact, what other programs ask).
        attributes: Its attributes, all of which bear on it where the element does.
    """

    bearing: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()
    attributes: tuple[str, ...] = ()


_MATERIAL = Words((), ("color", "texture"), ("name",))
_GEOMETRY = Words((), ("box", "cylinder", "sphere", "mesh", "capsule", "ellipsoid", "plane", "convex", "cone"), ())
_SHOWN = Words(
    (), ("origin", "geometry", "material", "contact_coefficients", "verbose", "map", "cast_shadows"), ("name", "group")
)
_REDUCTIONS = ("mechanicalReduction", "mechanical_reduction")
_LOOPS = ("loop", "loop_joint", "constraint", "coupling", "ball_constraint", "distance_constraint")

BELOW_ROOT = Words(
    ("link", "joint", "transmission", "ros2_control", "group_state", "gravity", *_LOOPS),
    (
        *("material", "gazebo", "group", "end_effector", "virtual_joint", "passive_joint", "disable_collisions"),
        *("collision_filter_group", "ignore_self_collision", "sensor"),
    ),
    ("name", "version"),
)
WITHIN: dict[str, Words] = {
    "link": Words(
        ("inertial",),
        ("visual", "collision", "sensor", "contact", "self_collision_checking", "verbose", "audio_source", "gravity"),
        ("name", "type", "concave", "independent"),
    ),
    "inertial": Words(("origin", "mass", "inertia"), ("verbose",), ("name",)),
    "joint": Words(
        ("origin", "parent", "child", "axis", "limit", "dynamics", "mimic", "joint_properties"),
        (
            *("calibration", "safety_controller", "hardwareInterface", "verbose", "offset", "screw_thread_pitch"),
            *("actuator", "controller", "initial_position"),
        ),
        ("name", "type", "independent"),
    ),
    "transmission": Words(
        ("joint", "actuator", "type", "plugin", *_REDUCTIONS),
        (
            *("leftActuator", "rightActuator", "motorTorqueConstant", "use_simulated_gripper_joint", "gap_joint"),
            *("flexJoint", "rollJoint", "passive_joint", "simulated_actuated_joint", "pulsesPerRevolution"),
        ),
        ("name", "type"),
    ),
    "transmission/joint": Words(_REDUCTIONS, ("hardwareInterface", "offset", "role", "state_filter"), ("name", "role")),
    "actuator": Words(
        (*_REDUCTIONS, "rotor_inertia", "gear_ratio"),
        ("hardwareInterface", "motorTorqueConstant", "offset", "role", "encoder", "efficiency"),
        ("name", "role"),
    ),
    "robot/gravity": Words((), (), ("xyz",)),
    "parent": Words((), (), ("link",)),
    "child": Words((), (), ("link",)),
    "origin": Words((), (), ("xyz", "rpy")),
    "axis": Words((), (), ("xyz",)),
    "mass": Words((), (), ("value",)),
    "inertia": Words((), (), ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
    "limit": Words((), (), ("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk")),
    "mimic": Words((), (), ("joint", "multiplier", "offset")),
    "visual": _SHOWN,
    "collision": _SHOWN,
    "geometry": _GEOMETRY,
    "material": _MATERIAL,
}
_REPEATED = frozenset(
    {
        *(word for word in BELOW_ROOT.bearing if word != "gravity"),
        *BELOW_ROOT.idle,
        *("visual", "collision", "actuator", "mechanicalReduction", "hardwareInterface"),
        *("coupling/predecessor", "coupling/successor"),
        *("param", "command_interface", "state_interface", "gpio", "plugin", "chain", "subgroup", "contact"),
    }
)
_OTHERS = frozenset({"visual", "collision", "sensor", "material", "plugin"})
_PICTURES = frozenset({"visual", "collision", "geometry", "material"})


def check_words(root: XmlElement, notes: list[str]) -> None:
    """Note every element and attribute that is not known, below a <robot>.

    Raises:
        DescriptionError: One is nearly the name of one that bears on the mechanism, and is missing there.
    """
    notes += doubled(root, _REPEATED, _OTHERS)
    found: Counter[str] = Counter()
    _check(root, BELOW_ROOT, "robot", found, bears=True)
    for said, count in found.items():
        notes.append(said + (f" ({count} of it)" if count > 1 else ""))


def _check(element: XmlElement, words: Words, name: str, found: Counter[str], bears: bool) -> None:
    for attribute in element.attrib:
        if not attribute.startswith("{") and attribute not in words.attributes:
            absent = [word for word in words.attributes if word not in element.attrib]
            _strange(element, f"{attribute} of <{name}>", attribute, absent if bears else [], absent, found)
    for inner in element.iterchildren("*"):
        known = tag(inner)
        if inner.prefix and known not in words.bearing:
            found[f"<{inner.prefix}:{known}> in <{name}> is not read"] += 1
        elif known not in (*words.bearing, *words.idle):
            every = (*words.bearing, *words.idle)
            _strange(inner, f"<{known}> in <{name}>", known, words.bearing if bears else (), every, found)
        elif (within := WITHIN.get(f"{name}/{known}", WITHIN.get(known))) is not None:
            _check(inner, within, known, found, bears and known not in _PICTURES)


def _strange(
    element: XmlElement, said: str, word: str, bearing: Collection[str], known: Collection[str], found: Counter[str]
) -> None:
    """An unknown word: an error where it is nearly one that bears on the mechanism, else counted for a note."""
    near = meant(word, known)
    if near in bearing:
        raise fail(element, f"'{word}' does not exist here; did you mean '{near}'?")
    found[f"{said} is not read" + (f"; did you mean '{near}'?" if near else "")] += 1
