"""Where to look from: along the normal of a planar mechanism, from three quarters at a spatial one, filling the frame.

Everything here happens in *view axes*: z up (against gravity). `Framing.origin` maps the world to view axes with
the point looked at as origin, because MeshCat's orbit controls always look at the origin of its scene.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from ccpin import loops
from ccpin.description.model import rotation_to
from ccpin.mechanism import Mechanism

Array = NDArray[np.float64]

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
    model = mechanism.pin_model
    data = model.createData()
    pin.computeJointJacobians(model, data, mechanism.q_reference)
    return loops.plane_normal(mechanism.tree, data, list(range(1, model.njoints)))


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
    right = np.cross([0.0, 0.0, 1.0], direction)
    size = np.linalg.norm(right)
    right = right / size if size > 1e-6 else np.array([1.0, 0.0, 0.0])
    screen = np.column_stack([right, np.cross(direction, right), direction])
    x, y, z = (points @ up @ screen).T
    tangent = FILL * np.tan(np.deg2rad(FIELD_OF_VIEW) / 2)
    middle = (z.min() + z.max()) / 2
    (centre_x, near_x), (centre_y, near_y) = _fit(x, z, ASPECT * tangent), _fit(y, z, tangent)
    camera = max(near_x, near_y, z.max() + 0.05 * (np.ptp(z) + 1e-3))
    target = screen @ np.array([centre_x, centre_y, middle])
    origin = np.eye(4)
    origin[:3, :3], origin[:3, 3] = up.T, -target
    depth = camera - z
    half_width, half_height = np.max(np.abs(x - centre_x) / depth), np.max(np.abs(y - centre_y) / depth)
    return Framing(origin, direction, float(camera - middle), float(half_width), float(half_height))


def _fit(x: Array, z: Array, tangent: float) -> tuple[float, float]:
    """Centre and nearest camera height at which |x − centre| ≤ tangent (height − z) for all points."""
    high, low = float(np.max(x + tangent * z)), float(np.max(-x + tangent * z))
    return (high - low) / 2, (high + low) / (2 * tangent)
