"""What the reader of an MJCF body tree collects, and each body's joints as a chain between massless links."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.description.elements.xml import ZERO, XmlElement, fail
from ccpin.description.mjcf.defaults import Compiler
from ccpin.description.mjcf.element import Element
from ccpin.description.mjcf.resolving import moved
from ccpin.description.mjcf.schema import FORCES, KINDS, SOFT_JOINT, WORLD
from ccpin.description.model import IDENTITY, Joint, Link, frame

_DOFS = {"free": 6, "ball": 3, "slide": 1, "hinge": 1}  # velocities of each type
_Z = (0.0, 0.0, 1.0)  # MuJoCo's own axis


class NameGiver:
    """Hands out element names, each once, so that unnamed elements get names no other one has."""

    def __init__(self, what: str, given: Iterable[XmlElement]) -> None:
        self._taken: set[str] = {WORLD} if what == "body" else set()
        for xml in given:
            name = xml.get("name")
            if name in self._taken:
                raise fail(xml, f"the {what} name '{name}' is used twice")
            if name:
                self._taken.add(name)

    def fresh(self, wanted: str) -> str:
        """Return `wanted`, with underscores appended until no other element has that name."""
        while wanted in self._taken:
            wanted += "_"
        self._taken.add(wanted)
        return wanted


@dataclass(frozen=True, eq=False)
class Site:
    """A site: the body it is fixed to and its frame (4, 4) there."""

    body: str
    placement: Array


@dataclass(frozen=True, eq=False)
class WorldBody:
    """What the worldbody says.

    Attributes:
        body_names, joint_names: Hand out names to bodies and joints without one.
        links, joints: Parents before children, the root "world" first.
        poses: Every body's frame (4, 4) in the world at qpos0.
        sites: The named sites.
        reference: Displacements of the movable joints at qpos0.
        notes: What was left out.
        springdampers: Time constants (s) and damping ratios that stand for springs and dampers.
        softness: How soft joints' limits and friction are, as written.
    """

    body_names: NameGiver
    joint_names: NameGiver
    links: list[Link] = field(default_factory=list)
    joints: list[Joint] = field(default_factory=list)
    poses: dict[str, Array] = field(default_factory=dict)
    sites: dict[str, Site] = field(default_factory=dict)
    reference: dict[str, tuple[float, ...]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    springdampers: dict[str, tuple[float, float]] = field(default_factory=dict)
    softness: dict[str, dict[str, str]] = field(default_factory=dict)

    def pose_between(self, first: str, second: str) -> Array:
        """Return the frame (4, 4) of body `second` in body `first` at qpos0."""
        turn = self.poses[first][:3, :3].T
        return frame(-turn @ self.poses[first][:3, 3], turn) @ self.poses[second]


class JointReader:
    """Turns each body's joints into description joints.

    MuJoCo applies a body's joints one after the other, each in the body frame as the earlier ones have moved
    it: M = placement · Πₖ T(pₖ) Jₖ(qₖ − refₖ) T(−pₖ), with pₖ the joint's pos. A joint of a description
    carries its link at the moving joint frame, so each factor T(pₖ) Jₖ(−refₖ) becomes part of a placement,
    and where the last pos is not zero a fixed joint leads back to the body frame.

    Links, joints and reference displacements go into `tree`.
    """

    def __init__(self, compiler: Compiler, tree: WorldBody) -> None:
        self._compiler, self._tree = compiler, tree
        self._count = 0

    def read(self, joints: Sequence[tuple[Element, Array]], parent: str, body: str, placement: Array) -> None:
        """Add the joints that lead from link `parent` to `body`, whose drawn frame there is `placement`.

        Each joint comes with the frame (4, 4) in the body that its place and axis are stated in.

        Raises:
            DescriptionError: A joint is malformed or cannot stand where it stands.
        """
        self._check_together([said for said, _ in joints], parent)
        rest, link = placement, parent
        for index, (said, offset) in enumerate(joints):
            name = said.text("name") or self._tree.joint_names.fresh(f"joint_{self._count}")
            self._count += 1
            kind = _type_of(said)
            pos = np.zeros(3) if kind in ("free", "slide") else (offset @ [*said.vector("pos", 3, ZERO), 1.0])[:3]
            ends = index == len(joints) - 1 and not np.any(pos)
            child = body if ends else self._tree.body_names.fresh(f"{body}.{name}")
            if child != body:
                self._tree.links.append(Link(child))
            self._tree.joints.append(self._joint(said, kind, name, (link, child), rest @ frame(pos), offset[:3, :3]))
            rest, link = frame(-pos), child
        if link != body:
            name = self._tree.joint_names.fresh(f"{body}.fixed")
            self._tree.joints.append(Joint(name, "fixed", link, body, rest))

    def _check_together(self, joints: Sequence[Element], parent: str) -> None:
        for said in joints:
            if _type_of(said) != "free":
                continue
            if len(joints) > 1:
                raise said.fail("a free joint must be the only joint of its body")
            if parent != WORLD:
                raise said.fail("a free joint goes only with a body at the top level")
        for before, said in pairwise(joints):
            if _type_of(before) == "ball" and _type_of(said) in ("ball", "hinge"):
                raise said.fail("a ball joint already turns the body every way; no turning joint may follow it")
        if sum(_DOFS[_type_of(said)] for said in joints) > 6:
            raise joints[-1].fail("a body cannot have more than 6 degrees of freedom")

    def _joint(
        self, said: Element, kind: str, name: str, ends: tuple[str, str], placement: Array, turn: Array
    ) -> Joint:
        """Return one joint, its axis turned; its displacement is MuJoCo's qpos, so the drawn pose is at ref."""
        axis = turn @ said.unit(said.vector("axis", 3, _Z), "axis")
        ref = said.number("ref", 0.0) if kind in ("hinge", "slide") else 0.0
        ref *= self._compiler.angles.unit if kind == "hinge" else 1.0
        lower, upper = self._range(said, kind, name)
        if kind == "free":
            self._note_alignment(said, name)
            quaternion = Rotation.from_matrix(placement[:3, :3]).as_quat()
            self._tree.reference[name] = (*placement[:3, 3].tolist(), *quaternion.tolist())
            placement = IDENTITY
        elif kind == "ball":
            self._tree.reference[name] = (0.0, 0.0, 0.0, 1.0)
        else:
            self._tree.reference[name] = (ref,)
        single = kind in ("hinge", "slide")
        forces = said.bounds("actuatorfrclimited", "actuatorfrcrange", self._compiler.autolimits) if single else None
        physics = self._physics(said, kind, name)
        soft = {word: said.values[word] for word in SOFT_JOINT if word in said.values}
        if soft:
            self._tree.softness[name] = soft
        return Joint(
            name=name,
            kind=KINDS[kind],
            parent=ends[0],
            child=ends[1],
            placement=placement @ moved(KINDS[kind], axis, -ref),
            axis=axis,
            lower=lower,
            upper=upper,
            effort=np.inf if forces is None else float(np.abs(forces).max()),
            **physics,
        )

    def _physics(self, said: Element, kind: str, name: str) -> dict[str, float]:
        """Return rotor inertia, damping, friction and spring; what ccpin has no counterpart for is noted."""
        physics = {field: self._plain(said, attribute, name) for attribute, field in FORCES.items()}
        if any(said.some_numbers("springyield", 2)):
            self._tree.notes.append(f"Left out: springyield of joint '{name}'.")
        time, ratio = said.vector("springdamper", 2, (0.0, 0.0))
        if min(time, ratio) <= 0.0 < max(abs(time), abs(ratio)):
            raise said.fail("springdamper should be two positive numbers: a time in seconds and a ratio")
        if time > 0.0:
            self._tree.springdampers[name] = float(time), float(ratio)
        for word in ("stiffness", "armature") if kind == "free" else ():
            if physics[word]:
                self._tree.notes.append(f"Left out: {word} of joint '{name}', which moves freely.")
                physics[word] = 0.0
        if physics["stiffness"] and kind in ("hinge", "slide"):
            unit = self._compiler.angles.unit if kind == "hinge" else 1.0
            physics["spring_reference"] = said.number("springref", 0.0) * unit
        return physics

    def _plain(self, said: Element, attribute: str, name: str) -> float:
        """Return a number; further ones, the coefficients of a nonlinear force, are noted."""
        value, *nonlinear = said.some_numbers(attribute, 3) or (0.0,)
        if value < 0.0:
            raise said.fail(f"{attribute} should not be negative")
        if any(nonlinear):
            self._tree.notes.append(f"Left out: the nonlinear part of the {attribute} of joint '{name}'.")
        return value

    def _note_alignment(self, said: Element, name: str) -> None:
        word = said.choice("align", ("true", "false", "auto"), "auto")
        if word == "true" or (word == "auto" and self._compiler.align_free):
            self._tree.notes.append(
                f"Joint '{name}': its displacement is that of the body frame as written, not of the inertial "
                "frame to which MuJoCo may align it."
            )

    def _range(self, said: Element, kind: str, name: str) -> tuple[float, float]:
        """Return the limits; a ball joint's cone cannot be expressed and is noted."""
        bounds = said.bounds("limited", "range", self._compiler.autolimits)
        if bounds is None:
            return -np.inf, np.inf
        low, high = bounds
        if kind in ("ball", "free"):
            self._tree.notes.append(f"The range of joint '{name}' is left out: it has no single angle.")
            return -np.inf, np.inf
        if low >= high:
            raise said.fail(f"range should ascend, not run from {low:g} to {high:g}")
        unit = self._compiler.angles.unit if kind == "hinge" else 1.0
        return float(low * unit), float(high * unit)


def _type_of(said: Element) -> str:
    return "free" if said.xml.tag == "freejoint" else said.choice("type", tuple(KINDS), "hinge")


def displacement(said: Element, joint: str, tree: WorldBody) -> float:
    """Return the displacement of a hinge or slide at qpos0."""
    value = tree.reference.get(joint)
    if value is None:
        raise said.fail(f"there is no joint '{joint}'; there are: {', '.join(tree.reference) or 'none'}")
    if len(value) != 1:
        raise said.fail(f"joint '{joint}' is neither a hinge nor a slide")
    return value[0]
