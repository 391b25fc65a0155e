"""A made-up problem: sizes, orders of coordinates and roundings, for bounds whose other ingredients are made up too."""

from types import SimpleNamespace

import numpy as np


def made_up(m=2, periodic=(), rounding=0.0, magnitude=None):
    """Of two independent coordinates, 1 and 3, and m dependent ones about them, some of them angles."""
    size = 2 + m
    independent = np.array([1, 3]) if m > 1 else np.array([0, 2])
    system = SimpleNamespace(
        n=2, m=m, n_free=size, rounding=rounding, independent=independent,
        dependent=np.setdiff1d(np.arange(size), independent), periodic=np.isin(np.arange(size), periodic),
        magnitude=magnitude or (lambda theta: np.ones(len(theta))),
    )  # fmt: skip
    problem = SimpleNamespace(system=system, stack=None, phasors=None)
    problem._replace = lambda **changes: SimpleNamespace(**vars(problem) | changes)
    return problem
