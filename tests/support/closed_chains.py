"""Spatial chains closed by one closure of any kind."""

import numpy as np

import ccpin
from tests.support.strategies import ROWS, Growth


def spatial_chain(kind, seed):
    """One loop closed by a closure of a kind, on a moving stem; its spherical joint independent if n allows."""
    growth = Growth(np.random.default_rng(seed))
    stem = growth.grow("base", ["revolute"])
    one = growth.grow(stem, ("revolute", "spherical", "prismatic"))
    other = growth.grow(stem, ("continuous", "revolute", "revolute", "prismatic"))
    growth.close(kind, one, other)
    description = growth.drawn().description
    n = 10 - ROWS[kind]
    single = [joint.name for joint in description.joints if joint.kind != "spherical"]
    (whole,) = (joint.name for joint in description.joints if joint.kind == "spherical")
    return ccpin.load(description, independent=[whole, *single[: n - 3]] if n > 6 else single[:n])
