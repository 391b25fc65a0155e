"""A mechanism as lines and points in space: joints, the bodies between them, and where the loops close."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array
from ccpin.kinematics.points import joint_poses
from ccpin.mechanism.mechanism import Mechanism


class Outline(NamedTuple):
    """World coordinates in metres.

    Attributes:
        segments: Straight lines along the bodies, of shape (k, 2, 3).
        bodies: The moving joint that carries each segment (0: the world), of shape (k,).
        joints: Joint origins, of shape (j, 3).
        loops: Loop closure points (end A), of shape (l, 3).
    """

    segments: Array
    bodies: NDArray[np.int64]
    joints: Array
    loops: Array


def outline(mechanism: Mechanism, q_free: Array) -> Outline:
    """The lines and points of a configuration, of shape (nq,)."""
    model = mechanism.tree.model
    poses = joint_poses(mechanism.tree.scratch, np.asarray(q_free, dtype=np.float64))
    origins = poses[:, :3, 3]
    segments, bodies, loops = [], [], []
    for joint in range(1, model.njoints):
        parent = model.parents[joint]
        if parent > 0:
            segments.append((origins[parent], origins[joint]))
            bodies.append(parent)
    for loop in mechanism.constraints().loops:
        for joint, frame in ((loop.joint_a, loop.frame_a), (loop.joint_b, loop.frame_b)):
            if joint > 0:
                segments.append((origins[joint], (poses[joint] @ frame[:, 3])[:3]))
                bodies.append(joint)
        loops.append((poses[loop.joint_a] @ loop.frame_a[:, 3])[:3])
    return Outline(
        np.array(segments, dtype=np.float64).reshape(-1, 2, 3),
        np.array(bodies, dtype=np.int64),
        origins[1:],
        np.array(loops, dtype=np.float64).reshape(-1, 3),
    )


def plane_of_motion(mechanism: Mechanism) -> Array | None:
    """Two unit vectors (2, 3) spanning the plane all loops move parallel to, or ``None`` for a spatial mechanism."""
    loops = mechanism.constraints().loops
    normals = [loop.normal for loop in loops if loop.ancestor == 0]
    if not loops or len(normals) < len(loops) or any(normal is None for normal in normals):
        return None
    first = np.asarray(normals[0])
    if any(np.linalg.norm(np.cross(first, np.asarray(normal))) > 1e-6 for normal in normals):
        return None
    gravity = np.asarray(mechanism.description.gravity, dtype=np.float64)
    up = -gravity + (gravity @ first) * first
    if np.linalg.norm(up) < 1e-6:
        up = np.array([0.0, 1.0, 0.0]) - first[1] * first
    up = up / np.linalg.norm(up)
    right = np.cross(up, first)
    return np.vstack([right * (1.0 if right[int(np.argmax(np.abs(right)))] > 0 else -1.0), up])
