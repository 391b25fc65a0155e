"""Sarrus' linkage: two folding pairs of plates at right angles lift the platform straight, h = 2 l sin θ."""

import numpy as np

LENGTH, HALF_WIDTH = 0.20, 0.09
INDEPENDENT = ("lower_a",)
N_FREE = 5
RANK = 4
BOX = np.deg2rad([[15.0, 75.0]])  # of the lower plates over the horizontal


def height(lower):
    """Height of the platform's hinge lines over the base's (m)."""
    return 2.0 * LENGTH * np.sin(lower)


def sigma(lower):
    """All joint displacements: isosceles triangles, the platform level."""
    elbow = np.pi - 2.0 * lower
    return {"lower_a": lower, "upper_a": elbow, "platform_a": lower - np.pi, "lower_b": lower, "upper_b": elbow}


def configuration(p):
    """The parameter is the lower plates' angle."""
    return sigma(p[0])
