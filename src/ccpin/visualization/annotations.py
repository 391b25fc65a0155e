"""What is drawn beside a mechanism: a point's path, ghosts of poses, names, forces. Each tells the page of a scene."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, vector
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import joint_poses
from ccpin.mechanism.mechanism import Mechanism
from ccpin.visualization.playback import HasForce, resampled
from ccpin.visualization.scene import Scene
from ccpin.visualization.shapes import material, triangles, tube
from ccpin.visualization.stick_figure import ends_of

Tracked: TypeAlias = "str | tuple[str, ArrayLike]"
"""What a trace follows: a link or a loop by name, or (link, point in its frame)."""
TRACE_COLOUR = (0.85, 0.22, 0.16, 1.0)  # a path's
TRACE_RADIUS = 0.0035  # of the mechanism's size
ARROW_LENGTH, ARROW_WIDTH = 0.3, 0.006
"""Of the motion's size: the longest arrow, the radius of its shaft; likewise the radius of a trace."""
GHOSTS = {"start": 0x2970BD, "goal": 0x2E8B57}  # their tints
SAME = 1e-3
"""Two poses look the same if no entry of a frame differs by more than this share of the motion's size."""


def draw_trace(scene: Scene, tracked: Tracked, q_free: Array, every: int = 1) -> None:
    """Draw a point's path over the configurations (T, nq): of a link, of a loop, or of a point of a link.

    A link stands for its centre of mass, a massless one for its origin; a pair is (link, point in its frame, m).
    There is a frame for `every` so many configurations, from the first on.

    Raises:
        InvalidInputError: No link and no loop has that name, or the point is not three finite numbers.
    """
    joint, point = _tracked(scene.mechanism, tracked)
    scratch = scene.mechanism.tree.scratch
    points = np.array([joint_poses(scratch, q)[joint] @ point for q in q_free])[:, :3]
    path = tube(points, TRACE_RADIUS * scene.size)
    if path is not None:
        scene.root["trace"].set_object(triangles(path.mesh), material(TRACE_COLOUR))
        scene.tell("trace", {"path": scene.path("trace"), "ends": path.ends[::every].tolist()})


def draw_ghosts(scene: Scene, poses: Mapping[str, Array]) -> None:
    """Show the mechanism seen through at configurations (nq,) by name, start or goal; one of two that agree."""
    told: list[dict[str, Any]] = []
    drawn: list[Array] = []
    for name, pose in poses.items():
        frames = scene.frames(pose)
        if any(np.abs(frames - other).max() < SAME * scene.size for other in drawn):
            continue
        drawn.append(frames)
        moving = [(b, f) for b, f in zip(scene.bodies, frames, strict=True) if b.joint > 0 and b.visuals]
        bodies = {scene.path(body.name): f.T.ravel().tolist() for body, f in moving}
        told.append({"name": name, "tint": GHOSTS[name], "bodies": bodies})
    scene.tell("ghosts", {"root": scene.path(), "poses": told})


def name_joints(scene: Scene) -> None:
    """Write the names of motors, other joints and loops where they are."""
    mechanism = scene.mechanism
    carriers = {body.joint: body for body in reversed(scene.bodies) if body.joint > 0}
    places = [
        ("motor" if joint.name in mechanism.actuated else "joint", joint.name, joint.number, np.eye(4))
        for joint in mechanism.tree.joints
    ]
    for closure in mechanism.closures:
        moving = [("loop", closure.name, joint, at) for joint, at in ends_of(mechanism, closure) if joint > 0]
        places += moving[:1]
    labels = []
    for kind, text, joint, placement in places:
        body = carriers[joint]
        point = (np.linalg.inv(body.placement) @ placement)[:3, 3].tolist()
        labels.append({"kind": kind, "text": text, "path": scene.path(body.name), "point": point})
    scene.tell("labels", {"labels": labels})


def draw_forces(scene: Scene, forces: Sequence[HasForce], times: Array) -> None:
    """Draw forces at the moments `times` (T,) of the frames, as arrows from where they act, all on one scale.

    Raises:
        InvalidInputError: One is no force, or has points or forces that are not of shape (its times, 3) or not finite.
    """
    if not isinstance(forces, Sequence) or not all(hasattr(force, "force") for force in forces):
        raise InvalidInputError("forces must be a sequence of what closure_forces or joint_forces return")
    if not forces:
        return
    told, largest = [], 0.0
    for force in forces:
        points, vectors = (resampled(force, name, times) for name in ("point", "force"))
        largest = max(largest, float(np.linalg.norm(vectors, axis=1).max()))
        told.append({"name": force.name, "points": points.tolist(), "forces": vectors.tolist()})
    scale, width = ARROW_LENGTH * scene.size / (largest or 1.0), ARROW_WIDTH * scene.size
    scene.tell("arrows", {"root": scene.path(), "forces": told, "scale": scale, "width": width})


def _tracked(mechanism: Mechanism, tracked: Tracked) -> tuple[int, Array]:
    """The joint that carries a link, a loop's point or a link's point; the homogeneous point (4,) in its frame."""
    attachments = mechanism.tree.attachments
    name, given = tracked if isinstance(tracked, tuple) and len(tracked) == 2 else (tracked, None)
    for closure in mechanism.closures if given is None and isinstance(name, str) else ():
        if closure.name == name:
            carrier = attachments[closure.link_a]
            return carrier.joint, (carrier.placement @ closure.placement_a)[:, 3]
    if not isinstance(name, str) or name not in attachments:
        loops = ", ".join(closure.name for closure in mechanism.closures) or "none"
        raise InvalidInputError(f"trace '{name}' names no link ({', '.join(attachments)}) and no loop ({loops})")
    inertia = next(link.inertia for link in mechanism.description.links if link.name == name)
    middle = inertia.com if inertia is not None and inertia.mass > 0 else np.zeros(3)
    point = middle if given is None else vector(given, "trace's point", 3)
    return attachments[name].joint, attachments[name].placement @ np.append(point, 1.0)
