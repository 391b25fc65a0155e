"""SDFormat's joints as connections of links: their motions one after the other, their frames, what couples them."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.graph import Connection
from ccpin.description.elements.xml import XmlElement, fail, tag, text_attribute
from ccpin.description.model import Coupling, CouplingTerm, Joint
from ccpin.description.sdf.values import first, flag, limit, number, numbers, own, required, text, unread, version

JOINT = (
    *("parent", "child", "pose", "axis", "axis2", "physics", "sensor", "gearbox_ratio", "gearbox_reference_body"),
    *("thread_pitch", "screw_thread_pitch", "plugin"),
)
AXIS = ("xyz", "dynamics", "limit", "mimic", "initial_position", "use_parent_model_frame")
DYNAMICS = ("damping", "friction", "spring_reference", "spring_stiffness")
LIMIT = ("lower", "upper", "effort", "velocity", "stiffness", "dissipation")
DRAKE = ("drake:rotor_inertia", "drake:gear_ratio")
FRAMES = ("parent_frame", "child_frame")
TYPES = ("revolute", "continuous", "prismatic", "ball", "universal", "revolute2", "screw", "gearbox", "fixed")
_SOFT = ("cfm", "erp", "suspension", "max_force", "velocity", "fudge_factor", "bounce")
_Z = np.array([0.0, 0.0, 1.0])  # SDFormat's own axis


class JointFrames(NamedTuple):
    """What a joint reader needs to know of the frames around a joint.

    Attributes:
        joint: The joint's frame (4, 4) in the world, before anything moves.
        pose: The frame (4, 4) of a named frame in the world.
    """

    joint: Array
    pose: Callable[[str], Array]


class Gearbox(NamedTuple):
    """A gearbox: θ₂ = −ratio θ₁, of the parent and of the child about their axes (world), from the reference body."""

    name: str
    element: XmlElement
    parent: str
    child: str
    reference: str
    axis: Array
    axis2: Array
    ratio: float


@dataclass
class Joints:
    """What the joints of a file say, as far as it has been read."""

    connections: list[Connection] = field(default_factory=list)
    gearboxes: list[Gearbox] = field(default_factory=list)
    couplings: list[Coupling] = field(default_factory=list)
    mimics: dict[str, tuple[XmlElement, str, str]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def joint_type(element: XmlElement) -> str:
    """The type of a <joint>.

    Raises:
        DescriptionError: It is none of SDFormat's.
    """
    written = text_attribute(element, "type")
    if written not in TYPES:
        raise fail(element, f"type '{written}' is not one of {', '.join(TYPES)}")
    return written


def read_steps(element: XmlElement, name: str, frames: JointFrames, found: Joints) -> tuple[Joint, ...]:
    """The motions of a <joint> (not of a gearbox), whose full name is given; couplings of a screw go into `found`.

    A universal joint and a revolute2 turn about `axis`, then about `axis2`; a screw turns and slides along `axis`.
    """
    kind = joint_type(element)
    one_axis = kind in ("revolute", "continuous", "prismatic")
    read = {*(DRAKE if one_axis else ()), *(f"drake:{word}" for word in FRAMES)}
    strangers = [word for word in unread(element, JOINT) if word not in read]
    found.notes += [f"joint '{name}': <{stranger}> is not read" for stranger in strangers]
    _note_softness(element, name, found)
    if kind in ("ball", "fixed"):
        if kind == "ball" and first(first(element, "axis"), "dynamics") is not None:
            found.notes.append(
                f"joint '{name}': the <dynamics> of a ball joint are left out: SDFormat gives them no axis"
            )
        return (Joint(name, "spherical" if kind == "ball" else "fixed", "", ""),)
    if kind in ("universal", "revolute2"):
        names = (f"{name}.1", f"{name}.2")
        axes = (
            _step(element, "axis", names[0], "revolute", frames, found),
            _step(element, "axis2", names[1], "revolute", frames, found),
        )
        if np.linalg.norm(np.cross(axes[0].axis, axes[1].axis)) < 1e-9:
            raise fail(element, "the two axes of a universal or revolute2 joint must not be parallel")
        return axes
    if kind == "screw":
        turn = _step(element, "axis", name, "revolute", frames, found)
        slide = Joint(f"{name}.slide", "prismatic", "", "", axis=turn.axis)
        terms = CouplingTerm(slide.name, (0.0, 1.0)), CouplingTerm(name, (0.0, -_lead(element)))
        found.couplings.append(Coupling(f"{name}.thread", terms))
        return turn, slide
    return (replace(_step(element, "axis", name, kind, frames, found), armature=_reflected(element)),)


def _reflected(element: XmlElement) -> float:
    """The rotor's inertia times the gear ratio squared, which Drake adds to joints of one axis."""
    said = {f"{child.prefix}:{tag(child)}": child for child in element.iterchildren("*")}
    rotor, ratio = (
        float(numbers(said[word], 1)[0]) if word in said else k for word, k in zip(DRAKE, (0.0, 1.0), strict=True)
    )
    if rotor < 0:
        raise fail(element, "<drake:rotor_inertia> must not be negative")
    return rotor * ratio * ratio


def _note_softness(element: XmlElement, name: str, found: Joints) -> None:
    engine = first(first(element, "physics"), "ode")
    soft = own(engine, *_SOFT) if engine is not None else []
    if soft:
        left = ", ".join(f"<{part.tag}>" for part in soft)
        found.notes.append(f"joint '{name}': {left} of its <physics> are left out: joints are rigid here")


def _lead(element: XmlElement) -> float:
    """How far a screw slides a radian.

    screw_thread_pitch is in metres a turn and right-handed, thread_pitch in radians a metre and left-handed.
    """
    if first(element, "screw_thread_pitch") is not None:
        return number(element, "screw_thread_pitch", 0.0) / (2 * math.pi)
    pitch = number(element, "thread_pitch", 1.0)
    if not abs(pitch) > 1e-12:
        raise fail(element, "a thread_pitch of zero has no meaning: it is radians a metre")
    return -1.0 / pitch


def _step(element: XmlElement, which: str, name: str, kind: str, frames: JointFrames, found: Joints) -> Joint:
    """The motion along one axis of a joint, with its limits and its own forces."""
    axis = first(element, which)
    if axis is None:
        if which == "axis2":
            raise fail(element, "<axis2> is missing")
        return Joint(name, kind, "", "", axis=_Z)
    strangers = unread(axis, (*AXIS, "lower", "upper"))
    found.notes += [f"joint '{name}': <{stranger}> of its {which} is not read" for stranger in strangers]
    _note_axis(axis, name, found)
    mimic = first(axis, "mimic")
    if mimic is not None:
        found.mimics[name] = (mimic, text_attribute(mimic, "joint"), mimic.get("axis", "axis"))
    bounds, forces = first(axis, "limit"), first(axis, "dynamics")
    for part, known in ((bounds, LIMIT), (forces, DYNAMICS)):
        if part is not None:
            said = unread(part, known)
            found.notes += [f"joint '{name}': <{stranger}> is not read" for stranger in said]
    stray = bounds if own(axis, "lower", "upper") == [] else axis
    lower, upper = limit(stray, "lower", -math.inf), limit(stray, "upper", math.inf)
    if kind == "continuous":
        lower, upper = -math.inf, math.inf
    effort, velocity = (limit(bounds, part, math.inf) for part in ("effort", "velocity"))
    return Joint(
        name=name,
        kind=kind,
        parent="",
        child="",
        axis=direction(axis, frames),
        lower=lower,
        upper=upper,
        effort=effort if effort >= 0 else math.inf,
        velocity=velocity if velocity >= 0 else math.inf,
        damping=number(forces, "damping", 0.0),
        friction=number(forces, "friction", 0.0),
        stiffness=number(forces, "spring_stiffness", 0.0),
        spring_reference=number(forces, "spring_reference", 0.0),
    )


def _note_axis(axis: XmlElement, name: str, found: Joints) -> None:
    if own(axis, "lower", "upper"):
        found.notes.append(f"joint '{name}': its limits stand outside <limit>; they are read as such")
    if number(axis, "initial_position", 0.0) != 0.0:
        found.notes.append(f"joint '{name}': its initial_position is not read; the pose drawn is the zero pose")


def direction(axis: XmlElement, frames: JointFrames) -> Array:
    """The unit vector of an axis in the joint's frame.

    It is stated in the joint's frame, in the one `expressed_in` names, or, in files up to version 1.4 and where
    `use_parent_model_frame` says so, in the model's.
    """
    xyz = first(axis, "xyz")
    vector = _Z if xyz is None else numbers(xyz, 3)
    length = math.hypot(*vector)
    if not 1e-9 < length < 1e9:
        raise fail(axis, "the axis is the zero vector")
    named = None if xyz is None else xyz.get("expressed_in")
    if not named and flag(axis, "use_parent_model_frame", version(axis) <= (1, 4)):
        named = "__model__"
    turned = vector / length
    if named:
        turned = frames.joint[:3, :3].T @ frames.pose(named)[:3, :3] @ turned
    return turned / np.linalg.norm(turned)


def mimic_coupling(name: str, said: tuple[XmlElement, str, str], steps: Collection[str]) -> Coupling:
    """θ = multiplier (θ_leader − reference) + offset of an axis, whose <mimic>, leader and leader's axis are given."""
    mimic, leader, axis = said
    prefix = name.rpartition("::")[0]
    whole = f"{prefix}::{leader}" if prefix and leader not in steps else leader
    chosen = next((n for n in (whole, f"{whole}.{2 if axis == 'axis2' else 1}") if n in steps), None)
    if chosen is None:
        raise fail(mimic, f"there is no joint '{leader}' with an {axis}")
    if chosen == name:
        raise fail(mimic, "the joint mimics itself")
    ratio, offset = number(mimic, "multiplier", 1.0), number(mimic, "offset", 0.0)
    terms = CouplingTerm(name, (-offset, 1.0)), CouplingTerm(chosen, (0.0, -ratio), number(mimic, "reference", 0.0))
    return Coupling(f"mimic_{name}", terms)


def read_gearbox(
    element: XmlElement, name: str, ends: tuple[str, str, str], frames: JointFrames, notes: list[str]
) -> Gearbox:
    """A gearbox between two links that turn in a third; `ends` are parent, child and reference link."""
    said = first(element, "axis"), first(element, "axis2")
    if said[0] is None:
        raise fail(element, "<axis> is missing")
    if said[1] is None:
        notes.append(f"gearbox '{name}' states no <axis2>: both angles are taken about its <axis>")
    axes = [frames.joint[:3, :3] @ direction(said[0] if axis is None else axis, frames) for axis in said]
    ratio = number(element, "gearbox_ratio", 1.0)
    return Gearbox(name, element, *ends, axes[0], axes[1], ratio)


def reference_body(element: XmlElement) -> str:
    """The name a gearbox's angles are measured from."""
    if text(element, "gearbox_reference_body") is None:
        raise fail(element, "<gearbox_reference_body> is missing: the angles of a gearbox are measured from it")
    return required(element, "gearbox_reference_body")


def cut(element: XmlElement) -> bool:
    """Whether the file wants this joint cut (physics/simbody/must_be_loop_joint)."""
    return flag(first(first(element, "physics"), "simbody"), "must_be_loop_joint", False)
