"""The geometry of one cluster as parameters: what its loops' rows make of small changes of joint and closure frames.

A change moves the fixed frame of every joint on a loop and both frames of every closure by a twist ξ in that frame's
own axes, X → X exp(ξ), and the length of every distance closure. Such a motion does to a row what the same motion of
the bodies beyond it does, so the derivatives are the rows' wrenches again: ∂φ_i/∂ξ = f·Ad(X), f the wrenches of the
ends that X carries.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.description.model import IDENTITY, Joint, LoopClosure, MechanismDescription, frame, rotation_to
from ccpin.kinematics.clusters import ClusterTree
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import Tree


class Change(NamedTuple):
    """A change of geometry.

    Attributes:
        joints: 4×4 motions of the joints' fixed frames in their own axes, by joint name.
        ends: Of the frames A and B of each closure, by its name.
        lengths: Added to the lengths of distance closures, m, by their names.
    """

    joints: dict[str, Array]
    ends: dict[str, tuple[Array, Array]]
    lengths: dict[str, float]

    def end(self, closure: str) -> tuple[Array, Array]:
        """The motions of a closure's two frames."""
        return self.ends.get(closure, (IDENTITY, IDENTITY))

    def largest(self, size: float) -> tuple[str, float]:
        """The frame changed most, in words, and by how much, m: its shift plus its turn times a size."""
        moved = {f"joint '{name}'": _extent(motion, size) for name, motion in self.joints.items()}
        for name, motions in self.ends.items():
            moved[f"closure '{name}'"] = max(_extent(motion, size) for motion in motions)
        for name, added in self.lengths.items():
            moved[f"closure '{name}'"] = max(abs(added), moved[f"closure '{name}'"])
        frame = max(moved, key=lambda name: moved[name])
        return frame, moved[frame]


class ClusterGeometry(NamedTuple):
    """A cluster with some geometry, and its φ (`shape_of`)."""

    part: ClusterTree
    constraints: Constraints


def shape_of(part: ClusterTree) -> ClusterGeometry:
    """A cluster with all rows of its closures, also those that planarity makes superfluous."""
    return ClusterGeometry(part, Constraints(part.tree, part.closures, part.couplings, reduce_planar=False))


class Relations(NamedTuple):
    """Axes made parallel.

    Attributes:
        change: The turns of joints' and closures' frames.
        joints: Joints whose frames must not turn any more, by name.
        ends: Closures whose frames must not, by name and end (0: A, 1: B).
    """

    change: Change
    joints: set[str]
    ends: set[tuple[str, int]]


NO_RELATIONS = Relations(Change({}, {}, {}), set(), set())


class Geometry:
    """The parameters p of a cluster's geometry: six for every frame, in metres (a turn times the cluster's size).

    Args:
        shape: The cluster with its geometry as it is to begin with.
        size: Its size, m.
        relations: What is changed first, and the frames that must not turn after that.
    """

    def __init__(self, shape: ClusterGeometry, size: float, relations: Relations) -> None:
        self.start, self.relations = shape, relations
        loops = shape.constraints.loops
        on_loop = sorted({joint for loop in loops for joint in (*loop.path_a, *loop.path_b)})
        self.joints = on_loop
        self.rods = [closure.name for closure in shape.part.closures if closure.length is not None]
        self.frames = len(on_loop) + 2 * len(loops)
        self.count = 6 * self.frames + len(self.rods)
        names = [shape.part.tree.joints[joint - 1].name for joint in on_loop]
        fixed = [name in relations.joints for name in names]
        fixed += [(loop.closure.name, end) in relations.ends for loop in loops for end in (0, 1)]
        self._held = np.array([(*[False] * 3, *[held] * 3) for held in fixed]).reshape(-1)
        self._units = np.array([1.0, 1.0, 1.0, 1.0 / size, 1.0 / size, 1.0 / size])

    def jacobian(self, shape: ClusterGeometry, at: ConstraintValue) -> Array:
        """∂φ/∂p at a configuration, of shape (m, count), zero for what must not turn.

        For p small: exp(ξ + dξ) = exp(ξ) exp(dξ) to first order.
        """
        part, constraints = shape
        rows, jacobian = constraints.row_slices(), np.zeros((constraints.size, self.count))
        poses = joint_poses(constraints.scratch, at.q_free)
        fixed = {j: poses[part.tree.joints[j - 1].parent] @ part.tree.joints[j - 1].placement for j in self.joints}
        on_a, on_b = np.split(at.placed.wrenches, 2)
        column = 6 * len(self.joints)
        for loop in constraints.loops:
            here = rows[loop.closure.name]
            for k, joint in enumerate(self.joints):
                for path, wrenches in ((loop.path_a, on_a), (loop.path_b, on_b)):
                    if joint in path:
                        jacobian[here, 6 * k : 6 * k + 6] = wrenches[here] @ self._twists(fixed[joint])
            ends = (loop.joint_a, loop.frame_a, on_a), (loop.joint_b, loop.frame_b, on_b)
            for joint, placement, wrenches in ends:
                jacobian[here, column : column + 6] = wrenches[here] @ self._twists(poses[joint] @ placement)
                column += 6
        for k, rod in enumerate(self.rods):  # φ = (|gap|² − L²) / 2L
            length = next(loop.closure.length for loop in constraints.loops if loop.closure.name == rod)
            jacobian[rows[rod], column + k] = -1.0 - at.phi[rows[rod]] / (length or 1.0)
        jacobian[:, : len(self._held)][:, self._held] = 0.0
        return jacobian

    def change(self, p: Array) -> Change:
        """The change that parameters of shape (count,) stand for."""
        frames, added = p[: self.count - len(self.rods)], p[self.count - len(self.rods) :]
        motions = [np.array(pin.exp6(pin.Motion(xi)).homogeneous) for xi in frames.reshape(-1, 6) * self._units]
        joints, ends = motions[: len(self.joints)], iter(motions[len(self.joints) :])
        names = [self.start.part.tree.joints[joint - 1].name for joint in self.joints]
        first = self.relations.change
        pairs = {closure.name: (next(ends), next(ends)) for closure in self.start.part.closures}
        return Change(
            {name: first.joints.get(name, IDENTITY) @ motion for name, motion in zip(names, joints, strict=True)},
            {name: (before[0] @ a, before[1] @ b) for name, (a, b) in pairs.items() for before in (first.end(name),)},
            dict(zip(self.rods, added.tolist(), strict=True)),
        )

    def shape(self, p: Array) -> ClusterGeometry:
        """The cluster with that geometry."""
        part, change = self.start.part, self.change(p)
        tree, model = part.tree, part.tree.model.copy()
        joints = tuple(
            replace(joint, placement=joint.placement @ change.joints.get(joint.name, IDENTITY)) for joint in tree.joints
        )
        for joint in joints:
            model.jointPlacements[joint.number] = pin.SE3(np.array(joint.placement))
        changed = part._replace(
            tree=Tree(model, joints, tree.attachments),
            closures=tuple(_changed_closure(closure, change) for closure in part.closures),
        )
        return shape_of(changed)

    def _twists(self, pose: Array) -> Array:
        """Ad(X) per unit of a frame's six parameters, of shape (6, 6)."""
        return np.asarray(pin.SE3(pose).action * self._units)


def changed(description: MechanismDescription, change: Change) -> MechanismDescription:
    """The description with that geometry."""
    return replace(
        description,
        joints=tuple(_changed_joint(joint, change) for joint in description.joints),
        closures=tuple(_changed_closure(closure, change) for closure in description.closures),
    )


def _changed_joint(joint: Joint, change: Change) -> Joint:
    """A change is in the axes of the tree's joint frame, which its kind may have turned."""
    if joint.name not in change.joints:
        return joint
    turn = frame(np.zeros(3), rotation_to(joint.axis)) if JOINT_KINDS[joint.kind].turned else IDENTITY
    return replace(joint, placement=joint.placement @ turn @ change.joints[joint.name] @ turn.T)


def _changed_closure(closure: LoopClosure, change: Change) -> LoopClosure:
    if closure.name not in change.ends:
        return closure
    motion_a, motion_b = change.ends[closure.name]
    return replace(
        closure,
        placement_a=closure.placement_a @ motion_a,
        placement_b=closure.placement_b @ motion_b,
        length=None if closure.length is None else closure.length + change.lengths[closure.name],
    )


def _extent(motion: Array, size: float) -> float:
    twist = pin.log6(pin.SE3(motion)).vector
    return float(np.linalg.norm(twist[:3]) + size * np.linalg.norm(twist[3:]))
