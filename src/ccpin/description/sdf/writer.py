"""Writing a description as SDFormat: links posed by their joints, closures as joints between two links."""

from __future__ import annotations

from itertools import chain, count
from pathlib import Path

import numpy as np
from lxml import etree

from ccpin.arrays import Array
from ccpin.description.elements.graph import PERPENDICULAR, has_force, limited, zero_poses
from ccpin.description.elements.omissions import left_out, not_written
from ccpin.description.elements.xml import XmlElement, cannot, saved
from ccpin.description.model import (
    IDENTITY,
    Coupling,
    CouplingTerm,
    Inertia,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    frame,
    inverse,
)
from ccpin.description.sdf.written_parts import add_axis, add_pose, add_visual, say

WORLD, MODEL = "world", "__model__"
GRAVITY = (0.0, 0.0, -9.81)  # m/s², SDFormat's own where a file states none
CLOSED = 1e-10  # m or rad: farther apart, a closure's frames do not stand as its kind asks
_DRAKE = "drake.mit.edu"
_TYPES = {"revolute", "continuous", "prismatic", "fixed"}
_CLOSURES = {"spherical": "ball", "revolute": "revolute", "prismatic": "prismatic", "fixed": "fixed"}


def write_sdf(description: MechanismDescription, path: str | Path) -> tuple[str, ...]:
    """Write a description as an SDFormat file that Gazebo and `read_description` read.

    Displacements are zero where the model is drawn. A joint of SDFormat has one frame, so a loop must be closed there
    to be closed by a joint: that is for Gazebo, and Drake refuses it. A loop that is open there is written by
    ``drake:`` constraints, which Gazebo passes over; a revolute closure becomes two balls on its axis, and a distance
    closure is always such a constraint. Drake reads the balls; its parser has no ``weld_constraint`` as yet. Rotor
    inertias are ``drake:rotor_inertia``. Linear couplings are mimics.

    SDFormat has no place for the reference pose (closing starts from the pose drawn; ``load(reference=…)`` states it
    again), for motors and their gears, for which joints are independent, nor for notes. The root is fixed to the world
    by a joint of the writer's own. A link named as a joint is, or "world", gets another name: names are unique in
    SDFormat. A free body's joint is called ``<link>.free`` when read. Links without mass are written with mass 0, which
    Gazebo refuses.

    Returns:
        What is stated and not written, and links that were renamed, in sentences.

    Raises:
        DescriptionError: What SDFormat cannot say, by name: a joint or closure of another kind, a prismatic or
            universal closure that is open at zero displacement, forces of a ball joint, a coupling that is not linear.
        InvalidInputError: The file cannot be written.
    """
    writer = _SdfWriter(description)
    saved(writer.document(), path)
    renamed = [f"{old} is {new}" for old, new in writer.names.items() if new not in (old, WORLD)]
    words = (
        "the reference pose",
        "further poses",
        "which joints are independent",
        "motors",
        "breakaway levels and Stribeck speeds",
        "what the file tells MuJoCo's solver",
    )
    told = left_out(description, "SDFormat", *words)
    return (*told, *not_written("SDFormat", "two things of one name; of the links", renamed))


class _SdfWriter:
    """One document."""

    def __init__(self, description: MechanismDescription) -> None:
        self.description = description
        self.model = etree.Element("model", name=description.name, nsmap={"drake": _DRAKE})
        self.poses = zero_poses(description.root, description.joints)
        self.links = {link.name for link in description.links}
        self.named = {joint.name for joint in description.joints} | {WORLD}
        for joint in description.joints:
            if joint.name == WORLD:
                raise cannot(description, f"joint '{joint.name}'", "SDFormat keeps this name for itself")
        for name in (*self.named, *self.links):
            if "::" in name or (name.startswith("__") and name.endswith("__")):
                raise cannot(description, f"'{name}'", "SDFormat keeps '::' and names between '__' for itself")
        self.names: dict[str, str] = {}
        root = next(link for link in description.links if link.name == description.root)
        # Only what hangs on the world by a joint is held there: something must, or the first body would be.
        held = any(joint.parent == root.name and joint.kind != "floating" for joint in description.joints)
        bare = (root.inertia is None or not root.inertia.mass) and not root.visuals
        self.world_is_root = root.name == WORLD and bare and held
        for link in description.links:
            is_world = self.world_is_root and link is root
            self.names[link.name] = WORLD if is_world else self.unique(link.name, f"{link.name}_link")
        self.joints: dict[str, XmlElement] = {}

    def unique(self, name: str, other: str | None = None) -> str:
        """A name that nothing in the model has yet: this one, `other`, or one with a number."""
        candidates = chain([name, other or name], (f"{name}_{k}" for k in count(2)))
        free = (candidate for candidate in candidates if candidate == name or candidate not in self.links)
        found = next(candidate for candidate in free if candidate not in self.named)
        self.named.add(found)
        return found

    def document(self) -> XmlElement:
        """The whole file, of the oldest version that has all it says."""
        root = etree.Element("sdf", nsmap={"drake": _DRAKE}, version="1.11" if self.description.couplings else "1.9")
        above = root
        if self.description.gravity != GRAVITY:
            above = etree.SubElement(root, "world", name="default")
            say(above, "gravity", self.description.gravity)
        above.append(self.model)
        by_child = {joint.child: joint for joint in self.description.joints}
        for link in self.description.links:
            if self.names[link.name] != WORLD:
                self.link(link, by_child.get(link.name))
        if not self.world_is_root:
            base = self.names[self.description.root]
            self.ends("fixed", self.unique(f"{base}_to_world"), WORLD, base)
        for joint in self.description.joints:
            self.joint(joint)
        for closure in self.description.closures:
            self.closure(closure)
        for coupling in self.description.couplings:
            self.coupling(coupling)
        etree.cleanup_namespaces(root)
        return root

    def link(self, link: Link, joint: Joint | None) -> None:
        """A link, where its joint is; a free one where it stands."""
        element = etree.SubElement(self.model, "link", name=self.names[link.name])
        if joint is not None and joint.kind == "floating":
            add_pose(element, self.poses[link.name])
        elif joint is not None:
            add_pose(element, IDENTITY, joint.name)
        inertia = link.inertia or Inertia(0.0, np.zeros(3), np.zeros((3, 3)))
        inertial = etree.SubElement(element, "inertial")
        add_pose(inertial, frame(inertia.com))
        say(inertial, "mass", inertia.mass)
        matrix = etree.SubElement(inertial, "inertia")
        for i, j in zip(*np.triu_indices(3), strict=True):
            say(matrix, f"i{'xyz'[i]}{'xyz'[j]}", inertia.rotational[i, j])
        for position, visual in enumerate(link.visuals, start=1):
            add_visual(element, visual, f"visual_{position}")

    def ends(self, kind: str, name: str, parent: str, child: str) -> XmlElement:
        """A joint between two links, named as in the file."""
        element = etree.SubElement(self.model, "joint", name=name, type=kind)
        for role, link in (("parent", parent), ("child", child)):
            etree.SubElement(element, role).text = link
        return element

    def joint(self, joint: Joint) -> None:
        """A joint of the tree, with its limits and forces; a free body needs none."""
        where = f"joint '{joint.name}'"
        free = joint.kind == "floating" and joint.parent == self.description.root
        if not free and joint.kind not in (*_TYPES, "spherical"):
            beyond = "frees bodies from the world only" if joint.kind == "floating" else f"has no {joint.kind} joint"
            raise cannot(self.description, where, f"SDFormat {beyond}")
        if joint.kind in ("spherical", "floating") and (has_force(joint) or limited(joint)):
            raise cannot(self.description, where, f"SDFormat gives a {joint.kind} joint no limits, spring or friction")
        if free:
            return
        kind = "ball" if joint.kind == "spherical" else joint.kind
        parent = self.names[joint.parent]
        element = self.ends(kind, joint.name, parent, self.names[joint.child])
        self.joints[joint.name] = element
        add_pose(element, joint.placement, MODEL if parent == WORLD else parent)
        if kind not in ("ball", "fixed"):
            add_axis(element, joint)
        if joint.armature:
            say(element, f"{{{_DRAKE}}}rotor_inertia", joint.armature)

    def closure(self, closure: LoopClosure) -> None:
        """A joint between two links where the loop is closed as drawn, else Drake's constraints."""
        where = f"closure '{closure.name}'"
        if closure.kind == "distance":
            self.points("distance_constraint", closure, IDENTITY)
        elif closure.kind not in (*_CLOSURES, "universal"):
            raise cannot(self.description, where, f"SDFormat has no {closure.kind} closure")
        elif self.closed(closure):
            self.closing_joint(closure)
        elif closure.kind == "fixed":
            self.weld(closure)
        elif closure.kind in ("spherical", "revolute"):
            self.points("ball_constraint", closure, IDENTITY)
            if closure.kind == "revolute":
                self.points("ball_constraint", closure, frame([0.0, 0.0, self.description.size]), "_axis")
        else:
            message = f"the loop is open at zero displacement, and SDFormat has no {closure.kind} closure for that"
            raise cannot(self.description, where, message)

    def closed(self, closure: LoopClosure) -> bool:
        """Whether the two frames stand as the closure's kind asks, at zero displacement."""
        a = self.poses[closure.link_a] @ closure.placement_a
        gap = inverse(a) @ self.poses[closure.link_b] @ closure.placement_b
        turn, away = gap[:3, :3] - np.eye(3), gap[:3, 3] / self.description.size
        misfit = {
            "spherical": [away],
            "revolute": [away, turn[:, 2]],
            "prismatic": [away[:2], turn],
            "fixed": [away, turn],
            "universal": [away, gap[:1, 1]],
        }[closure.kind]
        limit = min(CLOSED, PERPENDICULAR)
        return all(np.abs(part).max() <= limit for part in misfit)

    def closing_joint(self, closure: LoopClosure) -> None:
        """A joint from A's link to B's, or the other way round where B's is the world, which is nobody's child."""
        ends = [(*end, k) for k, end in enumerate(closure.ends)]
        if self.names[closure.link_b] == WORLD:
            ends.reverse()
        (parent, placement, first), (child, other, second) = ends
        kind = _CLOSURES.get(closure.kind, "universal")
        element = self.ends(kind, self.unique(closure.name), self.names[parent], self.names[child])
        add_pose(element, placement, MODEL if self.names[parent] == WORLD else self.names[parent])
        across = (self.poses[parent] @ placement)[:3, :3].T @ (self.poses[child] @ other)[:3, :3]
        axes = {"universal": (np.eye(3)[first], across[:, second]), "ball": (), "fixed": ()}.get(kind, (np.eye(3)[2],))
        for name, axis in zip(("axis", "axis2"), axes, strict=False):
            say(etree.SubElement(element, name), "xyz", axis)

    def weld(self, closure: LoopClosure) -> None:
        """Drake's weld of a frame on each of the two links."""
        name = self.unique(closure.name)
        frames = []
        for side, (link, place) in zip("ab", closure.ends, strict=True):
            frames.append(self.unique(f"{name}_{side}"))
            on = self.names[link]
            element = etree.SubElement(self.model, "frame", name=frames[-1], attached_to=on)
            add_pose(element, place, MODEL if on == WORLD else on)
        element = etree.SubElement(self.model, f"{{{_DRAKE}}}weld_constraint", name=name)
        for role, named in zip(("parent", "child"), frames, strict=True):
            etree.SubElement(element, role).text = named

    def points(self, kind: str, closure: LoopClosure, along: Array, suffix: str = "") -> None:
        """Drake's constraint of a point on each of the two links."""
        name = self.unique(closure.name + suffix)
        element = etree.SubElement(self.model, f"{{{_DRAKE}}}{kind}", name=name)
        for (body, point), (link, place) in zip((("A", "AP"), ("B", "BQ")), closure.ends, strict=True):
            etree.SubElement(element, f"{{{_DRAKE}}}{kind}_body_{body}").text = self.names[link]
            say(element, f"{{{_DRAKE}}}{kind}_p_{point}", (place @ along)[:3, 3])
        if closure.length is not None:
            say(element, f"{{{_DRAKE}}}{kind}_distance", closure.length)

    def coupling(self, coupling: Coupling) -> None:
        """A mimic of the joint that is dependent: θ = m (ψ − s) + offset."""
        where = f"coupling '{coupling.name}'"
        lines = [line for line in map(_linear, coupling.terms) if line is not None]
        if len(lines) != 2 or len(coupling.terms) != 2:
            raise cannot(self.description, where, "SDFormat couples two joints, linearly")
        hints = self.description.dependent_hint
        pairs = sorted(zip(coupling.terms, lines, strict=True), key=lambda pair: pair[0].joint not in hints)
        for (own, (c0, c1)), (leader, (d0, d1)) in (pairs, pairs[::-1]):
            axis = next(self.joints[own.joint].iterchildren("axis"))
            if axis.find("mimic") is None:
                mimic = etree.SubElement(axis, "mimic", joint=leader.joint, axis="axis")
                say(mimic, "multiplier", -d1 / c1)
                say(mimic, "offset", own.reference - (c0 + d0) / c1)
                say(mimic, "reference", leader.reference)
                return
        raise cannot(self.description, where, "both its joints mimic another already, and SDFormat's mimic one at most")


def _linear(term: CouplingTerm) -> tuple[float, float] | None:
    """A term's constant and slope, or ``None`` where it is no line that rises or falls."""
    c0, c1, *rest = (*term.coefficients, 0.0, 0.0)
    return None if any(rest) or not c1 else (float(c0), float(c1))
