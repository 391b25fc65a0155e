"""Pierrot's Hexa: closed-form inverse kinematics, every elbow outwards and the platform below the base."""

import numpy as np

from .geometry import platform_rotation, rod_angles, rot_z

BASE_RADIUS, BASE_HALF_SPACING, ARM = 0.20, 0.12, 0.30
PLATFORM_RADIUS, PLATFORM_HALF_SPACING, ROD = 0.08, 0.05, 0.70
YAW = np.repeat([0.0, 2.0, 4.0], 2) * np.pi / 3.0  # legs 1-2, 3-4, 5-6 share a side
SIDE = np.tile([-1.0, 1.0], 3)
INDEPENDENT = tuple(f"arm{leg}" for leg in range(1, 7))
N_FREE = 24
RANK = 18
BOX = np.array([[-0.08, 0.08], [-0.08, 0.08], [-0.68, -0.52], [-0.2, 0.2], [-0.2, 0.2], [-0.2, 0.2]])  # m, rad


def inverse(position, roll, pitch, yaw):
    """All joint displacements for a platform pose.

    In the frame of a leg's motor, with d from the motor to the rod's end on the platform, the arm's angle
    solves d_x cos θ − d_z sin θ = (|d|² + ARM² − ROD²)/(2 ARM).
    """
    q_free = dict(zip(("platform_x", "platform_y", "platform_z"), position, strict=True))
    q_free |= {"platform_roll": roll, "platform_pitch": pitch, "platform_yaw": yaw}
    rotation = platform_rotation(roll, pitch, yaw)
    for leg, (turn, side) in enumerate(zip(YAW, SIDE, strict=True), 1):
        side_frame = rot_z(turn)
        motor = side_frame @ np.array([BASE_RADIUS, side * BASE_HALF_SPACING, 0.0])
        pin = rotation @ side_frame @ np.array([PLATFORM_RADIUS, side * PLATFORM_HALF_SPACING, 0.0])
        d = side_frame.T @ (position + pin - motor)
        reach = np.hypot(d[0], d[2])
        cosine = (d @ d + ARM**2 - ROD**2) / (2.0 * ARM * reach)
        arm = np.arctan2(-d[2], d[0]) - np.arccos(cosine)
        bend, swing = rod_angles(d - ARM * np.array([np.cos(arm), 0.0, -np.sin(arm)]))
        q_free |= {f"arm{leg}": arm, f"rod{leg}_pitch": bend - arm, f"rod{leg}_swing": swing}
    return q_free


def configuration(p):
    """The parameters are the platform's x, y, z, roll, pitch and yaw (moving axes)."""
    return inverse(p[:3], *p[3:])
