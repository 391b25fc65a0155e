"""Elements of SDFormat that stand alone: poses, axes with limits and forces, visuals."""

from __future__ import annotations

import numpy as np
from lxml import etree
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.description.elements.xml import XmlElement, written
from ccpin.description.model import Joint, Visual
from ccpin.description.sdf.links import SIZES

_FORCES = {
    "damping": "damping",
    "friction": "friction",
    "spring_reference": "spring_reference",
    "stiffness": "spring_stiffness",
}


def add_axis(joint_element: XmlElement, joint: Joint) -> None:
    """The axis of a joint with one displacement, its limits and its forces."""
    axis = etree.SubElement(joint_element, "axis")
    say(axis, "xyz", joint.axis)
    bounds = {name: getattr(joint, name) for name in ("lower", "upper", "effort", "velocity")}
    bounds = {name: value for name, value in bounds.items() if np.isfinite(value)}
    forces = {word: getattr(joint, field) for field, word in _FORCES.items() if getattr(joint, field)}
    for part, said in (("limit", bounds), ("dynamics", forces)):
        if said:
            element = etree.SubElement(axis, part)
            for name, value in said.items():
                say(element, name, value)


def add_visual(link: XmlElement, visual: Visual, name: str) -> None:
    """A shape that is seen."""
    element = etree.SubElement(link, "visual", name=name)
    add_pose(element, visual.placement)
    shape = visual.shape
    drawn = etree.SubElement(etree.SubElement(element, "geometry"), shape.kind)
    if shape.kind == "mesh":
        etree.SubElement(drawn, "uri").text = shape.mesh
        say(drawn, "scale", shape.size)
    else:
        parts = SIZES[shape.kind]
        for part, size in zip(parts, np.split(np.array(shape.size), len(parts)), strict=True):
            say(drawn, part, size)
    say(etree.SubElement(element, "material"), "diffuse", visual.rgba)


def say(above: XmlElement, name: str, values: object) -> None:
    """A child element whose text is a number or numbers."""
    etree.SubElement(above, name).text = written(values)


def add_pose(above: XmlElement, placement: Array, relative_to: str | None = None) -> None:
    """A <pose>, as a quaternion where it turns: angles lose digits near ±90° of pitch."""
    turned = not np.array_equal(placement[:3, :3], np.eye(3))
    if not turned and not np.any(placement[:3, 3]) and relative_to is None:
        return
    said = {} if relative_to is None else {"relative_to": relative_to}
    if turned:
        said["rotation_format"] = "quat_xyzw"
    angles = Rotation.from_matrix(placement[:3, :3]).as_quat() if turned else np.zeros(3)
    etree.SubElement(above, "pose", said).text = written([*placement[:3, 3], *angles])
