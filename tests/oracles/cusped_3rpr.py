"""A planar 3-RPR parallel robot with its first leg locked: it changes assembly mode without meeting a singularity.

Dimensions of C. Innocenti and V. Parenti-Castelli, "Singularity-free evolution from one configuration to another in
serial and fully-parallel manipulators", Journal of Mechanical Design 120 (1998), ten of its units to the metre, first
leg 1.498 m. Unknowns are the locked leg's angle and the platform's; the lengths of the other legs are a function of
these, folded and, at isolated points, cusped: about a cusp two solutions of the same sign of det are connected.
"""

import numpy as np
from scipy.optimize import fsolve

BASE2, BASE3 = np.array([1.591, 0.0]), np.array([0.0, 1.0])
LEG1, SIDE12, SIDE23, SIDE13 = 1.498, 1.704, 1.654, 2.084
CORNER = np.arccos((SIDE12**2 + SIDE13**2 - SIDE23**2) / (2.0 * SIDE12 * SIDE13))
NEAR_CUSP = np.array([1.99, -2.145])


def leg_vectors(pose):
    """From the base joints of legs 2 and 3 to the platform's corners, rows of (2, 2)."""
    leg, turn = pose
    corner = LEG1 * np.array([np.cos(leg), np.sin(leg)])
    second = corner + SIDE12 * np.array([np.cos(turn), np.sin(turn)])
    third = corner + SIDE13 * np.array([np.cos(turn + CORNER), np.sin(turn + CORNER)])
    return np.array([second - BASE2, third - BASE3])


def lengths(pose):
    """(ρ2, ρ3)."""
    return np.linalg.norm(leg_vectors(pose), axis=1)


def jacobian(pose):
    """∂(ρ2, ρ3)/∂(leg, turn)."""
    leg, turn = pose
    first = LEG1 * np.array([-np.sin(leg), np.cos(leg)])
    arms = np.array([SIDE12 * np.array([-np.sin(turn), np.cos(turn)])])
    arms = np.vstack([arms, SIDE13 * np.array([-np.sin(turn + CORNER), np.cos(turn + CORNER)])])
    units = leg_vectors(pose) / lengths(pose)[:, None]
    return np.column_stack([units @ first, np.sum(units * arms, axis=1)])


def null_direction(pose):
    """The direction in which the lengths do not change to first order, where det = 0."""
    j = jacobian(pose)
    return np.array([-j[0, 1], j[0, 0]])


def cusp():
    """The pose at which det = 0 and its derivative along the null direction vanishes."""
    step = 1e-5

    def conditions(pose):
        slope = [np.linalg.det(jacobian(pose + s * step * null_direction(pose))) for s in (1.0, -1.0)]
        return np.array([np.linalg.det(jacobian(pose)), (slope[0] - slope[1]) / (2.0 * step)])

    return fsolve(conditions, NEAR_CUSP, xtol=1e-12)


def displacements(pose):
    """Joint displacements by name."""
    second, third = leg_vectors(pose)
    return {
        "leg": pose[0],
        "turn": pose[1] - pose[0],
        "swing2": np.arctan2(second[1], second[0]),
        "rho2": np.hypot(*second),
        "swing3": np.arctan2(third[1], third[0]),
        "rho3": np.hypot(*third),
    }
