"""Four-bar crank-rocker: Freudenstein's equation, open assembly mode (coupler above the base line)."""

import numpy as np

from .geometry import wrap

GROUND, CRANK, COUPLER, ROCKER = 0.100, 0.040, 0.120, 0.080
INDEPENDENT = ("crank",)
N_FREE = 3
RANK = 2
BOX = np.array([[-np.pi, np.pi]])  # the crank's full turn


def coupler_and_rocker(crank):
    """Absolute angles of coupler and rocker for an absolute crank angle.

    Freudenstein: K₁ cos θ₄ − K₂ cos θ₂ + K₃ = cos(θ₂ − θ₄), a quadratic in tan(θ₄/2) whose smaller root is
    the open mode.
    """
    k1, k2 = GROUND / CRANK, GROUND / ROCKER
    k3 = (CRANK**2 - COUPLER**2 + ROCKER**2 + GROUND**2) / (2.0 * CRANK * ROCKER)
    c, s = np.cos(crank), np.sin(crank)
    a, b, e = c - k1 - k2 * c + k3, -2.0 * s, k1 - (k2 + 1.0) * c + k3
    rocker = 2.0 * np.arctan2(-b - np.sqrt(b * b - 4.0 * a * e), 2.0 * a)
    coupler = np.arctan2(ROCKER * np.sin(rocker) - CRANK * s, GROUND + ROCKER * np.cos(rocker) - CRANK * c)
    return coupler, wrap(rocker)


def sigma(crank):
    """All joint displacements for a crank angle (the coupler's is relative to the crank)."""
    coupler, rocker = coupler_and_rocker(crank)
    return {"crank": crank, "coupler": wrap(coupler - crank), "rocker": rocker}


def configuration(p):
    """The parameter is the crank's angle."""
    return sigma(p[0])
