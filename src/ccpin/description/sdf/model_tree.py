"""The links and joints of a model and of those in it, with every link's pose in the world."""

from __future__ import annotations

import math

from ccpin.arrays import Array
from ccpin.description.elements.graph import Connection
from ccpin.description.elements.xml import XmlElement, fail, tag
from ccpin.description.model import IDENTITY, Joint, Link, inverse
from ccpin.description.sdf.drake_constraints import CONSTRAINTS
from ccpin.description.sdf.joints import (
    FRAMES,
    JointFrames,
    Joints,
    cut,
    joint_type,
    read_gearbox,
    read_steps,
    reference_body,
)
from ccpin.description.sdf.links import read_link
from ccpin.description.sdf.scopes import WORLD, Scope
from ccpin.description.sdf.values import flag, required, unread

_MODEL = (
    *("static", "self_collide", "allow_auto_disable", "enable_wind", "link", "joint", "frame", "model", "include"),
    *("pose", "plugin", "gripper", "origin", *CONSTRAINTS),
)


class LinkReader:
    """Reads all links, then all joints.

    Attributes:
        links: By full name, in file order.
        poses: Every link's frame (4, 4) in the world, and the world's own.
        weightless: The links whose gravity is switched off.
        joints: What the joints say.
        notes: What was assumed or left out.

    Raises:
        DescriptionError: An element is malformed or names what does not exist.
    """

    def __init__(self, scope: Scope) -> None:
        self.links: dict[str, Link] = {}
        self.poses = {WORLD: IDENTITY}
        self.weightless: list[str] = []
        self.joints = Joints()
        self.notes: list[str] = []
        for inner in scope.inside():
            self._read_links(inner)
        for inner in scope.inside():
            self._read_joints(inner)

    def _read_links(self, scope: Scope) -> None:
        """Links and what stands beside them in one model, with each link's pose in the world."""
        strangers = unread(scope.element, _MODEL)
        if "drake:joint" in strangers:
            stated = next(part for part in scope.element.iterchildren("{*}joint") if part.prefix)
            raise fail(stated, "<drake:joint> is not read; state it as SDFormat's own <joint>s or as a closure")
        self.notes += [f"model '{scope.placed.name}': <{stranger}> is not read" for stranger in strangers]
        top = scope.to_top()
        for name, element in scope.entries.items():
            pose = top @ scope.pose(name, element)
            if tag(element) == "link":
                full = scope.prefix + name
                if full in self.links:
                    raise fail(element, f"'{full}' is also the full name of a link of another model")
                self.links[full] = read_link(element, full, self.notes)
                self.poses[full] = pose
                if not flag(element, "gravity", True):
                    self.weightless.append(full)
                if scope.frozen:
                    held = Joint(f"{full}.static", "fixed", "", "")
                    self.joints.connections.append(Connection(held.name, WORLD, full, (held,), pose))

    def _read_joints(self, scope: Scope) -> None:
        top = scope.to_top()
        for short, element in scope.entries.items():
            if tag(element) != "joint" or scope.frozen:
                continue
            name = scope.prefix + short
            parent, child = (scope.link_of(required(element, end), element) for end in ("parent", "child"))
            pose = top @ scope.pose(short, element)
            ends = self._own_frames(scope, element, (parent, child))
            pose = top @ scope.pose(ends[1], element) if ends else pose
            frames = JointFrames(pose, lambda named, e=element: top @ scope.pose(named, e))  # type: ignore[misc]
            if parent == child:
                raise fail(element, f"joins link '{parent}' to itself")
            if not ends:
                self._note_parent(scope, top, element, name, pose)
            if joint_type(element) == "gearbox":
                links = parent, child, scope.link_of(reference_body(element), element)
                self.joints.gearboxes.append(read_gearbox(element, name, links, frames, self.notes))
                continue
            before, after = (inverse(self.poses[end]) @ pose for end in (parent, child))
            if ends:
                before = inverse(self.poses[parent]) @ top @ scope.pose(ends[0], element)
            steps = read_steps(element, name, frames, self.joints)
            self.joints.connections.append(Connection(name, parent, child, steps, before, after, cut(element)))

    def _own_frames(self, scope: Scope, element: XmlElement, links: tuple[str, str]) -> tuple[str, str] | None:
        """Drake's frames of a joint on parent and child, which coincide at zero displacement whatever poses say."""
        said = {tag(part): part for part in element.iterchildren(*(f"{{*}}{word}" for word in FRAMES)) if part.prefix}
        if not said:
            return None
        names = [(said[word].text or "").strip() if word in said else "" for word in FRAMES]
        if not all(names):
            raise fail(element, "<drake:parent_frame> and <drake:child_frame> go together")
        for word, name, link in zip(FRAMES, names, links, strict=True):
            if scope.link_of(name, said[word]) != link:
                raise fail(said[word], f"'{name}' is not fixed to link '{link}'")
        return names[0], names[1]

    def _note_parent(self, scope: Scope, top: Array, element: XmlElement, name: str, pose: Array) -> None:
        """Say so where a joint's parent frame stands elsewhere: some authors expect that to place the child."""
        parent = required(element, "parent")
        if parent in scope.entries and tag(scope.entries[parent]) == "frame":
            away = math.dist((top @ scope.pose(parent, element))[:3, 3], pose[:3, 3])
            if away > 1e-6:
                self.notes.append(
                    f"joint '{name}': its parent frame '{parent}' is {away:.4g} m from the joint; by SDFormat's rules "
                    "the poses drawn hold, and the frame only names its link"
                )
