"""URDF: links and joints with their numbers checked; `dialects` reads what is added to them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from ccpin.description.checks import check
from ccpin.description.elements.meshes import find_mesh
from ccpin.description.elements.xml import (
    Colour,
    XmlElement,
    child,
    fail,
    label,
    numeric_attributes,
    origin,
    source_of,
    text_attribute,
)
from ccpin.description.joint_kinds import FIXED, JOINT_KINDS
from ccpin.description.model import (
    X_AXIS,
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    Link,
    MechanismDescription,
    Shape,
    Visual,
)
from ccpin.description.urdf.dialects import marked_independent, read_marks
from ccpin.description.urdf.joint_forces import DYNAMICS, read_drive, read_dynamics, with_forces
from ccpin.description.urdf.spanning import extension_joints, onshape_closures, read_graph
from ccpin.description.urdf.words import check_words
from ccpin.errors import DescriptionError

SYNONYMS = {"ball": "spherical"}
# Every numeric attribute of a URDF's elements with its number of entries; checked wherever the element stands.
NUMERIC: dict[str, dict[str, int]] = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": {"ixx": 1, "ixy": 1, "ixz": 1, "iyy": 1, "iyz": 1, "izz": 1},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": DYNAMICS,
    "mimic": {"multiplier": 1, "offset": 1},
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "color": {"rgba": 4},
}
SHAPES = ("box", "cylinder", "sphere", "mesh")
WHITE: Colour = (1.0, 1.0, 1.0, 1.0)  # of a <color> without rgba


def urdf_description(root: XmlElement) -> MechanismDescription:
    """Read a parsed URDF with its loop elements (URDF+, Isaac Sim, Drake) into a plain description.

    Raises:
        DescriptionError: Naming the element at fault.
    """
    source = source_of(root)
    if root.tag != "robot":
        raise DescriptionError("the root element of a URDF is <robot>", source=source, element=f"<{root.tag}>")
    reader = _TreeReader(root)
    check_words(root, reader.notes)
    joints = [reader.joint(element) for element in root.iterfind("joint")]
    links = tuple(reader.link(element) for element in root.iterfind("link"))
    if not links:
        raise DescriptionError("the file declares no link", source=source)
    drive = read_drive(root, {joint.name: joint.kind for joint in joints} | extension_joints(root))
    followers = [mimic for element in root.iterfind("joint") for mimic in reader.mimics(element)[:1]]
    kept = {term.joint for mimic in followers for term in mimic.terms} | {motor.joint for motor in drive.motors}
    forceful = [with_forces(joint, drive) for joint in joints]
    graph = read_graph(root, links, forceful, kept | marked_independent(root))
    marks = read_marks(root, graph.joints)
    mimics = _of_movable(followers, graph.joints, reader.notes)
    frames = onshape_closures(graph, (*marks.closures, *graph.closures), reader.notes)
    children = {joint.child for joint in graph.joints}
    return check(
        MechanismDescription(
            name=root.get("name") or (Path(source).stem if source else "mechanism"),
            root=next((link.name for link in links if link.name not in children), links[0].name),
            links=links + graph.links,
            joints=graph.joints,
            closures=(*marks.closures, *graph.closures, *frames),
            couplings=(*marks.couplings, *mimics, *graph.couplings),
            independent=marks.independent,
            independent_is_default=marks.independent_is_default,
            dependent_hint=marks.dependent_hint + tuple(c.terms[0].joint for c in (*mimics, *graph.couplings)),
            actuated=drive.actuated,
            motors=drive.motors,
            reference=marks.reference,
            poses=marks.poses,
            gravity=marks.gravity,
            source=source,
            notes=(*reader.notes, *drive.notes, *marks.notes, *graph.notes),
        )
    )


def _of_movable(mimics: Sequence[Coupling], joints: Sequence[Joint], notes: list[str]) -> list[Coupling]:
    """The mimics between joints that move; one left on or pointing to a fixed or absent joint is noted."""
    kinds = {joint.name: joint.kind for joint in joints}
    kept = []
    for mimic in mimics:
        idle = [term.joint for term in mimic.terms if kinds.get(term.joint, FIXED) == FIXED]
        if idle:
            what = "is fixed" if idle[0] in kinds else "does not exist"
            notes.append(f"joint '{mimic.terms[0].joint}': its <mimic> is left out, since joint '{idle[0]}' {what}")
        else:
            kept.append(mimic)
    return kept


class _TreeReader:
    """Reads links and joints, whose numbers it has checked first, all of them, also where ccpin has no use for them.

    `values` are the numeric attributes of each element of a tag in `NUMERIC`, `colours` those of the named materials.
    """

    def __init__(self, root: XmlElement) -> None:
        self.source = source_of(root)
        self.notes: list[str] = []
        self.values: dict[XmlElement, dict[str, tuple[float, ...]]] = {}
        for name, counts in NUMERIC.items():
            for element in root.iter("{*}" + name):
                self.values[element] = self.numbers_of(element, counts)
        self.colours: dict[str, Colour] = {}
        for material in root.iterfind("material"):
            colour = self.colour(material)
            if material.get("name") and colour is not None:
                self.colours[material.get("name")] = colour

    def numbers_of(self, element: XmlElement, counts: dict[str, int]) -> dict[str, tuple[float, ...]]:
        """An element's numbers; an empty attribute is absent, a colour that is none grey, both with a note."""
        for attribute in counts:
            if not (element.get(attribute, "absent").strip()):
                self.notes.append(f"{attribute} of {label(element)} is empty: taken as absent")
        if element.tag != "color":
            return numeric_attributes(element, counts)
        try:
            values = numeric_attributes(element, {"rgba": None}).get("rgba", ())
        except DescriptionError:
            values = ()
        if len(values) not in (3, 4):
            self.notes.append(f"{label(element)} is no colour of four numbers")
            return {}
        return {"rgba": tuple(min(max(value, 0.0), 1.0) for value in (*values, 1.0)[:4])}

    def needed(self, element: XmlElement, *attributes: str) -> tuple[float, ...]:
        """The numbers of attributes that must be there, in one tuple."""
        values = self.values[element]
        for attribute in attributes:
            if attribute not in values:
                raise fail(element, f"attribute '{attribute}' is missing")
        return tuple(number for attribute in attributes for number in values[attribute])

    def joint(self, element: XmlElement) -> Joint:
        """A <joint>; its motor and its spring stand elsewhere."""
        name, written = text_attribute(element, "name"), text_attribute(element, "type")
        name_of_kind = SYNONYMS.get(written, written)
        if name_of_kind not in (*JOINT_KINDS, FIXED):
            raise fail(element, f"type '{written}' is not one of {', '.join((*JOINT_KINDS, FIXED, *SYNONYMS))}")
        kind = JOINT_KINDS.get(name_of_kind)
        axis = element.find("axis")
        direction = np.array(X_AXIS if axis is None else self.values[axis].get("xyz", X_AXIS))
        norm = math.hypot(*direction)
        if kind is not None and kind.axial and not 1e-9 < norm < 1e9:
            raise fail(element, "the axis is the zero vector")
        limit = element.find("limit")
        stated = {} if limit is None else {key: value for key, (value,) in self.values[limit].items()}
        lower, upper = -np.inf, np.inf
        if kind is not None and kind.nq == 1 and limit is not None:
            if "lower" in stated or "upper" in stated:
                lower, upper = stated.get("lower", 0.0), stated.get("upper", 0.0)
            else:
                self.notes.append(f"joint '{name}' states no lower and upper limit: taken as unlimited")
        return Joint(
            name=name,
            kind=name_of_kind,
            parent=text_attribute(child(element, "parent"), "link"),
            child=text_attribute(child(element, "child"), "link"),
            placement=origin(element.find("origin")),
            axis=direction / norm if norm > 0 else X_AXIS,
            lower=lower,
            upper=upper,
            effort=self.limit_of(stated, "effort", name),
            velocity=self.limit_of(stated, "velocity", name),
            **read_dynamics(element, self.notes),
        )

    def limit_of(self, stated: dict[str, float], word: str, joint: str) -> float:
        """A limit of effort or velocity; a negative one bounds nothing."""
        value = stated.get(word, np.inf)
        if value < 0:
            self.notes.append(f"joint '{joint}' states the limit {word}={value:g}: taken as unlimited")
            return np.inf
        return value

    def mimics(self, element: XmlElement) -> list[Coupling]:
        """What a joint mimics, as couplings θ − multiplier·θ_master − offset = 0."""
        name, couplings = element.get("name"), []
        for mimic in element.iterfind("mimic"):
            master, values = text_attribute(mimic, "joint"), self.values[mimic]
            if master == name:
                raise fail(element, "mimics itself")
            line = (-values.get("offset", (0.0,))[0], -values.get("multiplier", (1.0,))[0])
            couplings.append(Coupling(f"mimic_{name}", (CouplingTerm(name, (0.0, 1.0)), CouplingTerm(master, line))))
        return couplings

    def link(self, element: XmlElement) -> Link:
        """A <link> with its first inertial and the visuals that can be drawn."""
        name = text_attribute(element, "name")
        inertias = [self.inertia(inertial) for inertial in element.iterfind("inertial")]
        visuals = [self.visual(visual, name) for visual in element.iterfind("visual")]
        return Link(name, inertias[0] if inertias else None, tuple(filter(None, visuals)))

    def inertia(self, inertial: XmlElement) -> Inertia:
        """Mass, centre and inertia matrix of an <inertial>, turned into the link's axes."""
        (mass,) = self.needed(child(inertial, "mass"), "value")
        matrix = child(inertial, "inertia")
        ixx, iyy, izz = self.needed(matrix, "ixx", "iyy", "izz")
        products = {"ixy": (0.0,), "ixz": (0.0,), "iyz": (0.0,), **self.values[matrix]}
        (ixy,), (ixz,), (iyz,) = products["ixy"], products["ixz"], products["iyz"]
        placement = origin(inertial.find("origin"))
        rotation = placement[:3, :3]
        rotational = rotation @ np.array([[ixx, ixy, ixz], [ixy, iyy, iyz], [ixz, iyz, izz]]) @ rotation.T
        return Inertia(mass, placement[:3, 3], rotational)

    def visual(self, visual: XmlElement, link: str) -> Visual | None:
        """A <visual>, or a note where it cannot be drawn: a picture never costs the dynamics."""
        shape = self.shape(child(visual, "geometry"), link)
        if isinstance(shape, str):
            self.notes.append(f"link '{link}': {shape}; it is left out of pictures")
            return None
        material = visual.find("material")
        colour = None
        if material is not None:
            colour = self.colour(material) or self.colours.get(material.get("name"))
        return Visual(shape, origin(visual.find("origin")), colour or Visual.rgba)

    def colour(self, material: XmlElement) -> Colour | None:
        """The colour a <material> states itself."""
        colour = material.find("color")
        return None if colour is None else cast(Colour, self.values[colour].get("rgba", WHITE))

    def shape(self, geometry: XmlElement, link: str) -> Shape | str:
        """The first shape of a <geometry>, or why it cannot be drawn.

        Raises:
            DescriptionError: It lacks a dimension.
        """
        shape = next(geometry.iterchildren(*SHAPES), None)
        if shape is None:
            return f"a visual is none of {', '.join(SHAPES)}"
        if shape.tag == "mesh":
            return self.mesh(shape, link)
        size = self.needed(shape, *NUMERIC[shape.tag])
        return Shape(shape.tag, size) if min(size) > 0 else f"a visual's {shape.tag} has no extent"

    def mesh(self, shape: XmlElement, link: str) -> Shape | str:
        """A <mesh>; one whose file is absent stays in the description, with a note."""
        name = shape.get("filename")
        if not name:
            return "a visual's mesh has no file name"
        scale = numeric_attributes(shape, {"scale": None}).get("scale", (1.0,))
        if len(scale) not in (1, 3):
            return "a mesh's scale has neither one nor three numbers"
        found = find_mesh(name, self.source)
        if found is None:
            self.notes.append(f"link '{link}': mesh '{name}' is not there; it is left out of pictures")
        return Shape("mesh", scale * 3 if len(scale) == 1 else scale, mesh=str(found or name))
