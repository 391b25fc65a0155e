"""A mechanism's picture in a MeshCat scene, placed by the forward kinematics of its tree."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.model import frame
from ccpin.kinematics.points import joint_poses
from ccpin.mechanism.mechanism import Mechanism
from ccpin.visualization.camera import (
    FIELD_OF_VIEW,
    Framing,
    frame_points,
    presets,
    screen_axes,
    up_axes,
    view_directions,
)
from ccpin.visualization.drawn_bodies import Body, drawn_bodies
from ccpin.visualization.scene_page import SceneCommand
from ccpin.visualization.shapes import material, parts

CAMERA = "/Cameras/default/rotated/<object>"
FRAMED_SAMPLES = 60  # configurations, spread over a motion, that the views are framed for
MARGIN, CLEARANCE = 0.1, 0.02
"""How far the mechanism may leave the frame before it is framed anew, and the ground's distance, of its size."""
HIDDEN = ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX", "/Lights/FillLight")
TOP, BOTTOM = [0.98, 0.985, 0.99], [0.86, 0.89, 0.925]  # of the background
AMBIENT = 0.5  # intensity of the light from everywhere
LIGHTS = {"Key": ([-0.45, 0.9, 1.0], 0.40), "Fill": ([0.9, 0.25, 0.5], 0.22), "Rim": ([0.1, 0.6, -1.0], 0.20)}
"""Directions towards the lights as the camera sees them (right, up, towards the viewer), and their intensities."""


class Scene:
    """The geometry of a mechanism in a `meshcat.Visualizer`, below the node ``/meshcat/<mechanism's name>``.

    Each body has its own node there, named after its link (a slash in a name becomes ``∕``), whose transform is the
    link's frame in the world. The node above turns the world so that z is up, and moves it so that the middle of what
    is framed first is looked at: MeshCat 0.3's controls look at the scene's origin.
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
        self.root = visualizer[node_name(mechanism.name)]
        self._scratch = mechanism.tree.scratch
        self.bodies, self.notes = drawn_bodies(mechanism)
        self._origin: Array | None = None
        self._box: tuple[Array, Array] = (np.zeros(3), np.zeros(3))
        self._set_stage()
        for body in self.bodies:
            self._draw(body)

    def place(self, q_free: Array) -> None:
        """Move all bodies to the configuration q′ of shape (nq,)."""
        for body, placement in zip(self.bodies, self.frames(q_free), strict=True):
            self.root[node_name(body.name)].set_transform(placement)

    def frames(self, q_free: Array) -> Array:
        """World frames of all bodies at q′, of shape (bodies, 4, 4)."""
        poses = joint_poses(self._scratch, q_free)
        return np.array([body.frame(poses) for body in self.bodies]).reshape(-1, 4, 4)

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
        """Tell the views of points (N, 3; world); only the first time move the world, and the camera with it."""
        seen = seen if len(seen) else np.array([[0.5, 0.5, 0.5], [-0.5, -0.5, -0.5]])
        self._box = (seen.min(axis=0), seen.max(axis=0))
        up = up_axes(self.mechanism)
        directions = view_directions(self.mechanism, up)
        framings = {name: frame_points(seen, towards, up) for name, towards in directions.items()}
        framing = framings["iso"]
        if self._origin is None:
            self._origin = framing.origin
            self.root.set_transform(framing.origin)
            self._set_property(CAMERA, "fov", FIELD_OF_VIEW)
            self._set_property(CAMERA, "position", framing.position)
            self._set_lights(framing.direction)
        placed = seen @ self._origin[:3, :3].T + self._origin[:3, 3]
        radius = float(np.linalg.norm(placed, axis=1).max())
        height = float(placed[:, 2].min()) - CLEARANCE * radius
        self.tell("views", presets(framings, self._origin[:3, 3]))
        through = self._origin[:2, 3].tolist()
        self.tell("floor", {"height": height, "radius": radius, "origin": through, "cell": _round_number(radius / 3)})
        self._set_property(CAMERA, "near", 0.01 * framing.distance)
        self._set_property(CAMERA, "far", 100.0 * framing.distance)
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
            animation.clips[self.root[node_name(body.name)].path] = AnimationClip(tracks, fps)
        self.visualizer.set_animation(animation, play=True, repetitions=math.inf if loop else 1)

    def stop(self) -> None:
        """Forget the animation, if there is one, and all that was drawn of its course."""
        from meshcat.animation import Animation

        self.visualizer.set_animation(Animation())
        for name in ("trace", "ghosts", "arrows"):
            self.tell(name, {})

    @property
    def size(self) -> float:
        """Diagonal (m) of the box that all configurations keep within."""
        return float(np.linalg.norm(np.subtract(*self._box))) or 1.0

    def path(self, name: str | None = None) -> str:
        """The MeshCat path of the mechanism, or of a node below it."""
        return str((self.root if name is None else self.root[node_name(name)]).path.lower())

    def _draw(self, body: Body) -> None:
        for number, visual in enumerate(body.visuals):
            for index, part in enumerate(parts(visual.shape)):
                node = self.root[node_name(body.name)][f"visual{number}_{index}" if index else f"visual{number}"]
                node.set_object(part.geometry, material(visual.rgba))
                node.set_transform(visual.placement @ part.placement)

    def _set_stage(self) -> None:
        """A light background without grid and axes, whatever the size of the mechanism."""
        for path in HIDDEN:
            self.visualizer[path].set_property("visible", False)
        self.visualizer["/Background"].set_property("top_color", TOP)
        self.visualizer["/Background"].set_property("bottom_color", BOTTOM)

    def _set_property(self, path: str, name: str, value: object) -> None:
        """Set a property by its exact name: MeshCat 0.3's own `set_property` puts names in lower case."""
        self.visualizer.window.send(SceneCommand(type="set_property", path=path, property=name, value=value))

    def _set_lights(self, direction: Array) -> None:
        """Lights that stand as the first view sees them; the key light alone casts shadows."""
        seen = screen_axes(direction)
        self._set_property("/Lights/AmbientLight/<object>", "intensity", AMBIENT)
        for name, (towards, intensity) in LIGHTS.items():
            light = {
                "uuid": f"light-{name}",
                "type": "DirectionalLight",
                "color": 0xFFFFFF,
                "intensity": intensity,
                "matrix": frame(seen @ np.array(towards)).T.ravel().tolist(),
            }
            shown = {"metadata": {}, "object": light}
            self.visualizer.window.send(SceneCommand(type="set_object", path=f"/Lights/{name}", object=shown))
            self._set_property(f"/Lights/{name}/<object>", "castShadow", name == "Key")


def node_name(name: str) -> str:
    """A name as one level of a MeshCat path, which is split at slashes."""
    return name.replace("/", "\u2215") or "mechanism"


def _round_number(size: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that is at most `size`."""
    power = 10.0 ** math.floor(math.log10(size))
    return float(next(step * power for step in (5, 2, 1) if step * power <= size * (1 + 1e-9)))
