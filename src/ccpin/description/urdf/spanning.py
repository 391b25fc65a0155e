"""What makes a URDF's joints a graph: links with two parents, and SDFormat joints in its <gazebo> extension."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from ccpin.arrays import Array
from ccpin.description.elements.closing_frames import closing_pairs
from ccpin.description.elements.graph import Connection, as_loop, loop_notes, zero_poses
from ccpin.description.elements.xml import XmlElement, children, fail, text_attribute, truth
from ccpin.description.model import Coupling, Joint, Link, LoopClosure, inverse
from ccpin.description.names import hint
from ccpin.description.sdf.gearboxes import gear_couplings
from ccpin.description.sdf.joints import (
    JointFrames,
    Joints,
    joint_type,
    mimic_coupling,
    read_gearbox,
    read_steps,
    reference_body,
)
from ccpin.description.sdf.values import first, flag, number, own, placement, relative_to, text

WORLD, MODEL = "world", "__model__"


class Graph(NamedTuple):
    """What the joints of a URDF come to: its tree, what closes loops in it, and what had to be said."""

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    closures: tuple[LoopClosure, ...]
    couplings: tuple[Coupling, ...]
    notes: tuple[str, ...]


def read_graph(root: XmlElement, links: Sequence[Link], joints: Sequence[Joint], kept: Collection[str]) -> Graph:
    """Sort a URDF's joints into tree and loops, with those its <gazebo> extension and its closing frames add.

    The second joint that reaches a link closes a loop; it stays a joint (of a massless link welded to that link) if it
    is among those `kept`, which have motors or couplings, or has a force of its own.

    Raises:
        DescriptionError: A joint of the extension is malformed or names what does not exist.
    """
    tree, loops = _split(joints)
    reached = {joint.child for joint in tree}
    base = next((link.name for link in links if link.name not in reached), links[0].name)
    notes: list[str] = []
    extension = _Extension(root, links, tree, base)
    connections = [
        *(Connection(joint.name, joint.parent, joint.child, (joint,), joint.placement) for joint in loops),
        *extension.found.connections,
    ]
    kept = {*kept, *extension.found.mimics, *(leader for _, leader, _ in extension.found.mimics.values())}
    parts = [as_loop(c, keep=bool(kept & {c.name, *(step.name for step in c.steps)})) for c in connections]
    notes += loop_notes(connections, parts)
    every = (*tree, *(joint for part in parts for joint in part.joints))
    gears = gear_couplings(extension.found.gearboxes, every, extension.poses)
    names = {joint.name for joint in every}
    mimics = [mimic_coupling(name, said, names) for name, said in extension.found.mimics.items()]
    closures = tuple(closure for part in parts for closure in part.closures)
    return Graph(
        links=tuple(link for part in parts for link in part.links),
        joints=every,
        closures=closures,
        couplings=(*extension.found.couplings, *gears, *mimics),
        notes=(*notes, *extension.found.notes, *_left_out(root)),
    )


def _split(joints: Sequence[Joint]) -> tuple[list[Joint], list[Joint]]:
    """The first joint that reaches each link, and the others."""
    tree: dict[str, Joint] = {}
    for joint in joints:
        tree.setdefault(joint.child, joint)
    return list(tree.values()), [joint for joint in joints if tree[joint.child] is not joint]


def onshape_closures(graph: Graph, stated: Sequence[LoopClosure], notes: list[str]) -> tuple[LoopClosure, ...]:
    """Closures of the massless links that onshape-to-robot fixes in pairs where a loop closes.

    None where the closures stated use those links themselves.
    """
    used = {link for closure in stated for link, _ in closure.ends}
    frames = {
        joint.child: (joint.parent, joint.placement)
        for joint in graph.joints
        if joint.kind == "fixed" and joint.child.startswith("closing_")
    }
    return () if used & set(frames) else closing_pairs(frames, notes)


def extension_joints(root: XmlElement) -> dict[str, str]:
    """The joints in <gazebo> elements that a motor may drive, and what each is called."""
    found = (joint for gazebo in children(root, "gazebo") for joint in own(gazebo, "joint"))
    return {str(joint.get("name")): str(joint.get("type")) for joint in found}


class _Extension:
    """The SDFormat joints in <gazebo> elements; the links they name are the URDF's."""

    def __init__(self, root: XmlElement, links: Sequence[Link], tree: Sequence[Joint], base: str) -> None:
        self.found = Joints()
        self._links, self._base = {link.name for link in links}, base
        elements = [joint for gazebo in children(root, "gazebo") for joint in own(gazebo, "joint")]
        self.poses = zero_poses(base, tree) if elements else {}
        for element in elements:
            self._read(element)

    def _read(self, element: XmlElement) -> None:
        name = text_attribute(element, "name")
        parent, child = (self._end(element, end) for end in ("parent", "child"))
        pose = first(element, "pose")
        stated = self._pose(relative_to(pose) or child, element) @ placement(pose)
        frames = JointFrames(stated, lambda named: self._pose(named, element))
        if parent == child:
            self.found.notes.append(f"joint '{name}' of the <gazebo> extension ties '{child}' to where it is: left out")
            return
        if joint_type(element) == "gearbox":
            reference = self._known(reference_body(element), element)
            ends = parent, child, reference
            self.found.gearboxes.append(read_gearbox(element, name, ends, frames, self.found.notes))
            return
        before, after = (inverse(self._pose(end, element)) @ stated for end in (parent, child))
        steps = read_steps(element, name, frames, self.found)
        self.found.connections.append(Connection(name, parent, child, steps, before, after))

    def _end(self, element: XmlElement, role: str) -> str:
        """The link a joint's <parent> or <child> names, as text (SDFormat) or as an attribute (URDF)."""
        found = first(element, role)
        name = text(element, role) or (None if found is None else found.get("link"))
        if not name:
            raise fail(element, f"<{role}> is missing or empty")
        return self._known(name, element)

    def _known(self, name: str, element: XmlElement) -> str:
        if name in self._links:
            return name
        if name in (WORLD, MODEL):
            return self._base
        raise fail(element, f"link '{name}' does not exist{hint(name, self._links)}")

    def _pose(self, name: str, element: XmlElement) -> Array:
        link = self._known(name, element)
        if link not in self.poses:
            raise fail(element, f"link '{link}' hangs on no joint")
        return self.poses[link]


def _switched(element: XmlElement, name: str) -> bool:
    """A switch stated as an element's text, or as its `value`."""
    said = next(iter(own(element, name)), None)
    if said is not None and not (said.text or "").strip() and said.get("value"):
        return truth(said, "value")
    return flag(element, name, False)


def _left_out(root: XmlElement) -> list[str]:
    """What the extension says that moves bodies and is not simulated here."""
    notes, plugins = [], 0
    for element in children(root, "gazebo"):
        on = element.get("reference")
        plugins += len(own(element, "plugin"))
        if _switched(element, "turnGravityOff"):
            notes.append(f"gravity is switched off for {on} in the file; here it acts")
        if number(element, "dampingFactor", 0.0):
            notes.append(f"the dampingFactor of {on} is left out")
    return notes + ([f"left out: {plugins} Gazebo plugins"] if plugins else [])
