"""Where to look from: presets from which a mechanism's whole motion fills the frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import frame, rotation_to
from ccpin.kinematics import loops
from ccpin.kinematics.tree import rest_poses
from ccpin.mechanism.mechanism import Mechanism

FIELD_OF_VIEW = 30.0
"""Vertical, in degrees; narrow, so that parallel links look parallel."""
FILL = 0.80
"""Share of the frame's height or width, whichever is tighter, that the mechanism's bounding boxes take."""
ASPECT = 1.5
"""Width over height of the window assumed until the page knows its own."""
AZIMUTH, ELEVATION = np.deg2rad(-50.0), np.deg2rad(20.0)  # of the view of three quarters
PLANAR_AZIMUTH, PLANAR_ELEVATION = np.deg2rad(24.0), np.deg2rad(14.0)
"""From the normal of an upright plane: nearly square on, and yet one sees what lies before what."""
UPRIGHT = 0.7
"""A plane is upright if the vertical part of its unit normal is below this."""


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
        return camera_axes(self.distance * self.direction)

    @property
    def fit(self) -> list[float]:
        """What a page needs to zoom a window of any shape: both half sizes and the share of the frame to fill."""
        return [self.half_width, self.half_height, FILL]


def camera_axes(point: Array) -> list[float]:
    """A point (3,) of view axes in MeshCat's camera axes, whose y is up and z towards the viewer."""
    x, y, z = (float(c) for c in point)
    return [x, z, -y]


def presets(framings: Mapping[str, Framing], origin: Array) -> dict[str, dict[str, list[float]]]:
    """Target, position and fit of each view, in camera axes of a scene that is moved by `origin` (3,; view axes)."""
    told = {}
    for name, framing in framings.items():
        target = origin - framing.origin[:3, 3]
        position = target + framing.distance * framing.direction
        told[name] = {"target": camera_axes(target), "position": camera_axes(position), "fit": framing.fit}
    return told


def plane_normal(mechanism: Mechanism) -> Array | None:
    """Unit normal (3,) in the world of the plane all links move parallel to, or ``None`` if there is none."""
    tree = mechanism.tree
    return loops.plane_normal(tree, rest_poses(tree), range(1, tree.model.njoints))


def up_axes(mechanism: Mechanism) -> Array:
    """Rotation (3, 3) from view axes to the world: its z column points against gravity (world z without gravity)."""
    gravity = np.array(mechanism.description.gravity)
    size = np.linalg.norm(gravity)
    return rotation_to(-gravity / size) if size > 1e-9 else np.eye(3)


def view_directions(mechanism: Mechanism, up: Array) -> dict[str, Array]:
    """Unit vectors (3,) in view axes from the mechanism to the camera: ``iso`` (three quarters), front, side, top.

    A mechanism that moves in an upright plane is seen square on from the front, all others from −y, as a drawing
    shows them.
    """
    top, front = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    iso = _towards(np.array([1.0, 0.0, 0.0]), -front, AZIMUTH, ELEVATION)
    normal = plane_normal(mechanism)
    if normal is not None and abs((up.T @ normal) @ top) < UPRIGHT:
        seen = up.T @ normal
        front = np.asarray(seen if seen @ np.array([0.5, -1.0, 2.0]) > 0 else -seen)
        iso = _towards(front, np.cross(top, front), PLANAR_AZIMUTH, PLANAR_ELEVATION)
    side = np.cross(top, front)
    return {"iso": iso, "front": front, "side": side / np.linalg.norm(side), "top": top}


def _towards(ahead: Array, left: Array, azimuth: float, elevation: float) -> Array:
    """The unit vector turned from `ahead` by `azimuth` to the left and raised by `elevation` (rad)."""
    level = np.cos(azimuth) * ahead + np.sin(azimuth) * left
    direction = np.cos(elevation) * level + np.sin(elevation) * np.array([0.0, 0.0, 1.0])
    return np.asarray(direction / np.linalg.norm(direction))


def frame_points(points: Array, direction: Array, up: Array) -> Framing:
    """The nearest camera along `direction` (view axes) that sees all points (N, 3; world).

    With x to the right, y up the picture and z towards the camera at (c_x, c_y, d), a point is inside the frame iff
    |x − c_x| ≤ τ_x (d − z), so d ≥ (max(x + τ_x z) + max(−x + τ_x z)) / 2τ_x; likewise for y.
    """
    screen = screen_axes(direction)
    x, y, z = (points @ up @ screen).T
    tangent = FILL * np.tan(np.deg2rad(FIELD_OF_VIEW) / 2)
    middle = (z.min() + z.max()) / 2
    (centre_x, near_x), (centre_y, near_y) = _fit(x, z, ASPECT * tangent), _fit(y, z, tangent)
    camera = max(near_x, near_y, z.max() + 0.05 * (np.ptp(z) + 1e-3))
    target = screen @ np.array([centre_x, centre_y, middle])
    depth = camera - z
    half_width, half_height = np.max(np.abs(x - centre_x) / depth), np.max(np.abs(y - centre_y) / depth)
    return Framing(frame(-target, up.T), direction, float(camera - middle), float(half_width), float(half_height))


def screen_axes(direction: Array) -> Array:
    """Axes (columns) to the right, up the picture and towards a camera in that direction, all in view axes."""
    right = np.cross([0.0, 0.0, 1.0], direction)
    size = np.linalg.norm(right)
    right = right / size if size > 1e-6 else np.array([1.0, 0.0, 0.0])
    return np.column_stack([right, np.cross(direction, right), direction])


def _fit(x: Array, z: Array, tangent: float) -> tuple[float, float]:
    """Centre and nearest camera height at which |x − centre| ≤ tangent (height − z) for all points."""
    high, low = float(np.max(x + tangent * z)), float(np.max(-x + tangent * z))
    return (high - low) / 2, (high + low) / (2 * tangent)
