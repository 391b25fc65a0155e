"""A mechanism's picture in a MeshCat scene, placed by the forward kinematics of its tree."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, TypeAlias

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ccpin.arrays import Array, vector
from ccpin.description.model import frame
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.scratch import Scratch
from ccpin.mechanism.mechanism import Mechanism
from ccpin.visualization.bodies import Body, drawn_bodies
from ccpin.visualization.camera import (
    FIELD_OF_VIEW,
    Framing,
    frame_points,
    presets,
    screen_axes,
    up_axes,
    view_directions,
)
from ccpin.visualization.page import Command
from ccpin.visualization.playback import HasForce, resampled
from ccpin.visualization.shapes import material, parts, triangles, tube

Tracked: TypeAlias = "str | tuple[str, ArrayLike]"
"""What a trace follows: a link or a loop by name, or (link, point in its frame)."""
FRAMED_SAMPLES = 60
MARGIN, CLEARANCE = 0.1, 0.02
"""How far the mechanism may leave the frame before it is framed anew, and the ground's distance, of its size."""
TRACE_COLOUR, TRACE_RADIUS = (0.85, 0.22, 0.16, 1.0), 0.0035
ARROW_LENGTH, ARROW_WIDTH = 0.3, 0.006
"""Of the motion's size: the longest arrow, the radius of its shaft; likewise the radius of a trace."""
GHOSTS = {"start": 0x2970BD, "goal": 0x2E8B57}
SAME = 1e-3
"""Two poses look the same if no entry of a frame differs by more than this share of the motion's size."""
HIDDEN = ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX", "/Lights/FillLight")
TOP, BOTTOM = [0.98, 0.985, 0.99], [0.86, 0.89, 0.925]
AMBIENT = 0.5
LIGHTS = {"Key": ([-0.45, 0.9, 1.0], 0.40), "Fill": ([0.9, 0.25, 0.5], 0.22), "Rim": ([0.1, 0.6, -1.0], 0.20)}
"""Directions towards the lights as the camera sees them (right, up, towards the viewer), and their intensities."""


class Scene:
    """The geometry of a mechanism in a `meshcat.Visualizer`, below the node ``/meshcat/<mechanism's name>``.

    Each body has its own node there, named after its link (a slash in a name becomes ``∕``), whose transform is the
    link's frame in the world. The node above turns the world so that z is up and its middle is looked at.
    What the file does not draw is drawn as solid links between joints and loops.

    Args:
        mechanism: From `ccpin.load`.
        visualizer: A `meshcat.Visualizer`, with its own server or with a recorder for a window.

    Attributes:
        bodies: What is drawn.
        notes: What could not be drawn, in sentences.
    """

    def __init__(self, mechanism: Mechanism, visualizer: Any) -> None:
        self.mechanism = mechanism
        self.visualizer = visualizer
        self.root = visualizer[_node(mechanism.name)]
        self._scratch = Scratch(mechanism.tree.model)
        self.bodies, self.notes = drawn_bodies(mechanism)
        self._box: tuple[Array, Array] = (np.zeros(3), np.zeros(3))
        self._set_stage()
        for body in self.bodies:
            self._draw(body)

    def place(self, q_free: Array) -> None:
        """Move all bodies to the configuration q′ of shape (nq,)."""
        for body, placement in zip(self.bodies, self.frames(q_free), strict=True):
            self.root[_node(body.name)].set_transform(placement)

    def frames(self, q_free: Array) -> Array:
        """World frames of all bodies at q′, of shape (bodies, 4, 4)."""
        poses = joint_poses(self._scratch, q_free)
        return np.array([poses[body.joint] @ body.placement for body in self.bodies]).reshape(-1, 4, 4)

    def frame_camera(self, q_free: Array) -> Framing:
        """Choose the views so that the mechanism fills the frame over all configurations (T, nq); return the first."""
        chosen = q_free[np.unique(np.linspace(0, len(q_free) - 1, FRAMED_SAMPLES).astype(int))]
        return self._frame(np.concatenate([self._seen_at(q) for q in chosen]))

    def keep_in_frame(self, q_free: Array) -> None:
        """Choose the views anew if the mechanism leaves the frame at the configuration q′ of shape (nq,)."""
        seen = self._seen_at(q_free)
        low, high = (np.array(end) for end in self._box)
        margin = MARGIN * np.linalg.norm(high - low)
        if len(seen) and (np.any(seen < low - margin) or np.any(seen > high + margin)):
            self._frame(np.concatenate([seen, list(product(*zip(low, high, strict=True)))]))

    def _seen_at(self, q_free: Array) -> Array:
        frames = self.frames(q_free)
        points = [body.corners @ f[:3, :3].T + f[:3, 3] for body, f in zip(self.bodies, frames, strict=True)]
        return np.concatenate([*points, np.zeros((0, 3))])

    def _frame(self, seen: Array) -> Framing:
        seen = seen if len(seen) else np.array([[0.5, 0.5, 0.5], [-0.5, -0.5, -0.5]])
        self._box = (seen.min(axis=0), seen.max(axis=0))
        up = up_axes(self.mechanism)
        framings = {
            name: frame_points(seen, towards, up) for name, towards in view_directions(self.mechanism, up).items()
        }
        framing = framings["iso"]
        inside = seen @ framing.origin[:3, :3].T + framing.origin[:3, 3]
        radius = float(np.linalg.norm(inside, axis=1).max())
        height = float(inside[:, 2].min()) - CLEARANCE * radius
        self.tell("views", presets(framings))
        origin = framing.origin[:2, 3].tolist()
        self.tell("floor", {"height": height, "radius": radius, "origin": origin, "cell": _round_number(radius / 3)})
        self._set_camera(framing)
        self._set_lights(framing.direction, radius)
        return framing

    def tell(self, name: str, said: dict[str, Any]) -> None:
        """Give the page something to know: its scripts read it as ``told(name)``; other MeshCat windows ignore it."""
        self._set_property(f"/ccpin/{name}", "userData", said)

    def animate(self, q_free: Array, fps: float, loop: bool = True) -> None:
        """Play the configurations (T, nq), one a frame, from the first on; `loop` starts over at the end."""
        from meshcat.animation import Animation, AnimationClip, AnimationTrack

        frames = np.array([self.frames(q) for q in q_free])
        numbers = list(range(len(q_free)))
        animation = Animation(default_framerate=fps)
        for index, body in enumerate(self.bodies):
            if body.joint == 0:
                continue
            quaternions = [pin.Quaternion(rotation).coeffs().tolist() for rotation in frames[:, index, :3, :3]]
            tracks = {
                "position": AnimationTrack("position", "vector3", numbers, frames[:, index, :3, 3].tolist()),
                "quaternion": AnimationTrack("quaternion", "quaternion", numbers, quaternions),
            }
            animation.clips[self.root[_node(body.name)].path] = AnimationClip(tracks, fps)
        self.visualizer.set_animation(animation, play=True, repetitions=math.inf if loop else 1)
        self._ghosts({"start": q_free[0], "goal": q_free[-1]})

    def _ghosts(self, poses: dict[str, Array]) -> None:
        """Tell where the mechanism is seen through, by name; of two poses that agree one is left out."""
        told: list[dict[str, Any]] = []
        drawn: list[Array] = []
        for name, pose in poses.items():
            frames = self.frames(pose)
            if any(np.abs(frames - other).max() < SAME * self._size for other in drawn):
                continue
            drawn.append(frames)
            moving = [(b, f) for b, f in zip(self.bodies, frames, strict=True) if b.joint > 0 and b.visuals]
            bodies = {self._path(_node(body.name)): f.T.ravel().tolist() for body, f in moving}
            told.append({"name": name, "tint": GHOSTS[name], "bodies": bodies})
        self.tell("ghosts", {"root": self._path(), "poses": told})

    def stop(self) -> None:
        """Forget the animation, if there is one."""
        from meshcat.animation import Animation

        self.visualizer.set_animation(Animation())

    def trace(self, tracked: Tracked, q_free: Array, every: int = 1) -> None:
        """Draw a point's path over the configurations (T, nq): of a link, of a loop, or of a point of a link.

        A link stands for its centre of mass, a massless one for its origin; a pair is (link, point in its frame, m).
        There is a frame for `every` so many configurations, from the first on.

        Raises:
            InvalidInputError: No link and no loop has that name, or the point is not three finite numbers.
        """
        joint, point = self._tracked(tracked)
        points = np.array([joint_poses(self._scratch, q)[joint] @ point for q in q_free])[:, :3]
        path = tube(points, TRACE_RADIUS * self._size)
        if path is not None:
            self.root["trace"].set_object(triangles(path.mesh), material(TRACE_COLOUR))
            self.tell("trace", {"path": self._path("trace"), "ends": path.ends[::every].tolist()})

    def label(self) -> None:
        """Name joints, motors and loops at their places."""
        names = {body.joint: _node(body.name) for body in reversed(self.bodies) if body.joint > 0}
        attachments = self.mechanism.tree.attachments
        labels = []
        for joint in self.mechanism.tree.joints:
            kind = "motor" if joint.name in self.mechanism.actuated else "joint"
            at = np.linalg.inv(self._placement(names[joint.number]))[:3, 3]
            labels.append(
                {"kind": kind, "text": joint.name, "path": self._path(names[joint.number]), "point": at.tolist()}
            )
        for closure in self.mechanism.closures:
            carrier = attachments[closure.link_a]
            if carrier.joint > 0:
                node = names[carrier.joint]
                at = (np.linalg.inv(self._placement(node)) @ carrier.placement @ closure.placement_a)[:3, 3]
                labels.append({"kind": "loop", "text": closure.name, "path": self._path(node), "point": at.tolist()})
        self.tell("labels", {"labels": labels})

    def forces(self, arrows: Sequence[HasForce], times: Array) -> None:
        """Draw forces at the moments `times` (T,) of the frames, as arrows from where they act, all on one scale.

        Raises:
            InvalidInputError: One has points or forces that are not of shape (its times, 3), or not finite.
        """
        told, largest = [], 0.0
        if not isinstance(arrows, Sequence) or not all(hasattr(arrow, "force") for arrow in arrows):
            raise InvalidInputError("forces must be a sequence of what closure_forces or joint_forces return")
        if not arrows:
            return
        for arrow in arrows:
            points, vectors = (resampled(arrow, name, times) for name in ("point", "force"))
            largest = max(largest, float(np.linalg.norm(vectors, axis=1).max()))
            told.append({"name": arrow.name, "points": points.tolist(), "forces": vectors.tolist()})
        scale = ARROW_LENGTH * self._size / (largest or 1.0)
        width = ARROW_WIDTH * self._size
        self.tell("arrows", {"root": self._path(), "forces": told, "scale": scale, "width": width})

    @property
    def _size(self) -> float:
        """Diagonal (m) of the box that all configurations keep within."""
        return float(np.linalg.norm(np.subtract(*self._box))) or 1.0

    def _path(self, *names: str) -> str:
        node = self.root
        for name in names:
            node = node[name]
        return str(node.path.lower())

    def _placement(self, node: str) -> Array:
        return next(body.placement for body in self.bodies if _node(body.name) == node)

    def _tracked(self, tracked: Tracked) -> tuple[int, Array]:
        """The joint that carries a link, a loop's point or a link's point; the homogeneous point (4,) in its frame."""
        attachments = self.mechanism.tree.attachments
        name, given = tracked if isinstance(tracked, tuple) and len(tracked) == 2 else (tracked, None)
        for closure in self.mechanism.closures if given is None and isinstance(name, str) else ():
            if closure.name == name:
                carrier = attachments[closure.link_a]
                return carrier.joint, (carrier.placement @ closure.placement_a)[:, 3]
        if not isinstance(name, str) or name not in attachments:
            loops = ", ".join(closure.name for closure in self.mechanism.closures) or "none"
            raise InvalidInputError(f"trace '{name}' names no link ({', '.join(attachments)}) and no loop ({loops})")
        inertia = next(link.inertia for link in self.mechanism.description.links if link.name == name)
        middle = inertia.com if inertia is not None and inertia.mass > 0 else np.zeros(3)
        point = middle if given is None else vector(given, "trace's point", 3)
        return attachments[name].joint, attachments[name].placement @ np.append(point, 1.0)

    def _draw(self, body: Body) -> None:
        for number, visual in enumerate(body.visuals):
            for index, part in enumerate(parts(visual.shape)):
                node = self.root[_node(body.name)][f"visual{number}_{index}" if index else f"visual{number}"]
                node.set_object(part.geometry, material(visual.rgba))
                node.set_transform(visual.placement @ part.placement)

    def _set_stage(self) -> None:
        """A light background without grid and axes, whatever the size of the mechanism."""
        for path in HIDDEN:
            self.visualizer[path].set_property("visible", False)
        self.visualizer["/Background"].set_property("top_color", TOP)
        self.visualizer["/Background"].set_property("bottom_color", BOTTOM)

    def _set_camera(self, framing: Framing) -> None:
        """Move the world rather than the camera's target: MeshCat 0.3's controls look at the scene's origin."""
        self.root.set_transform(framing.origin)
        camera = "/Cameras/default/rotated/<object>"
        self._set_property(camera, "fov", FIELD_OF_VIEW)
        self._set_property(camera, "near", 0.01 * framing.distance)
        self._set_property(camera, "far", 100.0 * framing.distance)
        self._set_property(camera, "position", framing.position)

    def _set_property(self, path: str, name: str, value: object) -> None:
        """Set a property by its exact name: MeshCat 0.3's own `set_property` puts names in lower case."""
        self.visualizer.window.send(Command(type="set_property", path=path, property=name, value=value))

    def _set_lights(self, direction: Array, radius: float) -> None:
        """Lights that stand as the first view sees them; the key light's shadows reach as far as the motion does."""
        seen = screen_axes(direction)
        self._set_property("/Lights/AmbientLight/<object>", "intensity", AMBIENT)
        for name, (towards, intensity) in LIGHTS.items():
            away = 4 * radius * np.array(towards) / np.linalg.norm(towards)
            light = {
                "uuid": f"light-{name}",
                "type": "DirectionalLight",
                "color": 0xFFFFFF,
                "intensity": intensity,
                "matrix": frame(seen @ away).T.ravel().tolist(),
            }
            if name == "Key":
                light["shadow"] = _shadow(radius)
            shown = {"metadata": {}, "object": light}
            self.visualizer.window.send(Command(type="set_object", path=f"/Lights/{name}", object=shown))
            self._set_property(f"/Lights/{name}/<object>", "castShadow", name == "Key")


def _shadow(radius: float) -> dict[str, Any]:
    """A soft shadow of all within `radius` (m) of what is looked at, and of where it falls on the ground."""
    reach = 1.6 * radius
    sides = {"left": -reach, "right": reach, "top": reach, "bottom": -reach, "near": radius, "far": 9 * radius}
    camera = {"uuid": "shadow-camera", "type": "OrthographicCamera", "zoom": 1, **sides}
    bias = {"bias": -2e-4, "normalBias": 4e-3 * radius, "radius": 3}
    return {**bias, "mapSize": [1024, 1024], "camera": camera}


def _node(name: str) -> str:
    """A name as one level of a MeshCat path, which is split at slashes."""
    return name.replace("/", "\u2215") or "mechanism"


def _round_number(size: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most `size`."""
    power = 10.0 ** math.floor(math.log10(size))
    return float(next(step * power for step in (5, 2, 1) if step * power <= size * (1 + 1e-9)))
