"""Closures placed in the tree: who carries each end, their nearest common ancestor, and what planarity proves.

A loop is planar if every revolute axis on it is parallel to one direction n, every prismatic axis is
perpendicular to it and no other joint lies on it. All its links then move parallel to the plane ⟂ n in every
configuration, so rows that measure displacement along n, or a direction against n, are constant: they are
dropped by proof, not by numerical rank at one configuration. Rows that are redundant for any other reason
(Bennett's or Sarrus' linkage) are all kept; ψ is then judged by rank.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.closure_kinds import PARALLEL, LoopRows, PlaneNormal, rows_of
from ccpin.description.model import LoopClosure
from ccpin.kinematics.tree import Tree


class ResolvedClosure(NamedTuple):
    """One closure, placed.

    Attributes:
        closure: What was declared.
        joint_a, joint_b: Indices of the joints that carry the two ends (0: the world).
        ancestor: Index of their nearest common ancestor joint C (0: the world).
        frame_a, frame_b: 4×4 closure frames in those joints' frames.
        path_a, path_b: The joints between C and each end, root first.
        mask_a, mask_b: 1.0 for their velocity components, else 0.0, of shape (n′,).
        rows: Its rows of φ.
        normal: Plane normal of a planar loop in C, or ``None``.
    """

    closure: LoopClosure
    joint_a: int
    joint_b: int
    ancestor: int
    frame_a: Array
    frame_b: Array
    path_a: tuple[int, ...]
    path_b: tuple[int, ...]
    mask_a: Array
    mask_b: Array
    rows: LoopRows
    normal: Array | None

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.rows.rows)


def resolve_closures(
    tree: Tree, closures: Iterable[LoopClosure], reduce_planar: bool = True
) -> tuple[ResolvedClosure, ...]:
    """Place closures in the tree; with `reduce_planar` drop the rows that planarity proves constant."""
    data = tree.model.createData()
    pin.computeJointJacobians(tree.model, data, pin.neutral(tree.model))
    return tuple(_resolve(tree, data, closure, reduce_planar) for closure in closures)


def _resolve(tree: Tree, data: pin.Data, closure: LoopClosure, reduce_planar: bool) -> ResolvedClosure:
    carrier_a, carrier_b = tree.attachments[closure.link_a], tree.attachments[closure.link_b]
    frame_a, frame_b = carrier_a.placement @ closure.placement_a, carrier_b.placement @ closure.placement_b
    supports_a, supports_b = (list(tree.model.supports[carrier.joint]) for carrier in (carrier_a, carrier_b))
    shared = [a for a, b in zip(supports_a, supports_b, strict=False) if a == b]
    path_a, path_b = (tuple(int(j) for j in supports[len(shared) :]) for supports in (supports_a, supports_b))
    normal = PlaneNormal()
    world = plane_normal(tree, data, (*path_a, *path_b)) if reduce_planar else None
    if world is not None:
        turns = [data.oMi[joint].rotation for joint in (carrier_a.joint, carrier_b.joint, shared[-1])]
        frames = (turns[0] @ frame_a[:3, :3], turns[1] @ frame_b[:3, :3], turns[2])
        normal = PlaneNormal(*(np.asarray(frame.T @ world) for frame in frames))
    return ResolvedClosure(
        closure=closure,
        joint_a=carrier_a.joint,
        joint_b=carrier_b.joint,
        ancestor=int(shared[-1]),
        frame_a=frame_a,
        frame_b=frame_b,
        path_a=path_a,
        path_b=path_b,
        mask_a=tree.support(carrier_a.joint) - tree.support(shared[-1]),
        mask_b=tree.support(carrier_b.joint) - tree.support(shared[-1]),
        rows=rows_of(closure, normal),
        normal=normal.C,
    )


def plane_normal(tree: Tree, data: pin.Data, joints: Iterable[int]) -> Array | None:
    """Unit normal (3,) in the world of the plane the joints' bodies move parallel to, or ``None`` if there is none.

    Args:
        tree: The free system.
        data: After Pinocchio's `computeJointJacobians` at any configuration.
        joints: Indices of the joints on the loop, or of all joints.
    """
    turns, slides = list[Array](), list[Array]()
    for joint in joints:
        for column in data.J[:, tree.joints[joint - 1].v].T:
            turning = float(np.linalg.norm(column[3:])) > PARALLEL
            (turns if turning else slides).append(column[3:] if turning else column[:3])
    if not turns:
        return None
    normal = np.array(turns[0])
    parallel = all(np.linalg.norm(np.cross(normal, axis)) < PARALLEL for axis in turns)
    return normal if parallel and all(abs(normal @ axis) < PARALLEL for axis in slides) else None
