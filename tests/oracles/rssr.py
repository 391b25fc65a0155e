"""The RSSR linkage of tests/support/files/rssr.urdf in closed form, its rod's spin left out: one equation of motion.

The rod is symmetric about its line, so while it does not spin its kinetic energy is that of its centre's velocity and
of its direction's rate. Angles: θ of the crank, φ of the rocker.
"""

import numpy as np

G = 9.81
CRANK, ROCKER, ROD = 0.1, 0.3, 0.492443
PIVOT = np.array([0.4, 0.25, 0.0])
ROD_MASS, ROD_CENTRE, ROD_ACROSS = 0.3, 0.246221 / ROD, 0.0060652
CRANK_INERTIA = 0.0004 + 0.4 * 0.05**2
ROCKER_INERTIA, ROCKER_MOMENT = 0.0046 + 0.6 * 0.15**2, 0.6 * 0.15


def crank_end(theta):
    return CRANK * np.array([np.cos(theta), np.sin(theta), 0.0])


def rocker_end(phi):
    return PIVOT + ROCKER * np.array([np.sin(phi), 0.0, np.cos(phi)])


def rocker_angle(theta, branch=1.0):
    """φ of |A − B| = rod: |w|² + r² + 2r (w_x sin φ + w_z cos φ) = L² with w from the crank's end to the pivot."""
    w = PIVOT - crank_end(theta)
    reach = np.hypot(w[0], w[2])
    cosine = (ROD**2 - w @ w - ROCKER**2) / (2.0 * ROCKER * reach)
    phi = np.arctan2(w[0], w[2]) + branch * np.arccos(cosine)
    return np.remainder(phi + np.pi, 2 * np.pi) - np.pi


def rates(theta, phi):
    """dA/dθ, dB/dφ and dφ/dθ, from (B − A)·(Ḃ − Ȧ) = 0."""
    a = CRANK * np.array([-np.sin(theta), np.cos(theta), 0.0])
    b = ROCKER * np.array([np.cos(phi), 0.0, -np.sin(phi)])
    along = rocker_end(phi) - crank_end(theta)
    return a, b, float(along @ a) / float(along @ b)


def inertia(theta, branch=1.0):
    """D(θ): twice the kinetic energy at θ̇ = 1."""
    phi = rocker_angle(theta, branch)
    a, b, ratio = rates(theta, phi)
    b = b * ratio
    centre, direction = (1.0 - ROD_CENTRE) * a + ROD_CENTRE * b, (b - a) / ROD
    rod = ROD_MASS * centre @ centre + ROD_ACROSS * direction @ direction
    return CRANK_INERTIA + ROCKER_INERTIA * ratio**2 + rod


def potential(theta, branch=1.0):
    """V(θ) with gravity along −z."""
    phi = rocker_angle(theta, branch)
    return G * (ROCKER_MOMENT * np.cos(phi) + ROD_MASS * ROD_CENTRE * ROCKER * np.cos(phi))


def slope(function, theta, branch):
    """dF/dθ by sixth-order differences."""
    h = 2e-3
    weights = {1: 45.0, 2: -9.0, 3: 1.0}
    change = sum(w * (function(theta + k * h, branch) - function(theta - k * h, branch)) for k, w in weights.items())
    return change / (60.0 * h)
