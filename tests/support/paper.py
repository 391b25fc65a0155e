"""The paper's case study as the tests use it: its move, gains and modes, its q′ in the mechanism's order and back."""

import numpy as np

from tests.oracles import rpdr as oracle

START, GOAL = np.radians([-150.0, -160.0]), np.radians([-90.0, -100.0])
K_P, K_V = np.array([11.0, 11.0]), np.array([0.65, 0.60])
FRICTION = {"joint1": (0.2, 0.02), "joint2": (0.2, 0.02)}
MOVE_OPTIONS = ("--start-deg", "-150", "-160", "--goal-deg", "-90", "-100", "--kp", "11", "--kv", "0.65", "0.60")
CURVED = np.array([[0.99, 1.0], [2.2, 2.15]])  # with the isolated point (56.9°, 123.1°) and a piece of the fold
for _array in (START, GOAL, K_P, K_V, CURVED):
    _array.flags.writeable = False

MODES = (1, -1)  # the signs of the closed forms' roots
COUNT = 300  # random configurations a mode


def order(mechanism):
    """Where the paper's q′ sits in the mechanism's."""
    names = list(mechanism.pin_model.names)[1:]
    return [names.index(name) for name in oracle.FREE]


def to_free(mechanism, q_paper):
    """The mechanism's q′ of the paper's."""
    q_free = np.empty(4)
    q_free[order(mechanism)] = q_paper
    return q_free


def to_paper(mechanism, q_free):
    """The paper's q′ of the mechanism's."""
    return q_free[order(mechanism)]
