"""Rotations and angles the closed forms share."""

import numpy as np


def rot_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])


def rot_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rot_z(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def wrap(angle):
    """The same angle in (−π, π]."""
    return np.pi - np.remainder(np.pi - angle, 2.0 * np.pi)


def platform_rotation(roll, pitch, yaw):
    """Rotation of a platform carried by three revolutes about x, then y, then z (moving axes)."""
    return rot_x(roll) @ rot_y(pitch) @ rot_z(yaw)


def rod_angles(direction):
    """The two angles of a rod on a universal joint with axes y, then z, whose rod lies along x at zero.

    Solves (cos β cos γ, sin γ, −sin β cos γ) = direction for |γ| < π/2.
    """
    x, y, z = direction / np.linalg.norm(direction)
    return np.arctan2(-z, x), np.arcsin(y)
