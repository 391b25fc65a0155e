"""The standard part of a URDF: checked, reduced to what ccpin uses, then parsed by yourdfpy."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from ccpin.description.model import JointKind
from ccpin.description.xml import Element, child, label, number, numbers, text_attribute
from ccpin.errors import DescriptionError

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
