"""Bennett's linkage: opposite links equal, a/sin α = b/sin β, half-angle tangents in constant product."""

import numpy as np

LENGTHS = (0.15, 0.30)  # a, b
TWISTS = (np.pi / 6.0, np.pi / 2.0)  # α, β
INDEPENDENT = ("joint1",)
N_FREE = 3
RANK = 2
BOX = np.array([[-np.pi, np.pi]])  # the full turn: no singularity lies on it


def sigma(joint1):
    """All joint displacements, from tan(θ₁/2) tan(θ₂/2) = sin((β+α)/2)/sin((β−α)/2) and θ₃ = −θ₁."""
    alpha, beta = TWISTS
    product = np.sin((beta + alpha) / 2.0) / np.sin((beta - alpha) / 2.0)
    joint2 = 2.0 * np.arctan2(product * np.cos(joint1 / 2.0), np.sin(joint1 / 2.0))
    return {"joint1": joint1, "joint2": joint2, "joint3": -joint1}


def configuration(p):
    """The parameter is the input angle."""
    return sigma(p[0])
