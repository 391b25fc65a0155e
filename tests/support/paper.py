"""The paper's case study as the tests use it: its modes, and its q′ in the mechanism's order and back."""

import numpy as np

from tests.oracles import rpdr as oracle

MODES = (1, -1)
COUNT = 1000


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
