"""SDFormat's links: inertias with the format's defaults, and visuals."""

from __future__ import annotations

from typing import cast

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.meshes import find_mesh
from ccpin.description.elements.xml import Colour, XmlElement, fail, source_of
from ccpin.description.model import Inertia, Link, Shape, Visual
from ccpin.description.sdf.values import first, flag, number, numbers, own, placement, text, unread

LINK = (
    *("pose", "inertial", "collision", "visual", "sensor", "projector", "audio_sink", "audio_source", "battery"),
    *("light", "particle_emitter", "gravity", "enable_wind", "self_collide", "kinematic", "must_be_base_link"),
    *("velocity_decay", "plugin", "frame", "damping"),
)
INERTIAL = ("mass", "pose", "inertia", "density", "fluid_added_mass", "auto_inertia_params", "frame", "origin")
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
# The shapes that can be drawn: the elements that state their size, in order.
SIZES: dict[str, tuple[str, ...]] = {
    "box": ("size",),
    "cylinder": ("radius", "length"),
    "sphere": ("radius",),
    "capsule": ("radius", "length"),
    "ellipsoid": ("radii",),
}
_INVISIBLE = ("plane", "heightmap", "image", "polyline", "cone", "empty")


def read_link(element: XmlElement, name: str, notes: list[str]) -> Link:
    """A <link> under its full name.

    Raises:
        DescriptionError: An inertia or a shape is malformed.
    """
    notes += [f"link '{name}': <{stranger}> is not read" for stranger in unread(element, LINK)]
    inertial = first(element, "inertial")
    if inertial is None:
        notes.append(
            f"link '{name}' states no <inertial>: SDFormat's default of 1 kg and 1 kg m² about each axis holds"
        )
        inertia = Inertia(1.0, np.zeros(3), np.eye(3))
    else:
        inertia = _inertia(inertial, name, notes)
    if flag(element, "kinematic", False):
        notes.append(f"link '{name}' is kinematic in the file (moved, not pushed); here forces move it")
    decay = first(element, "velocity_decay")
    if any(number(decay, rate, 0.0) for rate in ("linear", "angular")):
        notes.append(f"link '{name}': its velocity_decay is left out")
    visuals = (_visual(visual, name, notes) for visual in own(element, "visual"))
    return Link(name, inertia, tuple(filter(None, visuals)))


def _inertia(inertial: XmlElement, name: str, notes: list[str]) -> Inertia:
    """Mass, centre and inertia matrix; what is not stated is SDFormat's 1 kg and 1 kg m²."""
    notes += [f"link '{name}': <{stranger}> of its inertial is not read" for stranger in unread(inertial, INERTIAL)]
    if inertial.get("auto", "false").lower() in ("true", "1"):
        raise fail(inertial, "auto inertia is not computed here: state mass and inertia")
    if first(inertial, "fluid_added_mass") is not None:
        notes.append(f"link '{name}': its fluid_added_mass is left out")
    pose, matrix = placement(first(inertial, "pose")), first(inertial, "inertia")
    if matrix is not None:
        unread(matrix, _MOMENTS)
    ixx, ixy, ixz, iyy, iyz, izz = (number(matrix, entry, 1.0 if entry[1] == entry[2] else 0.0) for entry in _MOMENTS)
    turn = pose[:3, :3]
    rotational = turn @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ turn.T
    return Inertia(number(inertial, "mass", 1.0), pose[:3, 3], rotational)


def _visual(visual: XmlElement, link: str, notes: list[str]) -> Visual | None:
    """A <visual>, or a note where it cannot be drawn."""
    geometry = first(visual, "geometry")
    shape = "a visual has no <geometry>" if geometry is None else _shape(geometry, link, notes)
    if isinstance(shape, str):
        notes.append(f"link '{link}': {shape}; it is left out of pictures")
        return None
    diffuse = first(first(visual, "material"), "diffuse")
    return Visual(shape, placement(first(visual, "pose")), Visual.rgba if diffuse is None else _colour(diffuse))


def _colour(diffuse: XmlElement) -> Colour:
    entries = len((diffuse.text or "").split())
    values = numbers(diffuse, 3 if entries == 3 else 4).clip(0.0, 1.0)
    return cast(Colour, (*map(float, values), 1.0)[:4])


def _shape(geometry: XmlElement, link: str, notes: list[str]) -> Shape | str:
    """The shape of a <geometry>, or why it cannot be drawn."""
    found = next(iter(own(geometry, *SIZES, "mesh", *_INVISIBLE)), None)
    if found is None or found.tag in _INVISIBLE:
        return f"a visual is none of {', '.join((*SIZES, 'mesh'))}"
    if found.tag == "mesh":
        return _mesh(found, link, notes)
    parts = SIZES[found.tag]
    if any(first(found, part) is None for part in parts):
        raise fail(found, f"<{'> and <'.join(parts)}> must state its size")
    size: Array = np.concatenate([numbers(first(found, part), 3 if part in ("size", "radii") else 1) for part in parts])
    return Shape(found.tag, tuple(size.tolist())) if size.min() > 0 else f"a visual's {found.tag} has no extent"


def _mesh(mesh: XmlElement, link: str, notes: list[str]) -> Shape | str:
    """A <mesh>; one whose file is absent stays in the description, with a note."""
    uri = text(mesh, "uri")
    if uri is None:
        return "a visual's mesh has no <uri>"
    scale = first(mesh, "scale")
    size = (1.0, 1.0, 1.0) if scale is None else tuple(numbers(scale, 3).tolist())
    found = find_mesh(uri, source_of(mesh))
    if found is None:
        notes.append(f"link '{link}': mesh '{uri}' is not there; it is left out of pictures")
    return Shape("mesh", size, mesh=str(found or uri))
