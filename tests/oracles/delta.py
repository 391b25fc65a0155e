"""Clavel's Delta: forward kinematics by intersecting three spheres, platform below the base and level."""

import numpy as np

from .geometry import rod_angles, rot_z

BASE_SIDE, PLATFORM_SIDE, ARM, FOREARM, SPACING = 0.567, 0.076, 0.524, 1.244, 0.131
BASE_RADIUS = BASE_SIDE * np.sqrt(3.0) / 6.0  # motors: middle of the base triangle's sides
PLATFORM_RADIUS = PLATFORM_SIDE / np.sqrt(3.0)  # forearms: vertices of the platform triangle
YAW = np.array([0.0, 2.0, 4.0]) * np.pi / 3.0
INDEPENDENT = ("arm1", "arm2", "arm3")
N_FREE = 21
RANK = 18
BOX = np.array([[-0.4, 0.7]] * 3)  # arm angles: 23° up, 40° down


def sphere_centres(arms):
    """Elbow midpoints (3, 3), one a row, moved by minus the platform's attachment: |P − cᵢ| = FOREARM."""
    radial = BASE_RADIUS + ARM * np.cos(arms) - PLATFORM_RADIUS
    return np.column_stack([radial * np.cos(YAW), radial * np.sin(YAW), -ARM * np.sin(arms)])


def circumradius(arms):
    """Of the triangles of the three spheres' centres, for arm angles (K, 3), of shape (K,)."""
    centres = np.array([sphere_centres(row) for row in arms])
    one, two = centres[:, 1] - centres[:, 0], centres[:, 2] - centres[:, 0]
    edges = [np.linalg.norm(edge, axis=1) for edge in (one, two, one - two)]
    return np.prod(edges, axis=0) / (2.0 * np.linalg.norm(np.cross(one, two), axis=1))


def forward(arms):
    """Platform position: the lower of the two points at distance FOREARM from the three centres."""
    c1, c2, c3 = sphere_centres(np.asarray(arms))
    e1 = (c2 - c1) / np.linalg.norm(c2 - c1)
    across = (c3 - c1) - e1 * (e1 @ (c3 - c1))
    e2 = across / np.linalg.norm(across)
    e3 = np.cross(e1, e2)
    d, i, j = np.linalg.norm(c2 - c1), e1 @ (c3 - c1), e2 @ (c3 - c1)
    x = d / 2.0
    y = (i * i + j * j - 2.0 * i * x) / (2.0 * j)
    z = np.sqrt(FOREARM**2 - x * x - y * y)
    return c1 + x * e1 + y * e2 - np.copysign(z, e3[2]) * e3


def sigma(arms):
    """All joint displacements for the three arm angles (from the horizontal, positive downwards)."""
    position = forward(arms)
    q_free = dict(zip(("platform_x", "platform_y", "platform_z"), position, strict=True))
    q_free |= {"platform_roll": 0.0, "platform_pitch": 0.0, "platform_yaw": 0.0}
    for leg, (arm, centre, yaw) in enumerate(zip(arms, sphere_centres(np.asarray(arms)), YAW, strict=True), 1):
        pitch, swing = rod_angles(rot_z(yaw).T @ (position - centre))
        q_free[f"arm{leg}"] = arm
        for side in "ab":
            q_free[f"rod{leg}{side}_pitch"] = pitch - arm
            q_free[f"rod{leg}{side}_swing"] = swing
    return q_free


def configuration(p):
    """The parameters are the three arm angles."""
    return sigma(p)
