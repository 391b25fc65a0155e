"""The free system Σ′ as a Pinocchio model: a description's tree, cut open at every loop."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, FrozenMapping, Record, frozen
from ccpin.description.joint_kinds import FIXED, JOINT_KINDS, JointKind, split_component
from ccpin.description.model import Joint, Link, MechanismDescription, rotation_to
from ccpin.description.names import choices
from ccpin.errors import DescriptionError, InvalidInputError
from ccpin.kinematics.scratch import Scratch

ROOT_JOINT = "root_joint"


@dataclass(frozen=True, eq=False)
class Attachment(Record):
    """Where a link sits: the movable joint that carries it (0: the world) and its 4×4 frame in that joint's frame."""

    joint: int
    placement: Array


@dataclass(frozen=True, eq=False)
class TreeJoint(Record):
    """A movable joint of the free system.

    Attributes:
        number: Its number in Pinocchio's model (0 is the world).
        name: Its name.
        kind: What it moves.
        parent: Number of the joint whose body carries it.
        q, v: Where its configuration stands in q′ and its velocity in q̇′.
        placement: Its 4×4 frame at zero displacement in the parent joint's frame.
        axis: Its unit axis, of shape (3,), in its own frame; z where its kind turned that frame or has no axis.
        stated: What the description says of it: limits, damping, friction, spring.
    """

    number: int
    name: str
    kind: JointKind
    parent: int
    q: slice
    v: slice
    placement: Array
    axis: Array
    stated: Joint


@dataclass(frozen=True, eq=False)
class Tree:
    """The free system; its arrays are read-only, also after unpickling.

    Attributes:
        model: Pinocchio model with one joint for each movable joint, in depth-first order.
        joints: The movable joints; number k of `model` is joints[k − 1] (the free-flyer of a floating base included).
        attachments: Where each link sits, by link name.
        names: The movable joints' names, in order.
        scratch: Pinocchio's memory for the model, one pool for all who compute with it: a `pin.Data` of hundreds of
            joints is slow to make and large.
    """

    model: pin.Model
    joints: tuple[TreeJoint, ...]
    attachments: FrozenMapping[str, Attachment]
    names: tuple[str, ...] = field(init=False, repr=False)
    scratch: Scratch = field(init=False, repr=False)
    _numbers: FrozenMapping[str, int] = field(init=False, repr=False)
    _supports: Array = field(init=False, repr=False)

    def __post_init__(self) -> None:
        supports = np.zeros((len(self.joints) + 1, self.model.nv))
        for joint in self.joints:
            supports[joint.number] = supports[joint.parent]
            supports[joint.number, joint.v] = 1.0
        object.__setattr__(self, "_supports", frozen(supports))
        object.__setattr__(self, "scratch", Scratch(self.model))
        object.__setattr__(self, "names", tuple(joint.name for joint in self.joints))
        object.__setattr__(self, "_numbers", FrozenMapping({joint.name: joint.number for joint in self.joints}))

    @property
    def digested(self) -> object:
        """What there is to it but for masses: joints and where links sit (`ccpin.proof.digests`)."""
        joints = [(j.name, j.kind.name, j.parent, j.q.start, j.v.start, j.placement, j.axis) for j in self.joints]
        return joints, self.attachments

    def __repr__(self) -> str:
        return f"Tree({self.model.name!r}, nq = {self.model.nq}, n′ = {self.model.nv})"

    def __reduce__(self) -> tuple[type[Tree], tuple[object, ...]]:
        return Tree, (self.model, self.joints, self.attachments)

    def joint(self, name: str) -> TreeJoint:
        """The movable joint of a name.

        Raises:
            InvalidInputError: There is none.
        """
        if name not in self._numbers:
            raise InvalidInputError(f"'{name}' is not a movable joint; {choices(name, self.names)}")
        return self.joints[self._numbers[name] - 1]

    def split(self, name: str) -> tuple[str, str]:
        """The joint and the component (empty: none) that ``joint`` or ``joint:axis`` names."""
        return split_component(name, self._numbers)

    def support(self, joint: int) -> Array:
        """1.0 for the velocity components between the world and a joint (by number), else 0.0; of shape (n′,)."""
        mask: Array = self._supports[joint]
        return mask


def build_tree(description: MechanismDescription, floating_base: bool = False) -> Tree:
    """Build the Pinocchio model of a description's tree.

    Fixed joints merge their child into the body that carries it; how q′ holds the others is in
    `ccpin.description.joint_kinds`. `floating_base` frees the root link with a joint named ``root_joint``.

    Raises:
        DescriptionError: A joint's name is reserved, or a joint is of no kind that Pinocchio has.
    """
    builder = _Builder(description)
    builder.add_root(floating_base)
    builder.add_subtree(description.root)
    return Tree(builder.model, tuple(builder.joints), FrozenMapping(builder.attachments))


def rest_poses(tree: Tree) -> Array:
    """World poses of the joint frames at zero displacement, of shape (joints + 1, 4, 4); entry 0 is the world."""
    poses = np.empty((len(tree.joints) + 1, 4, 4))
    poses[0] = np.eye(4)
    for joint in tree.joints:
        poses[joint.number] = poses[joint.parent] @ joint.placement
    return poses


class _Builder:
    def __init__(self, description: MechanismDescription) -> None:
        self.description = description
        self.model = pin.Model()
        self.model.name = description.name
        self.model.gravity = pin.Motion(np.array(description.gravity), np.zeros(3))
        self.joints: list[TreeJoint] = []
        self.attachments: dict[str, Attachment] = {}
        self.links = {link.name: link for link in description.links}
        self.joints_of: dict[str, list[Joint]] = {}
        for joint in description.joints:
            self.joints_of.setdefault(joint.parent, []).append(joint)

    def add_root(self, floating_base: bool) -> None:
        carrier, root = Attachment(0, np.eye(4)), self.description.root
        if floating_base:
            carrier = self.add_joint(Joint(ROOT_JOINT, "floating", "", root), carrier)
        self.attach(self.links[root], carrier)

    def attach(self, link: Link, attachment: Attachment) -> None:
        self.attachments[link.name] = attachment
        placement = pin.SE3(attachment.placement)
        inertia = pin.Inertia.Zero()
        if link.inertia is not None:
            inertia = pin.Inertia(link.inertia.mass, np.array(link.inertia.com), np.array(link.inertia.rotational))
        if attachment.joint > 0:
            self.model.appendBodyToJoint(attachment.joint, inertia, placement)
        self.model.addFrame(
            pin.Frame(link.name, attachment.joint, 0, placement, pin.FrameType.BODY, pin.Inertia.Zero()), False
        )

    def add_subtree(self, root: str) -> None:
        """Depth first, with an explicit stack so that no chain is too long."""
        stack = list(reversed(self.joints_of.get(root, [])))
        while stack:
            joint = stack.pop()
            carrier = self.attachments[joint.parent]
            placed = Attachment(carrier.joint, carrier.placement @ joint.placement)
            self.attach(self.links[joint.child], placed if joint.kind == FIXED else self.add_joint(joint, placed))
            stack.extend(reversed(self.joints_of.get(joint.child, [])))

    def add_joint(self, joint: Joint, carrier: Attachment) -> Attachment:
        """Add a movable joint where its frame sits at zero displacement; returns where its child link sits."""
        if self.model.existJointName(joint.name) or joint.name == "universe":
            raise self.fail(joint, "the name is reserved")
        kind, turn = JOINT_KINDS[joint.kind], np.eye(4)
        if kind.turned:
            turn[:3, :3] = rotation_to(joint.axis)
        placement, axis = carrier.placement @ turn, kind.own_axis(joint.axis)
        number = int(self.model.addJoint(carrier.joint, self.pin_joint(joint), pin.SE3(placement), joint.name))
        added = self.model.joints[number]
        q, v = slice(added.idx_q, added.idx_q + kind.nq), slice(added.idx_v, added.idx_v + kind.nv)
        self.joints.append(TreeJoint(number, joint.name, kind, carrier.joint, q, v, placement, axis, joint))
        armature = np.array(self.model.armature)
        lower, upper = np.array(self.model.lowerPositionLimit), np.array(self.model.upperPositionLimit)
        armature[v] = joint.armature
        lower[q], upper[q] = (joint.lower, joint.upper) if kind.nq == 1 else (-np.inf, np.inf)
        self.model.armature, self.model.lowerPositionLimit, self.model.upperPositionLimit = armature, lower, upper
        return Attachment(number, turn.T)

    def pin_joint(self, joint: Joint) -> pin.JointModel:
        """Pinocchio's joint of a description's; the kind's steps composed where the kind names none.

        Raises:
            DescriptionError: Steps that do not commute: Pinocchio's rates of such a joint's Jacobian are wrong.
        """
        kind, axis = JOINT_KINDS[joint.kind], np.array(joint.axis)
        if kind.models:
            return _pin_joint(kind, axis)
        steps = list(zip(kind.directions(axis), kind.slides, strict=True))
        if any(np.any(np.cross(a, b)) and not (s and t) for (a, s), (b, t) in combinations(steps, 2)):
            raise self.fail(joint, f"the steps of a {kind.name} joint do not commute; describe it as several joints")
        composed = pin.JointModelComposite()
        for direction, slides in steps:
            composed.addJoint(_pin_joint(JOINT_KINDS["prismatic" if slides else "revolute"], direction))
        return composed

    def fail(self, joint: Joint, message: str) -> DescriptionError:
        return DescriptionError(message, source=self.description.source, element=f"joint '{joint.name}'")


def _pin_joint(kind: JointKind, axis: Array) -> pin.JointModel:
    names = [f"JointModel{name}" for name in kind.models]
    if len(names) == 1:
        return getattr(pin, names[0])()
    main = int(np.argmax(np.abs(axis)))
    return getattr(pin, names[main])() if np.all(axis == np.eye(3)[main]) else getattr(pin, names[3])(axis)
