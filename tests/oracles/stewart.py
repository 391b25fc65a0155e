"""Gough-Stewart 6-UPS: closed-form inverse kinematics (six leg vectors), platform above the base."""

import numpy as np

from .geometry import rot_x, rot_y, rot_z, wrap

BASE_RADIUS, PLATFORM_RADIUS, CYLINDER = 0.40, 0.25, 0.42
BASE_ANGLES = np.deg2rad([-45.0, 45.0, 75.0, 165.0, 195.0, 285.0])
PLATFORM_ANGLES = np.deg2rad([-15.0, 15.0, 105.0, 135.0, 225.0, 255.0])
INDEPENDENT = tuple(f"leg{leg}_extension" for leg in range(1, 7))
N_FREE = 21
RANK = 15
BOX = np.array([[-0.05, 0.05], [-0.05, 0.05], [0.40, 0.50], [-0.2, 0.2], [-0.2, 0.2], [-0.2, 0.2]])  # m, rad


def leg_vectors(position, rotation):
    """Vectors (6, 3) from the base joints to the platform joints."""
    ring = np.zeros((6, 3))
    base, platform = ring.copy(), ring.copy()
    base[:, 0], base[:, 1] = np.cos(BASE_ANGLES), np.sin(BASE_ANGLES)
    platform[:, 0], platform[:, 1] = np.cos(PLATFORM_ANGLES), np.sin(PLATFORM_ANGLES)
    return position + PLATFORM_RADIUS * platform @ rotation.T - BASE_RADIUS * base


def inverse(position, rotation):
    """All joint displacements for a platform pose.

    A leg points along R_z(φ) R_x(a) R_y(b) e_z with φ the direction of its base joint; the platform's rotation is
    R_z(φ₁) R_x(a₁) R_y(b₁) · R_y(c) R_x(d) R_z(e − φ₁), which gives c, d, e.
    """
    q_free = {}
    for leg, (vector, phi) in enumerate(zip(leg_vectors(position, rotation), BASE_ANGLES, strict=True), 1):
        length = np.linalg.norm(vector)
        x, y, z = rot_z(phi).T @ vector / length
        q_free[f"leg{leg}_roll"] = np.arctan2(-y, z)
        q_free[f"leg{leg}_pitch"] = np.arcsin(x)
        q_free[f"leg{leg}_extension"] = length - CYLINDER
    phi = BASE_ANGLES[0]
    carrier = rot_z(phi) @ rot_x(q_free["leg1_roll"]) @ rot_y(q_free["leg1_pitch"])
    ball = carrier.T @ rotation
    q_free["platform_pitch"] = np.arctan2(ball[0, 2], ball[2, 2])
    q_free["platform_roll"] = -np.arcsin(ball[1, 2])
    q_free["platform_yaw"] = wrap(np.arctan2(ball[1, 0], ball[1, 1]) + phi)
    return q_free


def configuration(p):
    """The parameters are the platform's x, y, z, roll, pitch and yaw (fixed axes)."""
    roll, pitch, yaw = p[3:]
    return inverse(p[:3], rot_z(yaw) @ rot_y(pitch) @ rot_x(roll))
