"""Closures placed in the tree: who carries each end, their nearest common ancestor, and what planarity proves.

A loop is planar if every revolute axis on it is parallel to one direction n, every prismatic axis is
perpendicular to it and no other joint lies on it. All its links then move parallel to the plane ⟂ n in every
configuration, so rows that measure displacement along n, or a direction against n, are constant: they are
dropped by proof, not by numerical rank at one configuration. Rows that are redundant for any other reason
(Bennett's or Sarrus' linkage) are all kept; ψ is then judged by rank.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.model import LoopClosure
from ccpin.kinematics.rows import PARALLEL, DirectionRow, KindRows, PlaneNormal, rows_of
from ccpin.kinematics.tree import Tree


class Loop(NamedTuple):
    """One closure, resolved.

    Attributes:
        closure: What was declared.
        joint_a, joint_b: Indices of the joints that carry the two ends (0: the world).
        ancestor: Index of their nearest common ancestor joint C (0: the world).
        frame_a, frame_b: 4×4 closure frames in those joints' frames.
        path_a, path_b: 1.0 for velocity components between C and the end, else 0.0; shape (n′,).
        basis: E of the point row, in C, of shape (k, 3); k = 2 where the loop is planar, 0 without point rows.
        rows: The other rows, in the closure's frames A and B.
        normal: Plane normal of a planar loop in C, or ``None``.
        size: Number of rows.
    """

    closure: LoopClosure
    joint_a: int
    joint_b: int
    ancestor: int
    frame_a: Array
    frame_b: Array
    path_a: Array
    path_b: Array
    basis: Array
    rows: KindRows
    normal: Array | None
    size: int


def resolve_loop(tree: Tree, closure: LoopClosure, reduce_planar: bool = True) -> Loop:
    """Place a closure in the tree; with `reduce_planar` drop the rows that planarity proves constant."""
    model = tree.model
    carrier_a, carrier_b = tree.attachments[closure.link_a], tree.attachments[closure.link_b]
    frame_a, frame_b = carrier_a.placement @ closure.placement_a, carrier_b.placement @ closure.placement_b
    supports_a, supports_b = list(model.supports[carrier_a.joint]), list(model.supports[carrier_b.joint])
    shared = [a for a, b in zip(supports_a, supports_b, strict=False) if a == b]
    path_a = _velocity_mask(model, supports_a[len(shared) :])
    path_b = _velocity_mask(model, supports_b[len(shared) :])
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    on_loop = supports_a[len(shared) :] + supports_b[len(shared) :]
    normal = plane_normal(tree, data, on_loop) if reduce_planar else None
    hint = PlaneNormal()
    if normal is not None:
        turn_a = data.oMi[carrier_a.joint].rotation @ frame_a[:3, :3]
        turn_b = data.oMi[carrier_b.joint].rotation @ frame_b[:3, :3]
        hint = PlaneNormal(turn_a.T @ normal, turn_b.T @ normal)
        normal = data.oMi[shared[-1]].rotation.T @ normal
    rows = rows_of(closure, hint)
    basis = np.zeros((0, 3))
    if rows.point:
        basis = np.eye(3) if normal is None else _in_plane(normal)
    if normal is not None:
        rows = _without_constant_rows(rows, hint)
    size = len(basis) + len(rows.directions) + len(rows.offsets) + (rows.distance is not None)
    return Loop(
        closure,
        carrier_a.joint,
        carrier_b.joint,
        int(shared[-1]),
        frame_a,
        frame_b,
        path_a,
        path_b,
        basis,
        rows,
        normal,
        size,
    )


def is_turned(loop: Loop, data: pin.Data) -> bool:
    """Whether the axes of a closure with direction rows are turned end for end, after forward kinematics."""
    rotation_a = data.oMi[loop.joint_a].rotation @ loop.frame_a[:3, :3]
    rotation_b = data.oMi[loop.joint_b].rotation @ loop.frame_b[:3, :3]
    return any((rotation_a @ a) @ (rotation_b @ b) <= 0 for a, b in loop.rows.alignment)


def _velocity_mask(model: pin.Model, joints: list[int]) -> Array:
    mask = np.zeros(model.nv)
    for joint in joints:
        mask[model.idx_vs[joint] : model.idx_vs[joint] + model.nvs[joint]] = 1.0
    return mask


def plane_normal(tree: Tree, data: pin.Data, joints: list[int]) -> Array | None:
    """Unit normal (3,) in the world of the plane the joints' bodies move parallel to, or ``None`` if there is none.

    Args:
        tree: The free system.
        data: After Pinocchio's `computeJointJacobians` at any configuration.
        joints: Indices of the joints on the loop, or of all joints.
    """
    jacobian = data.J
    rotations, translations = [], []
    for joint in joints:
        placed = tree.joints[joint - 1]
        for column, slides in enumerate(placed.kind.slides, placed.v.start):
            if slides:
                translations.append(jacobian[:3, column])
            else:
                rotations.append(jacobian[3:, column])
    if not rotations:
        return None
    normal = rotations[0]
    parallel = all(np.linalg.norm(np.cross(normal, axis)) < PARALLEL for axis in rotations)
    in_plane = all(abs(normal @ axis) < PARALLEL for axis in translations)
    return np.array(normal) if parallel and in_plane else None


def _in_plane(normal: Array) -> Array:
    """Two unit vectors spanning the plane, the coordinate axes where they do."""
    main = int(np.argmax(np.abs(normal)))
    axes = [np.eye(3)[i] for i in range(3) if i != main]
    first = axes[0] - (axes[0] @ normal) * normal
    first = first / np.linalg.norm(first)
    second = np.cross(normal, first) * (1.0 if main == 2 or main == 0 else -1.0) * np.sign(normal[main])
    return np.vstack([first, second])


def _without_constant_rows(rows: KindRows, normal: PlaneNormal) -> KindRows:
    def along(vector: Array, other: Array | None) -> bool:
        return other is not None and float(np.linalg.norm(np.cross(vector, other))) < PARALLEL

    def varies(row: DirectionRow) -> bool:
        return not all(along(a, normal.a) or along(b, normal.b) for _, a, b in row.products)

    return rows._replace(
        directions=tuple(row for row in rows.directions if varies(row)),
        offsets=tuple(a for a in rows.offsets if not along(a, normal.a)),
    )
