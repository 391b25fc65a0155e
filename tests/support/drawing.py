"""Numbers drawn by a seed, of either sign and away from zero."""

import numpy as np


def drawn(seed, *shape):
    signs = np.random.default_rng(seed + 100).choice([-1, 1], shape)
    return np.random.default_rng(seed).uniform(0.5, 2.0, shape) * signs
