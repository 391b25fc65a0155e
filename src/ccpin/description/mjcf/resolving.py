"""What MuJoCo resolves by the mass matrix at qpos0: springs and dampers by their times, ratios of damping."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array, FrozenMapping, skew
from ccpin.description.model import IDENTITY, Inertia, Joint, Link, Motor, frame


def inertias_at_reference(
    links: Sequence[Link], joints: Sequence[Joint], reference: Mapping[str, tuple[float, ...]]
) -> dict[str, float]:
    """What a force on each joint alone feels at the reference: 1/(M⁻¹)ᵢᵢ, kg m² or kg; of a ball joint the mean.

    MuJoCo's 1/invweight0. Joints stand with parents before children. There is nothing where M is singular.
    """
    poses = {link.name: IDENTITY for link in links}
    for joint in joints:
        poses[joint.child] = poses[joint.parent] @ joint.placement @ _at(joint, reference.get(joint.name, ()))
    own = {link.name: link.inertia for link in links}
    carried = {name: _in_world(own.get(name), pose) for name, pose in poses.items()}
    motions, rows, above, size = dict[str, Array](), dict[str, slice](), {joint.child: joint for joint in joints}, 0
    for joint in joints:
        motions[joint.name] = _motions(joint, poses[joint.child])
        rows[joint.name] = slice(size, size := size + motions[joint.name].shape[1])
    matrix = np.zeros((size, size))
    for joint in reversed(joints):
        momenta = carried[joint.child] @ motions[joint.name]
        carried[joint.parent] = carried[joint.parent] + carried[joint.child]
        here: Joint | None = joint
        while here is not None:
            block = motions[here.name].T @ momenta
            matrix[rows[here.name], rows[joint.name]], matrix[rows[joint.name], rows[here.name]] = block, block.T
            here = above.get(here.parent)
        own_rows = rows[joint.name]
        matrix[own_rows, own_rows] += joint.armature * np.eye(momenta.shape[1])
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        weights = np.diag(np.linalg.inv(matrix)) if size else np.zeros(0)
        if np.all(np.isfinite(weights)) and np.all(weights > 0.0):
            return {name: 1.0 / float(weights[part].mean()) for name, part in rows.items() if part.start < part.stop}
    return {}


def _in_world(inertia: Inertia | None, pose: Array) -> Array:
    """The spatial inertia (6, 6) about the world's origin, of motions (ω, v)."""
    found = np.zeros((6, 6))
    if inertia is not None:
        turn, com = pose[:3, :3], pose[:3, :3] @ inertia.com + pose[:3, 3]
        across = inertia.mass * skew(com)
        found[:3, :3] = turn @ inertia.rotational @ turn.T - across @ skew(com)
        found[:3, 3:], found[3:, :3] = across, -across
        found[3:, 3:] = inertia.mass * np.eye(3)
    return found


def _motions(joint: Joint, pose: Array) -> Array:
    """What a joint's unit velocities move, (ω, v at the world's origin) by column (6, its velocities)."""
    turn, at = pose[:3, :3], skew(pose[:3, 3])
    if joint.kind == "fixed":
        return np.zeros((6, 0))
    axes = turn if joint.kind in ("spherical", "floating") else (turn @ joint.axis)[:, None]
    sliding, turning = np.vstack([0.0 * axes, axes]), np.vstack([axes, at @ axes])
    if joint.kind == "floating":
        return np.hstack([sliding, turning])
    return sliding if joint.kind == "prismatic" else turning


def sprung(joint: Joint, time: float, ratio: float, inertia: float) -> Joint:
    """The joint with the spring and damper of a time constant (s) and a damping ratio: M/(t r)² and 2 M/t."""
    return replace(joint, stiffness=inertia / max(1e-15, (time * ratio) ** 2), damping=2.0 * inertia / max(1e-15, time))


def damped(motor: Motor, inertia: float) -> Motor:
    """A servo whose damping ratio ζ is resolved: kᵥ = 2 ζ √(k_p M/g²), behind the gear g."""
    gains = dict(motor.gains)
    (ratio, *_), (constant, stiffness, _) = gains.pop("dampratio"), gains["bias"]
    rate = -2.0 * ratio * float(np.sqrt(max(-stiffness, 0.0) * inertia)) / abs(motor.gear)
    return replace(motor, gains=FrozenMapping(gains | {"bias": (constant, stiffness, rate)}))


def _at(joint: Joint, displacement: tuple[float, ...]) -> Array:
    """Where a joint carries its child at a displacement; a ball joint and what is fixed stand at the identity."""
    if joint.kind == "floating" and len(displacement) == 7:
        return frame(displacement[:3], Rotation.from_quat(displacement[3:]).as_matrix())
    return moved(joint.kind, joint.axis, displacement[0]) if len(displacement) == 1 else IDENTITY


def moved(kind: str, axis: Array, displacement: float) -> Array:
    """The transform (4, 4) of a revolute joint (rad) or of a prismatic one (m), the identity where that is zero."""
    if kind == "revolute":
        return frame(np.zeros(3), Rotation.from_rotvec(axis * displacement).as_matrix())
    return frame(axis * displacement)
