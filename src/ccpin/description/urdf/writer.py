"""Writing a description back as URDF: yourdfpy writes links and joints, what closes and moves them is added here."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yourdfpy
from lxml import etree
from trimesh.transformations import euler_from_matrix

from ccpin.description.elements.omissions import left_out, not_written
from ccpin.description.elements.xml import XmlElement, cannot, saved, written
from ccpin.description.model import Coupling, Joint, Link, LoopClosure, MechanismDescription, Visual, frame

_UNDRAWN = ("capsule", "ellipsoid")


def write_urdf(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    """Write a description as a URDF with URDF+ loops, which ccpin reads back as the same mechanism.

    Linear couplings of two joints become mimic joints, springs Gazebo's elements, gears mechanical reductions, poses
    <group_state>s. Gravity, notes, bounds and gains of motors, and shapes URDF has no element for (capsules,
    ellipsoids) are not written. The rotor inertia of a joint without a motor is ``armature`` of its <dynamics>, which
    only ccpin reads.

    Returns:
        What is stated and not written, in sentences.

    Raises:
        DescriptionError: A coupling is not linear in two joints.
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
    for closure in description.closures:
        _loop(root, closure)
    armature = {joint.name: joint.armature for joint in description.joints if joint.armature}
    gears = {motor.joint: motor.gear for motor in description.motors}
    for name in description.actuated or ():
        motor = etree.SubElement(root, "transmission", name=f"{name}_motor")
        etree.SubElement(motor, "joint", name=name)
        actuator = etree.SubElement(motor, "actuator", name=name)
        etree.SubElement(actuator, "rotor_inertia", value=str(armature.pop(name, 0.0)))
        if gears.get(name, 1.0) != 1.0:
            etree.SubElement(actuator, "mechanicalReduction").text = str(gears[name])
    for name, inertia in armature.items():
        dynamics = joints[name].find("dynamics")
        dynamics = etree.SubElement(joints[name], "dynamics") if dynamics is None else dynamics
        dynamics.set("armature", str(inertia))
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
    words = ("gravity", "bounds of motors", "the loops closed around motors", "limits of position on one side")
    undrawn = [link.name for link in description.links for visual in link.visuals if visual.shape.kind in _UNDRAWN]
    return (*left_out(description, "URDF", *words), *not_written("URDF", "capsules and ellipsoids", undrawn))


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


def _loop(root: XmlElement, closure: LoopClosure) -> None:
    """Write a <loop>: both frames as origins, whose z axes (x and y for a universal joint) are the axes."""
    loop = etree.SubElement(root, "loop", name=closure.name, type=closure.kind)
    for role, (link, placement) in zip(("predecessor", "successor"), closure.ends, strict=True):
        end = etree.SubElement(loop, role, link=link)
        etree.SubElement(end, "origin", xyz=written(placement[:3, 3]), rpy=written(euler_from_matrix(placement)))
    universal = closure.kind == "universal"
    etree.SubElement(loop, "axis", xyz="1 0 0" if universal else "0 0 1")
    if universal:
        etree.SubElement(loop, "axis2", xyz="0 1 0")
    if closure.length is not None:
        etree.SubElement(loop, "length", value=str(closure.length))
