"""A mechanism's picture in a MeshCat scene, placed by the forward kinematics of its tree."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.model import Visual, frame, rotation_to
from ccpin.errors import InvalidInputError
from ccpin.kinematics import loops
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.scratch import Scratch
from ccpin.kinematics.tree import rest_poses
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.visualization.page import Command
from ccpin.visualization.shapes import corners, material, missing, parts, triangles, tube
from ccpin.visualization.skeleton import Body, skeleton

FRAMED_SAMPLES = 60
TRACE_COLOUR = (0.85, 0.22, 0.16, 1.0)
HIDDEN = ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX", "/Lights/FillLight")
TOP, BOTTOM = [0.98, 0.985, 0.99], [0.86, 0.89, 0.925]
AMBIENT = 0.5
LIGHTS = {"Key": ([-0.45, 0.9, 1.0], 0.40), "Fill": ([0.9, 0.25, 0.5], 0.22), "Rim": ([0.1, 0.6, -1.0], 0.20)}
"""Directions towards the lights as the camera sees them (right, up, towards the viewer), and their intensities."""


class Scene:
    """The geometry of a mechanism in a `meshcat.Visualizer`, below the node ``/meshcat/<mechanism's name>``.

    Each body has its own node there, named after its link (a slash in a name becomes ``∕``), whose transform is the
    link's frame in the world. The node above turns the world so that z is up and its middle is looked at.
    A mechanism without a drawable visual gets a skeleton of its joints and loops.

    Args:
        mechanism: From `ccpin.load`.
        visualizer: A `meshcat.Visualizer`, with its own server or with a recorder for a window.

    Attributes:
        bodies: What is drawn.
        notes: What could not be drawn, in sentences.
    """

    def __init__(self, mechanism: Mechanism | HasMechanism, visualizer: Any) -> None:
        self.mechanism = mechanism = mechanism_of(mechanism)
        self.visualizer = visualizer
        self.root = visualizer[_node(mechanism.name)]
        self._scratch = Scratch(mechanism.tree.model)
        self.bodies, self.notes = _bodies(mechanism)
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
        """Point the camera so that the mechanism fills the frame over all configurations (T, nq); return how."""
        chosen = q_free[np.unique(np.linspace(0, len(q_free) - 1, FRAMED_SAMPLES).astype(int))]
        held = [np.concatenate([_moved(v.placement, corners(v.shape)) for v in body.visuals]) for body in self.bodies]
        points = [_moved(placement, held[i]) for q in chosen for i, placement in enumerate(self.frames(q))]
        up = up_axes(self.mechanism)
        seen = np.concatenate([*points, np.zeros((0, 3))])
        if not len(seen):
            seen = np.array([[0.5, 0.5, 0.5], [-0.5, -0.5, -0.5]])
        framing = frame_points(seen, view_direction(self.mechanism, up), up)
        self._set_camera(framing)
        return framing

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

    def stop(self) -> None:
        """Forget the animation, if there is one."""
        from meshcat.animation import Animation

        self.visualizer.set_animation(Animation())

    def trace(self, name: str, q_free: Array) -> None:
        """Draw the path of a link's origin, or of a loop's point, over the configurations (T, nq).

        Raises:
            InvalidInputError: No link and no loop has that name.
        """
        joint, point = self._tracked(name)
        points = np.array([joint_poses(self._scratch, q)[joint] @ point for q in q_free])[:, :3]
        spread = float(np.linalg.norm(np.ptp(points, axis=0)))
        mesh = tube(points, max(0.006 * spread, 1e-9))
        if mesh is not None:
            self.root["trace"].set_object(triangles(mesh), material(TRACE_COLOUR))

    def _tracked(self, name: str) -> tuple[int, Array]:
        """The joint that carries a named link or loop point, and the homogeneous point (4,) in its frame."""
        attachments = self.mechanism.tree.attachments
        for closure in self.mechanism.closures if isinstance(name, str) else ():
            if closure.name == name:
                carrier = attachments[closure.link_a]
                return carrier.joint, (carrier.placement @ closure.placement_a)[:, 3]
        if not isinstance(name, str) or name not in attachments:
            loops = ", ".join(closure.name for closure in self.mechanism.closures) or "none"
            raise InvalidInputError(f"trace '{name}' names no link ({', '.join(attachments)}) and no loop ({loops})")
        return attachments[name].joint, attachments[name].placement[:, 3]

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
        self._set_property(camera, "userData", {"fit": [framing.half_width, framing.half_height, FILL]})
        self._set_property(camera, "position", framing.position)
        self._set_lights(framing.direction)

    def _set_property(self, path: str, name: str, value: object) -> None:
        """Set a property by its exact name: MeshCat 0.3's own `set_property` puts names in lower case."""
        self.visualizer.window.send(Command(type="set_property", path=path, property=name, value=value))

    def _set_lights(self, direction: Array) -> None:
        seen = _screen(direction)
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
            self.visualizer.window.send(Command(type="set_object", path=f"/Lights/{name}", object=shown))
            self._set_property(f"/Lights/{name}/<object>", "castShadow", False)


def _bodies(mechanism: Mechanism) -> tuple[tuple[Body, ...], tuple[str, ...]]:
    """What is drawn, a link each or the skeleton, and notes on what is left out."""
    bodies, notes = [], []
    for link in mechanism.description.links:
        drawn: list[Visual] = []
        for visual in link.visuals:
            reason = missing(visual.shape)
            drawn += [visual] if reason is None else []
            notes += [] if reason is None else [f"link '{link.name}': {reason}"]
        if drawn:
            carrier = mechanism.tree.attachments[link.name]
            bodies.append(Body(link.name, carrier.joint, carrier.placement, tuple(drawn)))
    if not bodies:
        notes.append("the file has nothing to draw: a skeleton of joints and loops is shown")
        bodies = skeleton(mechanism)
    return tuple(bodies), tuple(dict.fromkeys(notes))


def _node(name: str) -> str:
    """A name as one level of a MeshCat path, which is split at slashes."""
    return name.replace("/", "\u2215") or "mechanism"


def _moved(frame: Array, points: Array) -> Array:
    return np.asarray(points @ frame[:3, :3].T + frame[:3, 3])


# Where to look from: along the normal of a planar mechanism, from three quarters at a spatial one, filling the frame.


FIELD_OF_VIEW = 30.0
"""Vertical, in degrees; narrow, so that parallel links look parallel."""
FILL = 0.80
"""Share of the frame's height or width, whichever is tighter, that the mechanism's bounding boxes take."""
ASPECT = 1.5
"""Width over height of the window assumed until the page knows its own."""
AZIMUTH, ELEVATION = np.deg2rad(-50.0), np.deg2rad(20.0)


class Framing(NamedTuple):
    """A camera that sees a set of points.

    Attributes:
        origin: 4×4 transform from the world to view axes centred on the point looked at.
        direction: Unit vector (3,) from that point to the camera, in view axes.
        distance: From that point to the camera, in metres.
        half_width, half_height: Tangents of the half angles under which the points appear.
    """

    origin: Array
    direction: Array
    distance: float
    half_width: float
    half_height: float

    @property
    def position(self) -> list[float]:
        """The camera's position in MeshCat's camera axes, whose y is up and z towards the viewer."""
        x, y, z = (float(c) for c in self.distance * self.direction)
        return [x, z, -y]


def plane_normal(mechanism: Mechanism) -> Array | None:
    """Unit normal (3,) in the world of the plane all links move parallel to, or ``None`` if there is none."""
    tree = mechanism.tree
    return loops.plane_normal(tree, rest_poses(tree), range(1, tree.model.njoints))


def up_axes(mechanism: Mechanism) -> Array:
    """Rotation (3, 3) from view axes to the world: its z column points against gravity (world z without gravity)."""
    gravity = np.array(mechanism.description.gravity)
    size = np.linalg.norm(gravity)
    return rotation_to(-gravity / size) if size > 1e-9 else np.eye(3)


def view_direction(mechanism: Mechanism, up: Array) -> Array:
    """Unit vector (3,) in view axes from the mechanism to the camera: from the front, from above, or three quarters."""
    normal = plane_normal(mechanism)
    if normal is None:
        return np.array([np.cos(ELEVATION) * np.cos(AZIMUTH), np.cos(ELEVATION) * np.sin(AZIMUTH), np.sin(ELEVATION)])
    seen = up.T @ normal
    return np.asarray(seen if seen @ np.array([0.5, -1.0, 2.0]) > 0 else -seen)


def frame_points(points: Array, direction: Array, up: Array) -> Framing:
    """The nearest camera along `direction` (view axes) that sees all points (N, 3; world).

    With x to the right, y up the picture and z towards the camera at (c_x, c_y, d), a point is inside the frame iff
    |x − c_x| ≤ τ_x (d − z), so d ≥ (max(x + τ_x z) + max(−x + τ_x z)) / 2τ_x; likewise for y.
    """
    screen = _screen(direction)
    x, y, z = (points @ up @ screen).T
    tangent = FILL * np.tan(np.deg2rad(FIELD_OF_VIEW) / 2)
    middle = (z.min() + z.max()) / 2
    (centre_x, near_x), (centre_y, near_y) = _fit(x, z, ASPECT * tangent), _fit(y, z, tangent)
    camera = max(near_x, near_y, z.max() + 0.05 * (np.ptp(z) + 1e-3))
    target = screen @ np.array([centre_x, centre_y, middle])
    depth = camera - z
    half_width, half_height = np.max(np.abs(x - centre_x) / depth), np.max(np.abs(y - centre_y) / depth)
    return Framing(frame(-target, up.T), direction, float(camera - middle), float(half_width), float(half_height))


def _screen(direction: Array) -> Array:
    """Axes (columns) to the right, up the picture and towards a camera in that direction, all in view axes."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    size = np.linalg.norm(right)
    right = right / size if size > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.column_stack([right, np.cross(direction, right), direction])


def _fit(x: Array, z: Array, tangent: float) -> tuple[float, float]:
    """Centre and nearest camera height at which |x − centre| ≤ tangent (height − z) for all points."""
    high, low = float(np.max(x + tangent * z)), float(np.max(-x + tangent * z))
    return (high - low) / 2, (high + low) / (2 * tangent)
