"""Planar 3-RRR: closed-form inverse kinematics, every elbow on the same (counter-clockwise) side."""

import numpy as np

from . import planar_3rpr as sextic
from .geometry import wrap

BASE_RADIUS, PLATFORM_RADIUS, PROXIMAL, DISTAL = 0.35, 0.10, 0.20, 0.20
DIRECTIONS = np.deg2rad([90.0, 210.0, 330.0])  # of base pivots and platform pins, from x towards z
INDEPENDENT = ("motor1", "motor2", "motor3")
N_FREE = 9
RANK = 6
BOX = np.array([[-0.03, 0.03], [-0.03, 0.03], [-0.2, 0.2]])  # x, z, θ


def inverse(x, z, theta):
    """All joint displacements for a platform pose (m, m, rad); lies in the plane x-z."""
    q_free = {"platform_x": x, "platform_z": z, "platform_theta": theta}
    for i, phi in enumerate(DIRECTIONS, start=1):
        pivot = BASE_RADIUS * np.array([np.cos(phi), np.sin(phi)])
        pin = np.array([x, z]) + PLATFORM_RADIUS * np.array([np.cos(phi + theta), np.sin(phi + theta)])
        reach = pin - pivot
        span = np.hypot(*reach)
        lead = np.arccos((PROXIMAL**2 + span**2 - DISTAL**2) / (2.0 * PROXIMAL * span))
        motor = np.arctan2(reach[1], reach[0]) + lead
        fore = reach - PROXIMAL * np.array([np.cos(motor), np.sin(motor)])
        q_free[f"motor{i}"] = wrap(motor)
        q_free[f"elbow{i}"] = wrap(np.arctan2(fore[1], fore[0]) - motor)
    return q_free


def configuration(p):
    """The parameters are the platform's x, z and θ."""
    return inverse(*p)


def modes(angles):
    """How many assembly modes three motors' angles (K, 3) have: the knees are the base of a 3-RPR."""
    way = np.exp(1j * DIRECTIONS)
    knees = BASE_RADIUS * way + PROXIMAL * np.exp(1j * angles)
    pins = PLATFORM_RADIUS * way
    shape = knees[:, 1:2] - knees[:, :1], knees[:, 2:] - knees[:, :1], pins[1] - pins[0], pins[2] - pins[0]
    return sextic.modes(np.full((len(angles), 3), DISTAL), shape=shape)
