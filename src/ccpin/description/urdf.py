"""URDF: yourdfpy parses the document, ccpin checks what it lets through, `urdf_closures` reads the loops."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from ccpin.description.checks import check
from ccpin.description.model import (
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    Link,
    MechanismDescription,
    Shape,
    Visual,
    frozen,
)
from ccpin.description.urdf_closures import read_marks
from ccpin.description.urdf_document import JOINT_TYPES, parse_document
from ccpin.description.xml import parse_xml
from ccpin.errors import DescriptionError

DEFAULT_COLOUR = (0.62, 0.66, 0.70, 1.0)


def read_urdf(text: bytes, source: str | None) -> MechanismDescription:
    """Read a URDF with its loop elements (URDF+, Isaac Sim, Drake) into a plain description.

    Args:
        text: The file's content.
        source: Its path, for messages and for finding meshes.

    Raises:
        InvalidXmlError, DescriptionError: Naming the element at fault.
    """
    root = parse_xml(text, source)
    if root.tag != "robot":
        raise DescriptionError("the root element of a URDF is <robot>", source=source, element=f"<{root.tag}>")
    notes: list[str] = []
    robot = parse_document(root, source, notes)
    joints = [_joint(joint, source, notes) for joint in robot.joints]
    marks = read_marks(root, joints, source)
    joints = [replace(joint, armature=marks.armature.get(joint.name, 0.0)) for joint in joints]
    colours = {m.name: m.color.rgba for m in robot.materials if m.name and m.color is not None}
    links = tuple(_link(link, colours, source, notes) for link in robot.links)
    children_ = {joint.child for joint in joints}
    roots = [link.name for link in links if link.name not in children_]
    if not links:
        raise DescriptionError("the file declares no link", source=source)
    return check(
        MechanismDescription(
            name=robot.name or (Path(source).stem if source else "mechanism"),
            root=roots[0] if roots else links[0].name,
            links=links,
            joints=tuple(joints),
            closures=marks.closures,
            couplings=marks.couplings + tuple(_mimics(robot.joints)),
            independent=marks.independent,
            independent_is_default=marks.independent_is_default,
            dependent_hint=marks.dependent_hint + tuple(j.name for j in robot.joints if j.mimic is not None),
            actuated=marks.actuated,
            reference=marks.reference,
            source=source,
            notes=marks.notes + tuple(notes),
        )
    )


def _joint(joint: Any, source: str | None, notes: list[str]) -> Joint:
    kind = JOINT_TYPES[joint.type]
    lower, upper = -np.inf, np.inf
    effort = velocity = np.inf
    if joint.limit is not None:
        effort = np.inf if joint.limit.effort is None else float(joint.limit.effort)
        velocity = np.inf if joint.limit.velocity is None else float(joint.limit.velocity)
        if kind in ("revolute", "prismatic"):
            if joint.limit.lower is None and joint.limit.upper is None:
                notes.append(f"joint '{joint.name}' states no lower and upper limit: taken as unlimited")
            else:
                lower, upper = float(joint.limit.lower or 0.0), float(joint.limit.upper or 0.0)
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, dtype=np.float64)
    norm = np.linalg.norm(axis)
    return Joint(
        name=joint.name,
        kind=kind,
        parent=joint.parent,
        child=joint.child,
        placement=_origin(joint.origin),
        axis=frozen(axis / norm if norm > 0 else [1.0, 0.0, 0.0]),
        lower=lower,
        upper=upper,
        effort=effort,
        velocity=velocity,
    )


def _origin(matrix: Any) -> Any:
    return frozen(np.eye(4) if matrix is None else matrix)


def _link(link: Any, colours: dict[str, Any], source: str | None, notes: list[str]) -> Link:
    inertia = None
    if link.inertial is not None:
        placement = _origin(link.inertial.origin)
        rotation = placement[:3, :3]
        inertia = Inertia(
            mass=float(link.inertial.mass),
            com=frozen(placement[:3, 3]),
            rotational=frozen(rotation @ np.asarray(link.inertial.inertia) @ rotation.T),
        )
    visuals = (_visual(visual, colours, link.name, source, notes) for visual in link.visuals)
    return Link(name=link.name, inertia=inertia, visuals=tuple(visuals))


def _visual(visual: Any, colours: dict[str, Any], link: str, source: str | None, notes: list[str]) -> Visual:
    shape = _shape(visual.geometry, link, source, notes)
    colour = None
    if visual.material is not None:
        colour = visual.material.color.rgba if visual.material.color is not None else colours.get(visual.material.name)
    rgba = DEFAULT_COLOUR if colour is None else tuple(float(c) for c in colour)
    return Visual(shape=shape, placement=_origin(visual.origin), rgba=cast("tuple[float, float, float, float]", rgba))


def _shape(geometry: Any, link: str, source: str | None, notes: list[str]) -> Shape:
    if geometry.box is not None:
        return Shape("box", tuple(float(x) for x in geometry.box.size))
    if geometry.cylinder is not None:
        return Shape("cylinder", (float(geometry.cylinder.radius), float(geometry.cylinder.length)))
    if geometry.sphere is not None:
        return Shape("sphere", (float(geometry.sphere.radius),))
    scale = np.broadcast_to(1.0 if geometry.mesh.scale is None else geometry.mesh.scale, 3)
    found = find_mesh(geometry.mesh.filename, source)
    if found is None:
        notes.append(f"link '{link}': mesh '{geometry.mesh.filename}' is not there; it is left out of pictures")
    return Shape("mesh", tuple(float(s) for s in scale), mesh=str(found or geometry.mesh.filename))


def find_mesh(name: str, source: str | None) -> Path | None:
    """Resolve a mesh's file name (plain, ``file://`` or ``package://``) next to and above the source file."""
    if not name or "\0" in name or source is None:
        return None
    folder = Path(source).parent
    plain = name.split("://", 1)[-1].lstrip("/") if "://" in name else name
    candidates = [Path(name.removeprefix("file://"))] if name.startswith(("/", "file:///")) else []
    candidates += [base / plain for base in (folder, *folder.resolve().parents[:4])]
    try:
        return next((path.resolve() for path in candidates if path.is_file()), None)
    except OSError:
        return None


def _mimics(joints: list[Any]) -> list[Coupling]:
    """A mimic joint is the coupling θ − multiplier·θ_master − offset = 0."""
    return [
        Coupling(
            name=f"mimic_{joint.name}",
            terms=(
                CouplingTerm(joint.name, (0.0, 1.0)),
                CouplingTerm(
                    joint.mimic.joint,
                    (
                        -float(joint.mimic.offset or 0.0),
                        -float(1.0 if joint.mimic.multiplier is None else joint.mimic.multiplier),
                    ),
                ),
            ),
        )
        for joint in joints
        if joint.mimic is not None
    ]
