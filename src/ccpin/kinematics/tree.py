"""The free system Σ′ as a Pinocchio model: a description's tree, cut open at every loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, Record
from ccpin.description.model import Joint, Link, MechanismDescription, rotation_to
from ccpin.errors import DescriptionError

ROOT_JOINT = "root_joint"
ONE_DOF = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True, eq=False)
class Attachment(Record):
    """Where a link sits: the movable joint that carries it (0: the world) and its 4×4 frame in that joint's frame."""

    joint: int
    placement: Array


@dataclass(frozen=True, eq=False)
class Tree(Record):
    """The free system.

    Attributes:
        model: Pinocchio model (for reading only) with one joint for each movable joint, in depth-first order.
        attachments: Where each link sits, by link name.
        kinds: Kind of each movable joint, by joint name (the free-flyer of a floating base included).
    """

    model: pin.Model
    attachments: Mapping[str, Attachment]
    kinds: Mapping[str, str]

    def __repr__(self) -> str:
        return f"Tree({self.model.name!r}, nq = {self.model.nq}, n′ = {self.model.nv})"


def build_tree(description: MechanismDescription, floating_base: bool = False) -> Tree:
    """Build the Pinocchio model of a description's tree.

    Fixed joints merge their child into the body that carries it. A continuous joint has nq = 2 (cosine, sine),
    a spherical joint a unit quaternion (x, y, z, w), planar (x, y, cosine, sine), floating position and
    quaternion. `floating_base` frees the root link with a joint named ``root_joint``.

    Raises:
        DescriptionError: A moving body has no mass anywhere beyond its joint.
    """
    builder = _Builder(description)
    builder.add_root(floating_base)
    builder.add_subtree(description.root)
    return Tree(builder.model, builder.attachments, builder.kinds)


class _Builder:
    def __init__(self, description: MechanismDescription) -> None:
        self.description = description
        self.model = pin.Model()
        self.model.name = description.name
        self.model.gravity = pin.Motion(np.array(description.gravity), np.zeros(3))
        self.attachments: dict[str, Attachment] = {}
        self.kinds: dict[str, str] = {}
        self.links = {link.name: link for link in description.links}
        self.joints_of: dict[str, list[Joint]] = {}
        for joint in description.joints:
            self.joints_of.setdefault(joint.parent, []).append(joint)

    def add_root(self, floating_base: bool) -> None:
        joint_id = 0
        if floating_base:
            joint_id = self.model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), ROOT_JOINT)
            self.kinds[ROOT_JOINT] = "floating"
        self.attach(self.links[self.description.root], Attachment(joint_id, np.eye(4)))

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
            placement = carrier.placement @ joint.placement
            if joint.kind == "fixed":
                attachment = Attachment(carrier.joint, placement)
            else:
                turn = _turn(joint)
                attachment = Attachment(self.add_joint(joint, carrier.joint, placement @ turn), turn.T)
            self.attach(self.links[joint.child], attachment)
            stack.extend(reversed(self.joints_of.get(joint.child, [])))

    def add_joint(self, joint: Joint, parent: int, placement: Array) -> int:
        if self.model.existJointName(joint.name) or joint.name == "universe":
            raise DescriptionError(
                "the name is reserved", source=self.description.source, element=f"joint '{joint.name}'"
            )
        joint_id = self.model.addJoint(parent, _joint_model(joint), pin.SE3(placement), joint.name)
        self.kinds[joint.name] = joint.kind
        added = self.model.joints[joint_id]
        armature = np.array(self.model.armature)
        armature[added.idx_v : added.idx_v + added.nv] = joint.armature
        self.model.armature = armature
        self.set_limits(joint, added)
        return int(joint_id)

    def set_limits(self, joint: Joint, added: pin.JointModel) -> None:
        lower, upper = np.array(self.model.lowerPositionLimit), np.array(self.model.upperPositionLimit)
        window = slice(added.idx_q, added.idx_q + added.nq)
        lower[window], upper[window] = (joint.lower, joint.upper) if added.nq == 1 else (-np.inf, np.inf)
        self.model.lowerPositionLimit, self.model.upperPositionLimit = lower, upper


def _joint_model(joint: Joint) -> pin.JointModel:
    axis = np.array(joint.axis)
    main = int(np.argmax(np.abs(axis)))
    aligned = bool(np.all(axis == np.eye(3)[main]))
    if joint.kind == "revolute":
        exact = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)[main]
        return exact() if aligned else pin.JointModelRevoluteUnaligned(axis)
    if joint.kind == "continuous":
        return pin.JointModelRUBZ()
    if joint.kind == "prismatic":
        exact = (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)[main]
        return exact() if aligned else pin.JointModelPrismaticUnaligned(axis)
    return {
        "spherical": pin.JointModelSpherical,
        "planar": pin.JointModelPlanar,
        "floating": pin.JointModelFreeFlyer,
    }[joint.kind]()


def _turn(joint: Joint) -> Array:
    """The 4×4 rotation that turns z into the axis of a planar or continuous joint (identity for other kinds)."""
    turn = np.eye(4)
    if joint.kind in ("planar", "continuous"):
        turn[:3, :3] = rotation_to(joint.axis)
    return turn
