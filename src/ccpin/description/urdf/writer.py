"""Writing a description back as URDF: yourdfpy writes links and joints, what closes and moves them is added here."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import yourdfpy
from lxml import etree

from ccpin.arrays import Array
from ccpin.description.elements.omissions import left_out, not_written
from ccpin.description.elements.xml import XmlElement, cannot, saved, written
from ccpin.description.model import (
    IDENTITY,
    Coupling,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Motor,
    Visual,
    frame,
)

EARTH = (0.0, 0.0, -9.81)  # m/s², gravity where a file states none
_DRAKE = "http://drake.mit.edu"
_UNDRAWN = ("capsule", "ellipsoid")
_OWN = ("armature", "breakaway", "stribeck_speed")  # attributes of <dynamics> that ccpin alone reads


def write_urdf(description: MechanismDescription, path: str | Path, loops: str = "plus") -> tuple[str, ...]:
    """Write a description as a URDF whose loops are URDF+'s, or others', which ccpin reads back as the same mechanism.

    Linear couplings of two joints become mimic joints, springs Gazebo's elements, gears mechanical reductions, poses
    <group_state>s. Notes, bounds and gains of motors, and shapes URDF has no element for (capsules, ellipsoids) are not
    written. The rotor inertia of a joint without a motor is ``armature`` of its <dynamics>, a Stribeck effect
    ``breakaway`` and ``stribeck_speed``, gravity other than the Earth's along −z a <gravity> below <robot>: all are
    read by ccpin alone.

    Args:
        description: What to write.
        path: The file.
        loops: A dialect of `CLOSING`: ``"plus"``, ``"drake"`` or ``"isaac"``.

    Returns:
        What is stated and not written, in sentences.

    Raises:
        DescriptionError: A coupling is not linear in two joints, or the dialect has no words for a closure.
        InvalidInputError: The file cannot be written.
    """
    root = urdf_document(description).write_xml().getroot()
    joints = {element.get("name"): element for element in root.iterfind("joint")}
    for joint in description.joints:
        if description.independent is not None and joint.kind != "fixed":
            marked = joint.name in description.independent
            if not (marked and description.independent_is_default):
                joints[joint.name].set("independent", str(marked).lower())
    for coupling in description.couplings:
        _mimic(joints, coupling, description)
    for joint in description.joints:
        _place(joints[joint.name], joint.placement)
    for closure in description.closures:
        CLOSING[loops](root, closure, description)
    if description.gravity != EARTH:
        etree.SubElement(root, "gravity", xyz=written(description.gravity))
    own = {
        joint.name: {word: getattr(joint, word) for word in _OWN if getattr(joint, word)}
        for joint in description.joints
    }
    motors = {motor.joint: motor for motor in description.motors}
    for name in description.actuated or ():
        stated = motors.get(name, Motor(name, name))
        drive = etree.SubElement(root, "transmission", name=f"{name}_motor")
        etree.SubElement(drive, "joint", name=name)
        actuator = etree.SubElement(drive, "actuator", name=stated.name)
        etree.SubElement(actuator, "rotor_inertia", value=str(own.get(name, {}).pop("armature", 0.0)))
        if stated.gear != 1.0:
            etree.SubElement(actuator, "mechanicalReduction").text = str(stated.gear)
    for name, ours in own.items():
        dynamics = joints[name].find("dynamics")
        if dynamics is None and ours:  # other readers refuse one that says neither
            dynamics = etree.SubElement(joints[name], "dynamics", damping="0.0", friction="0.0")
        for word, value in ours.items():
            dynamics.set(word, str(value))
    for joint in description.joints:
        if joint.stiffness:
            spring = etree.SubElement(root, "gazebo", reference=joint.name)
            etree.SubElement(spring, "springStiffness").text = str(joint.stiffness)
            etree.SubElement(spring, "springReference").text = str(joint.spring_reference)
    poses = description.named_poses
    for name, pose in poses.items() if any(poses.values()) else ():
        state = etree.SubElement(root, "group_state", name=name)
        for joint_name, values in pose.items():
            etree.SubElement(state, "joint", name=joint_name, value=written(values))
    saved(root, path)
    words = ("bounds of motors", "the loops closed around motors", "limits of position on one side")
    undrawn = [link.name for link in description.links for visual in link.visuals if visual.shape.kind in _UNDRAWN]
    kept = left_out(description, "URDF", *words, "what the file tells MuJoCo's solver")
    return (*kept, *not_written("URDF", "capsules and ellipsoids", undrawn))


def urdf_document(description: MechanismDescription) -> yourdfpy.URDF:
    """The tree as a yourdfpy document: links with inertia and visuals, joints with axis and limits."""
    robot = yourdfpy.Robot(
        description.name,
        links=[_link(link) for link in description.links],
        joints=[_joint(joint) for joint in description.joints],
    )
    return yourdfpy.URDF(
        robot, build_scene_graph=False, load_meshes=False, filename_handler=yourdfpy.filename_handler_null
    )


def _link(link: Link) -> yourdfpy.Link:
    inertial = None
    if link.inertia is not None:
        inertial = yourdfpy.Inertial(frame(link.inertia.com), link.inertia.mass, link.inertia.rotational)
    visuals = [_visual(visual) for visual in link.visuals if visual.shape.kind not in _UNDRAWN]
    return yourdfpy.Link(link.name, inertial, visuals)


def _visual(visual: Visual) -> yourdfpy.Visual:
    shape = visual.shape
    geometry = yourdfpy.Geometry()
    if shape.kind == "box":
        geometry.box = yourdfpy.Box(np.array(shape.size))
    elif shape.kind == "cylinder":
        geometry.cylinder = yourdfpy.Cylinder(*shape.size)
    elif shape.kind == "sphere":
        geometry.sphere = yourdfpy.Sphere(*shape.size)
    else:
        geometry.mesh = yourdfpy.Mesh(shape.mesh, np.array(shape.size))
    named = "_".join(f"{part:g}" for part in visual.rgba)  # ROS and Pinocchio read no material without a name
    material = yourdfpy.Material(name=f"rgba_{named}", color=yourdfpy.Color(np.array(visual.rgba)))
    return yourdfpy.Visual(origin=visual.placement, geometry=geometry, material=material)


def _joint(joint: Joint) -> yourdfpy.Joint:
    stated = {name: getattr(joint, name) for name in ("effort", "velocity", "lower", "upper")}
    limit = yourdfpy.Limit(**{name: value if np.isfinite(value) else None for name, value in stated.items()})
    return yourdfpy.Joint(
        joint.name,
        joint.kind,
        parent=joint.parent,
        child=joint.child,
        origin=joint.placement,
        axis=joint.axis,
        limit=limit if any(map(np.isfinite, stated.values())) else None,
        dynamics=yourdfpy.Dynamics(joint.damping, joint.friction) if joint.damping or joint.friction else None,
    )


def _mimic(joints: dict[str, XmlElement], coupling: Coupling, description: MechanismDescription) -> None:
    """Write c₀ + c₁ θ + k₁ θ_master = 0 as θ = multiplier θ_master + offset."""
    powers = {term.joint: (*term.coefficients, 0.0, 0.0) for term in coupling.terms}
    free = [term for term in coupling.terms if powers[term.joint][1] and joints[term.joint].find("mimic") is None]
    curved = any(term.reference or any(powers[term.joint][2:]) for term in coupling.terms)
    if len(coupling.terms) != 2 or len(powers) != 2 or curved or not free:
        message = "URDF couples two joints linearly only, and a joint to one other (mimic)"
        raise cannot(description, f"coupling '{coupling.name}'", message)
    dependent = min(free, key=lambda term: term.joint not in description.dependent_hint)
    (master,) = (term for term in coupling.terms if term is not dependent)
    own, other = powers[dependent.joint], powers[master.joint]
    multiplier, offset = -other[1] / own[1], -(own[0] + other[0]) / own[1]
    attributes = {"joint": master.joint, "multiplier": str(multiplier), "offset": str(offset)}
    etree.SubElement(joints[dependent.joint], "mimic", attributes)


def _place(above: XmlElement, placement: Array) -> None:
    """An <origin>, in place of one that is there."""
    for old in above.findall("origin"):
        above.remove(old)
    above.insert(0, etree.Element("origin", **_origin(placement)))


def _origin(placement: Array) -> dict[str, str]:
    """xyz and rpy, whose digits are those of the rotation also where pitch is a right angle.

    Of R = R_z(yaw) R_y(pitch) R_x(roll) the yaw is read off the first column, however short its part in the plane is,
    and the roll off the middle row of R_z(−yaw) R, which is (0, cos, −sin): whatever the yaw, the three make R.
    """
    turn = placement[:3, :3]
    yaw = math.atan2(turn[1, 0], turn[0, 0])
    s, c = math.sin(yaw), math.cos(yaw)
    pitch = math.atan2(-turn[2, 0], c * turn[0, 0] + s * turn[1, 0])
    across = c * turn[1] - s * turn[0]
    return {"xyz": written(placement[:3, 3]), "rpy": written([math.atan2(-across[2], across[1]), pitch, yaw])}


def _plus(root: XmlElement, closure: LoopClosure, _: MechanismDescription) -> None:
    """Write a <loop>: both frames as origins, whose z axes (x and y for a universal joint) are the axes."""
    loop = etree.SubElement(root, "loop", name=closure.name, type=closure.kind)
    for role, (link, placement) in zip(("predecessor", "successor"), closure.ends, strict=True):
        _place(etree.SubElement(loop, role, link=link), placement)
    universal = closure.kind == "universal"
    etree.SubElement(loop, "axis", xyz="1 0 0" if universal else "0 0 1")
    if universal:
        etree.SubElement(loop, "axis2", xyz="0 1 0")
    if closure.length is not None:
        etree.SubElement(loop, "length", value=str(closure.length))


def _isaac(root: XmlElement, closure: LoopClosure, description: MechanismDescription) -> None:
    """Isaac Sim's <loop_joint>, which states two frames and no axis: a ball, a weld, or two balls on a hinge's axis."""
    kinds = ("spherical", "fixed", "revolute")
    for name, kind, along in _points(closure, description, "Isaac Sim's loops", kinds):
        loop = etree.SubElement(root, "loop_joint", name=name, type=kind)
        for number, (link, placement) in enumerate(closure.ends, start=1):
            etree.SubElement(loop, f"link{number}", link=link, **_origin(placement @ along))


def _drake(root: XmlElement, closure: LoopClosure, description: MechanismDescription) -> None:
    """Drake's constraints of points: a ball, two of them on a hinge's axis, a distance."""
    kinds = ("spherical", "revolute", "distance")
    for name, kind, along in _points(closure, description, "Drake's URDFs", kinds):
        word = f"{{{_DRAKE}}}{'distance' if kind == 'distance' else 'ball'}_constraint"
        element = etree.SubElement(root, word, name=name, nsmap={"drake": _DRAKE})
        for (side, point), (link, placement) in zip((("A", "AP"), ("B", "BQ")), closure.ends, strict=True):
            etree.SubElement(element, f"{word}_body_{side}", name=link)
            etree.SubElement(element, f"{word}_p_{point}", value=written((placement @ along)[:3, 3]))
        if closure.length is not None:
            etree.SubElement(element, f"{word}_distance", value=written(closure.length))


def _points(
    closure: LoopClosure, description: MechanismDescription, whose: str, kinds: tuple[str, ...]
) -> list[tuple[str, str, Array]]:
    """Names, kinds and frames in the closure's own of what asks for what it asks for.

    Raises:
        DescriptionError: It is of none of these kinds.
    """
    if closure.kind not in kinds:
        raise cannot(description, f"closure '{closure.name}'", f"{whose} have no {closure.kind} closure")
    if closure.kind != "revolute":
        return [(closure.name, closure.kind, IDENTITY)]
    ahead = frame([0.0, 0.0, description.size])
    return [(closure.name, "spherical", IDENTITY), (f"{closure.name}_axis", "spherical", ahead)]


CLOSING: dict[str, Callable[[XmlElement, LoopClosure, MechanismDescription], None]] = {
    "plus": _plus,
    "drake": _drake,
    "isaac": _isaac,
}
"""How each dialect states a loop."""
