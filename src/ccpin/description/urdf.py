"""URDF: yourdfpy parses the document, ccpin checks what it lets through, `urdf_closures` reads the loops."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from lxml import etree

from ccpin.arrays import frozen
from ccpin.description.checks import check
from ccpin.description.model import (
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    JointKind,
    Link,
    MechanismDescription,
    Shape,
    Visual,
)
from ccpin.description.urdf_loops import read_marks
from ccpin.description.xml import Element, child, label, number, numbers, parse_xml, text_attribute
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


# The standard part of a URDF: checked, reduced to what ccpin uses, then parsed by yourdfpy.

if TYPE_CHECKING:
    import yourdfpy

JOINT_TYPES: dict[str, JointKind] = {
    "revolute": "revolute",
    "continuous": "continuous",
    "prismatic": "prismatic",
    "fixed": "fixed",
    "floating": "floating",
    "planar": "planar",
    "spherical": "spherical",
    "ball": "spherical",
}
# The elements ccpin uses, by their parent: yourdfpy stumbles over some of the others.
USED = {
    "robot": ("link", "joint", "material"),
    "link": ("inertial", "visual"),
    "inertial": ("origin", "mass", "inertia"),
    "visual": ("origin", "geometry", "material"),
    "geometry": ("box", "cylinder", "sphere", "mesh"),
    "material": ("color",),
    "joint": ("origin", "parent", "child", "axis", "limit", "mimic"),
}
# Every numeric attribute of a URDF (element, attribute) with its number of entries.
NUMERIC = {
    ("origin", "xyz"): 3,
    ("origin", "rpy"): 3,
    ("axis", "xyz"): 3,
    ("mass", "value"): 1,
    **{("inertia", name): 1 for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")},
    **{("limit", name): 1 for name in ("lower", "upper", "effort", "velocity")},
    ("mimic", "multiplier"): 1,
    ("mimic", "offset"): 1,
    ("box", "size"): 3,
    ("cylinder", "radius"): 1,
    ("cylinder", "length"): 1,
    ("sphere", "radius"): 1,
    ("color", "rgba"): 4,
}
EXTENTS = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",), "mesh": ()}


def parse_document(root: Element, source: str | None, notes: list[str]) -> yourdfpy.Robot:
    """Check the standard elements and let yourdfpy read them.

    Visuals that cannot be drawn are left out and noted: a picture never costs the dynamics.

    Raises:
        DescriptionError: Naming the element at fault.
    """
    import yourdfpy

    _check_document(root, source)
    standard = _used(root)
    standard.set("name", root.get("name") or "")
    for visual in list(standard.iterfind("link/visual")):
        trouble = _undrawable(visual, source)
        if trouble is not None:
            link = visual.getparent()
            notes.append(f"link '{link.get('name')}': {trouble}; it is left out of pictures")
            link.remove(visual)
    try:
        document = yourdfpy.URDF.load(
            io.BytesIO(etree.tostring(standard)), build_scene_graph=False, load_meshes=False, mesh_dir=""
        )
    except Exception as error:
        raise DescriptionError(f"yourdfpy cannot read the URDF: {error}", source=source) from error
    return document.robot


def _used(element: Element) -> Element:
    """A copy of the element with the children ccpin uses (names in a namespace are never among them)."""
    copy = etree.Element(element.tag, dict(element.attrib))
    for inner in element:
        if inner.tag in USED.get(element.tag, ()):
            copy.append(_used(inner))
    return copy


def _undrawable(visual: Element, source: str | None) -> str | None:
    """Why a visual cannot be drawn, or ``None``.

    Raises:
        DescriptionError: Its shape lacks a dimension.
    """
    shape = next(iter(child(visual, "geometry", source)), None)
    if shape is None:
        return "a visual is none of " + ", ".join(USED["geometry"])
    if shape.tag == "mesh":
        if not shape.get("filename"):
            return "a visual's mesh has no file name"
        if shape.get("scale") is not None and numbers(shape, "scale", None, source).size not in (1, 3):
            return "a mesh's scale has neither one nor three numbers"
    extents = [numbers(shape, name, NUMERIC[shape.tag, name], source) for name in EXTENTS[shape.tag]]
    return None if all(np.all(extent > 0) for extent in extents) else f"a visual's {shape.tag} has no extent"


def _check_document(root: Element, source: str | None) -> None:
    """Check what yourdfpy would stumble over or silently accept: names, numbers and required children."""
    for element in root.iter():
        own = etree.QName(element).localname
        for attribute in element.attrib:
            count = NUMERIC.get((own, attribute))
            if count is not None:
                numbers(element, attribute, count, source)
    for link in root.findall("link"):
        text_attribute(link, "name", source)
        for inertial in link.findall("inertial"):
            number(child(inertial, "mass", source), "value", source)
            inertia = child(inertial, "inertia", source)
            for name in ("ixx", "iyy", "izz"):
                number(inertia, name, source)
        for visual in link.findall("visual"):
            child(visual, "geometry", source)
    for joint in root.findall("joint"):
        text_attribute(joint, "name", source)
        kind = text_attribute(joint, "type", source)
        if kind not in JOINT_TYPES:
            raise DescriptionError(
                f"type '{kind}' is not one of {', '.join(JOINT_TYPES)}", source=source, element=label(joint)
            )
        for role in ("parent", "child"):
            text_attribute(child(joint, role, source), "link", source)
        for mimic in joint.findall("mimic"):
            if text_attribute(mimic, "joint", source) == joint.get("name"):
                raise DescriptionError("mimics itself", source=source, element=label(joint))
        _check_axis(joint, kind, source)


def _check_axis(joint: Element, kind: str, source: str | None) -> None:
    axis = joint.find("axis")
    if kind in ("revolute", "continuous", "prismatic", "planar") and axis is not None:
        length = np.linalg.norm(numbers(axis, "xyz", 3, source, default="1 0 0"))
        if not 1e-9 < length < 1e9:
            raise DescriptionError("the axis is the zero vector", source=source, element=label(joint))
