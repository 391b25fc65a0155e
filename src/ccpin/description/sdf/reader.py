"""The SDFormat reader: Gazebo's models as mechanism descriptions.

Where a file is silent SDFormat's defaults hold. Displacements are zero in the pose the file draws. SDFormat joins links
by a graph of joints; `ccpin.description.elements.graph` says which of them are the tree's and which close loops.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ccpin.description.checks import check
from ccpin.description.elements.closing_frames import closing_pairs
from ccpin.description.elements.graph import ConnectionParts, as_loop, as_tree, free_joint, loop_notes, span
from ccpin.description.elements.hinges import make_hinges
from ccpin.description.elements.xml import XmlElement, fail, source_of, tag
from ccpin.description.model import IDENTITY, Coupling, Joint, Link, LoopClosure, MechanismDescription, inverse
from ccpin.description.sdf.drake_constraints import drake_closures
from ccpin.description.sdf.gearboxes import gear_couplings
from ccpin.description.sdf.includes import Including
from ccpin.description.sdf.joints import mimic_coupling
from ccpin.description.sdf.model_tree import LinkReader
from ccpin.description.sdf.scopes import WORLD, Scope
from ccpin.description.sdf.values import first, numbers, own
from ccpin.description.sdf.words import check_attributes
from ccpin.errors import DescriptionError

_LEFT_OUT = {
    "plugin": "plugins",
    "sensor": "sensors",
    "collision": "collision shapes (ccpin models no contacts)",
    "gripper": "grippers",
    "battery": "batteries",
}


def sdf_description(
    root: XmlElement, *, model: str | None = None, include_root: str | Path | None = None
) -> MechanismDescription:
    """Read a parsed SDFormat file: one of its models, with what it includes, as links, a tree of joints and closures.

    Args:
        root: The file's root element; includes and meshes are looked up against its source.
        model: The model to read where there are several (``a::b`` for one inside another).
        include_root: The folder included files may come from; default the file's own.

    Raises:
        InvalidXmlError: An included file is not well-formed, or refused for safety.
        DescriptionError: An element is malformed, contradictory or not expressible.
    """
    if tag(root) != "sdf":
        raise fail(root, "an SDFormat file has the root element <sdf>")
    source = source_of(root)
    including = Including(Path(include_root) if include_root else Path(source or ".").parent)
    world = first(root, "world")
    if len(own(root, "world")) > 1:
        raise fail(root, "the file holds several worlds; give one a file of its own")
    notes = list[str]()
    check_attributes(root, notes)
    scope = _chosen(root, world, including, model)
    if scope.frozen:
        raise fail(scope.element, "the model is static: nothing in it moves")
    return _ModelAssembler(scope, world, source, notes).description()


def _chosen(root: XmlElement, world: XmlElement | None, including: Including, model: str | None) -> Scope:
    """The model to read: the one named, else the only one that is not static."""
    if world is not None:
        top = Scope(world, including)
        found = [*top.nested.values(), *top.merged]
    else:
        found = [Scope(element, including) for element in own(root, "model")]
    if model is not None:
        inside = [inner for scope in found for inner in scope.inside()]
        named = [s for s in inside if model in (s.placed.name, s.prefix.removesuffix("::"))]
    else:
        named = [scope for scope in found if not scope.frozen] or found
    if len(named) != 1:
        names = ", ".join(repr(scope.placed.name) for scope in found) or "none"
        asked = "there is not exactly one model to read" if model is None else f"there is not exactly one '{model}'"
        raise fail(root, f"{asked}; the models are {names} (model= names one)")
    scope = named[0]
    return scope if scope.prefix == "" else Scope(scope.element, including, scope.placed, scope.parent, "")


def _unwound(joints: Sequence[Joint], couplings: Sequence[Coupling]) -> tuple[Joint, ...]:
    """Continuous joints as hinges without limits where turns count: under a spring, and in a coupling."""
    counted = {term.joint for coupling in couplings for term in coupling.terms}
    return tuple(
        replace(joint, kind="revolute")
        if joint.kind == "continuous" and (joint.stiffness or joint.name in counted)
        else joint
        for joint in joints
    )


class _ModelAssembler:
    """Puts one model's description together."""

    def __init__(self, scope: Scope, world: XmlElement | None, source: str | None, notes: list[str]) -> None:
        self.scope, self.world, self.source = scope, world, source
        self.name = scope.placed.name
        self.bodies = LinkReader(scope)
        self.joints, self.poses, self.notes = self.bodies.joints, self.bodies.poses, [*notes, *self.bodies.notes]
        if world is not None and own(world, "joint"):
            self.notes.append("the joints between the world's models are not read, as one model is")

    def description(self) -> MechanismDescription:
        """The whole, checked."""
        if not self.bodies.links:
            raise DescriptionError("the model has no link", source=self.source, element=f"model '{self.name}'")
        steps = {step.name for connection in self.joints.connections for step in connection.steps}
        mimics = tuple(mimic_coupling(name, said, steps) for name, said in self.joints.mimics.items())
        root, mounts, parts = self._spanned({term.joint for mimic in mimics for term in mimic.terms})
        joints = (*mounts, *(joint for part in parts for joint in part.joints))
        gears = gear_couplings(self.joints.gearboxes, joints, self.poses)
        couplings = (*self.joints.couplings, *gears, *mimics)
        stated = [c for inner in self.scope.inside() for c in drake_closures(inner, self.notes)]
        make_hinges(stated, self.notes, "balls")
        between = (link for part in parts for link in part.links)
        return check(
            MechanismDescription(
                name=self.name,
                root=root,
                links=(*([Link(WORLD)] if root == WORLD else []), *self.bodies.links.values(), *between),
                joints=_unwound(joints, couplings),
                closures=(*(c for part in parts for c in part.closures), *stated, *self._closing_frames()),
                couplings=couplings,
                dependent_hint=tuple(coupling.terms[0].joint for coupling in couplings),
                gravity=self._gravity(),
                source=self.source,
                notes=tuple(dict.fromkeys((*self.notes, *self.joints.notes, *self._left_out()))),
            )
        )

    def _spanned(self, coupled: set[str]) -> tuple[str, list[Joint], list[ConnectionParts]]:
        """The root link, what holds the parts nothing else does, and what each joint of the file becomes.

        Joints that are coupled stay joints where they close a loop.
        """
        connections = self.joints.connections
        uses_world = any(WORLD in (c.parent, c.child) for c in connections)
        names = [*([WORLD] if uses_world else []), *self.bodies.links]
        spanned = span(connections, names, WORLD if uses_world else self._canonical())
        root, mounts = self._rooted(spanned.roots, uses_world)
        loops = [as_loop(c, keep=bool(coupled & {c.name, *(s.name for s in c.steps)})) for c in spanned.loops]
        self.notes += loop_notes(spanned.loops, loops)
        return root, mounts, [*(as_tree(connection) for connection in spanned.tree), *loops]

    def _rooted(self, roots: Sequence[str], uses_world: bool) -> tuple[str, list[Joint]]:
        """The root link, and the joints that hold the parts nothing else does.

        A model that no joint ties to the world is held where it stands, as a URDF's root is; a further part is free.
        """
        first_root, *others = roots
        root, mounts = first_root, list[Joint]()
        if not uses_world:
            self.notes.append(f"no joint ties the model to the world: link '{root}' is taken as fixed to it")
            if others or not np.array_equal(self.poses[root], IDENTITY):
                mounts.append(Joint(f"{root}.mount", "fixed", WORLD, root, self.poses[root]))
                root = WORLD
        for part in others:
            self.notes.append(f"no joint ties link '{part}' to the others: it is a free body")
            mounts.append(Joint(free_joint(part), "floating", WORLD, part, self.poses[part]))
        return root, mounts

    def _canonical(self) -> str | None:
        """The link the model names as its own, if it does."""
        stated = self.scope.element.get("canonical_link")
        return self.scope.link_of(stated, self.scope.element) if stated else None

    def _closing_frames(self) -> tuple[LoopClosure, ...]:
        """Pairs of frames that onshape-to-robot put where a loop closes."""
        frames = {}
        for scope in self.scope.inside():
            for name, element in scope.entries.items():
                if tag(element) in ("frame", "link"):
                    link = scope.link_of(name, element)
                    pose = scope.to_top() @ scope.pose(name, element)
                    frames[scope.prefix + name] = (link, inverse(self.poses[link]) @ pose)
        return closing_pairs(frames, self.notes)

    def _gravity(self) -> tuple[float, float, float]:
        """The world's gravity; none where no link is heavy."""
        said = first(self.world, "gravity")
        x, y, z = (0.0, 0.0, -9.81) if said is None else numbers(said, 3).tolist()
        if self.bodies.weightless and len(self.bodies.weightless) == len(self.bodies.links):
            return 0.0, 0.0, 0.0
        if self.bodies.weightless:
            self.notes.append(
                f"gravity is switched off for {', '.join(self.bodies.weightless)} in the file; here it acts"
            )
        return x, y, z

    def _left_out(self) -> list[str]:
        """What there is no counterpart for, counted."""
        found = Counter(
            tag(element)
            for scope in self.scope.inside()
            for element in scope.element.iter("{*}plugin", "{*}sensor", "{*}collision", "{*}gripper", "{*}battery")
            if next(element.iterancestors("{*}model"), scope.element) is scope.element
        )
        return [f"left out: {count} {_LEFT_OUT[what]}" for what, count in found.items()]
