"""Joints that form a graph: which of them span the tree, and what the others ask for as loop closures.

The rule: in file order a joint is in the tree if it is the first to reach its child; a joint whose child is reached
already closes a loop. Where that leaves parts apart, the first joint between two of them is in the tree as well, turned
round if need be. A joint marked as a loop joint is in the tree only where nothing else holds the parts together.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import (
    IDENTITY,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    frame,
    inverse,
    rotation_to,
)

PERPENDICULAR = 1e-9  # cosine of the angle from which on two axes are perpendicular
Z_TO_X: Array = np.array([[0.0, 0, -1], [0, 1, 0], [1, 0, 0]])  # its x axis is the former z
Z_TO_Y: Array = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # its y axis is the former z
_CLOSURES = {
    "revolute": "revolute",
    "continuous": "revolute",
    "prismatic": "prismatic",
    "spherical": "spherical",
    "planar": "planar",
    "fixed": "fixed",
}


@dataclass(frozen=True, eq=False)
class Connection:
    """A joint of a graph: M = before · Π steps · after⁻¹ takes the child link's frame to the parent link's.

    Attributes:
        name, parent, child: As the file has them.
        steps: Its motions in order, each a joint whose axis is that in the joint's frame; parent, child and placement
            mean nothing yet. A universal joint has two, a fixed joint one of kind fixed.
        before: The joint's frame (4, 4) in the parent link's.
        after: The same frame in the child link's, at zero displacement.
        closes: Whether the file wants it as a loop joint.
    """

    name: str
    parent: str
    child: str
    steps: tuple[Joint, ...]
    before: Array = field(default_factory=lambda: IDENTITY)
    after: Array = field(default_factory=lambda: IDENTITY)
    closes: bool = False

    def reversed(self) -> Connection:
        """The same joint seen from its child: displacements keep their sign."""
        steps = tuple(replace(step, axis=-step.axis) for step in reversed(self.steps))
        return replace(self, parent=self.child, child=self.parent, steps=steps, before=self.after, after=self.before)


class Spanned(NamedTuple):
    """Joints in the tree, each leading away from the root, those that close loops, and the first link of each part."""

    tree: tuple[Connection, ...]
    loops: tuple[Connection, ...]
    roots: tuple[str, ...]


class ConnectionParts(NamedTuple):
    """What a connection becomes: links without mass, joints, and closures."""

    links: tuple[Link, ...] = ()
    joints: tuple[Joint, ...] = ()
    closures: tuple[LoopClosure, ...] = ()


def span(connections: Sequence[Connection], links: Iterable[str], root: str | None = None) -> Spanned:
    """Choose the tree of a graph of joints (the rule is the module's).

    Args:
        connections: The joints in file order.
        links: The links in file order; each becomes part of the tree of one root.
        root: The link to start from; default the first that is no joint's child, else the first that none reaches.
    """
    names = list(dict.fromkeys(links))
    part = {name: name for name in names}

    def find(name: str) -> str:
        while part[name] != name:
            part[name] = part[part[name]]
            name = part[name]
        return name

    chosen: set[int] = set()
    reached: set[str] = set() if root is None else {root}
    for directed, cut in ((True, False), (False, False), (False, True)):
        for k, connection in enumerate(connections):
            a, b = find(connection.parent), find(connection.child)
            fits = (cut or not connection.closes) and not (directed and connection.child in reached)
            if fits and a != b:
                chosen.add(k)
                reached.add(connection.child)
                part[b] = a
    children = {connection.child for connection in connections}
    orphans, unreached = (n for n in names if n not in children), (n for n in names if n not in reached)
    return _oriented(connections, chosen, [*([] if root is None else [root]), *orphans, *unreached, *names])


def _oriented(connections: Sequence[Connection], chosen: Collection[int], order: Iterable[str]) -> Spanned:
    """Turn the joints of the tree so that each leads away from the first link of its part."""
    touching: dict[str, list[int]] = {}
    for k in chosen:
        for link in (connections[k].parent, connections[k].child):
            touching.setdefault(link, []).append(k)
    tree: dict[int, Connection] = {}
    roots, seen = list[str](), set[str]()
    for root in order:
        if root in seen:
            continue
        roots.append(root)
        seen.add(root)
        front = [root]
        while front:
            link = front.pop()
            for k in touching.get(link, ()):
                if k not in tree:
                    tree[k] = connections[k] if connections[k].parent == link else connections[k].reversed()
                    seen.add(tree[k].child)
                    front.append(tree[k].child)
    loops = tuple(connection for k, connection in enumerate(connections) if k not in tree)
    return Spanned(tuple(tree[k] for k in sorted(tree)), loops, tuple(roots))


def as_tree(connection: Connection) -> ConnectionParts:
    """A connection as joints of the tree; the child link keeps its own frame."""
    return _chain(connection, connection.child)


def as_loop(connection: Connection, *, keep: bool = False) -> ConnectionParts:
    """A connection as a loop closure.

    One that has to stay a joint (`keep`: it has a motor, say), has a force of its own, or moves in a way no closure
    kind does, becomes joints of the tree that lead to a link without mass, which is welded to the child: exactly the
    same mechanism.
    """
    kind = None if keep or any(map(has_force, connection.steps)) else _kind(connection.steps)
    if kind is None:
        carrier = f"{connection.child}.{connection.name}"
        chain = _chain(replace(connection, after=IDENTITY), carrier)
        weld = LoopClosure(connection.name, "fixed", carrier, connection.child, IDENTITY, connection.after)
        return ConnectionParts((*chain.links, Link(carrier)), chain.joints, (weld,))
    first, last = connection.steps[0].axis, connection.steps[-1].axis
    turn_a, turn_b = (np.eye(3), np.eye(3)) if kind in ("spherical", "fixed") else 2 * (rotation_to(first),)
    if kind == "universal":
        turn_a, turn_b = rotation_to(first) @ Z_TO_X, rotation_to(last) @ Z_TO_Y
    ends = connection.before @ frame(np.zeros(3), turn_a), connection.after @ frame(np.zeros(3), turn_b)
    return ConnectionParts(closures=(LoopClosure(connection.name, kind, connection.parent, connection.child, *ends),))


def has_force(joint: Joint) -> bool:
    """Whether a joint's own damping, friction, spring or rotor acts on the mechanism."""
    return any((joint.damping, joint.breakaway_level, joint.stiffness, joint.armature))


def limited(joint: Joint) -> bool:
    """Whether a joint's displacement has a limit."""
    return bool(np.isfinite(joint.lower) or np.isfinite(joint.upper))


def _kind(steps: tuple[Joint, ...]) -> str | None:
    """The closure kind that leaves exactly these motions free, if there is one."""
    if len(steps) == 1:
        return _CLOSURES.get(steps[0].kind)
    turning = all(step.kind in ("revolute", "continuous") for step in steps)
    if len(steps) == 2 and turning and abs(float(steps[0].axis @ steps[1].axis)) < PERPENDICULAR:
        return "universal"
    return None


def free_joint(link: str) -> str:
    """The name of the joint by which a link moves that no joint of its file holds."""
    return f"{link}.free"


def without_strays(description: MechanismDescription, kept: Collection[str] = ()) -> MechanismDescription:
    """The description without links that neither a joint nor a loop ties to anything: they are no part of a mechanism.

    Of bodies that float because their file's joints do not reach them; `kept` names joints to leave.
    """
    ends = {link for closure in description.closures for link, _ in closure.ends}
    ends |= {joint.parent for joint in description.joints}
    strays = {
        joint.child: joint
        for joint in description.joints
        if joint.name == free_joint(joint.child) and joint.kind == "floating" and joint.name not in kept
    }
    lost = [link for link in strays if link not in ends]
    if not lost:
        return description
    names = {strays[link].name for link in lost}
    return replace(
        description,
        links=tuple(link for link in description.links if link.name not in lost),
        joints=tuple(joint for joint in description.joints if joint.name not in names),
        notes=(*description.notes, *(f"link '{link}' is left out: no joint and no loop holds it" for link in lost)),
    )


def _chain(connection: Connection, child: str) -> ConnectionParts:
    """Joints from the parent to `child`, with links without mass between them and where the frames differ."""
    links, joints = list[Link](), list[Joint]()
    parent, placement = connection.parent, connection.before
    offset = inverse(connection.after)
    aligned = bool(np.allclose(offset, IDENTITY, rtol=0.0, atol=1e-14))
    for k, step in enumerate(connection.steps):
        ends = k == len(connection.steps) - 1
        if ends and step.kind == "fixed":
            placement, aligned = placement @ offset, True
        end = child if ends and aligned else f"{child}.{step.name}"
        if end != child:
            links.append(Link(end))
        joints.append(replace(step, parent=parent, child=end, placement=placement))
        parent, placement = end, IDENTITY
    if parent != child:
        joints.append(Joint(f"{connection.name}.fixed", "fixed", parent, child, offset))
    return ConnectionParts(tuple(links), tuple(joints))


def loop_notes(loops: Sequence[Connection], parts: Sequence[ConnectionParts]) -> list[str]:
    """What became of the joints that close loops, in sentences."""
    notes = []
    for connection, part in zip(loops, parts, strict=True):
        if part.joints:
            notes.append(
                f"joint '{connection.name}' closes a loop and stays a joint, of the massless link "
                f"'{part.closures[0].link_a}' that is welded to '{connection.child}'"
            )
        else:
            notes.append(f"joint '{connection.name}' closes a loop")
            if any(map(limited, connection.steps)):
                notes.append(f"joint '{connection.name}': its limits are left out, since it closes a loop")
    return notes


def zero_poses(root: str, joints: Iterable[Joint]) -> dict[str, Array]:
    """The frame (4, 4) of every link that joints lead to from the root, in the root's, at zero displacement."""
    below: dict[str, list[Joint]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint)
    poses, front = {root: IDENTITY}, [root]
    while front:
        parent = front.pop()
        for joint in below.get(parent, ()):
            if joint.child not in poses:
                poses[joint.child] = poses[parent] @ joint.placement
                front.append(joint.child)
    return poses
