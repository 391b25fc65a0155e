"""Boxes that wait to be looked at, and tubes beside them, of numbers written down or of any."""

import numpy as np

from ccpin.proof.curves.tubes import Tubes
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Ranges, Reason


def ranges_of(lower, upper, reasons=Reason.LENGTHS):
    """Ranges with ends for such reasons, and no limits."""
    lower, upper = np.array(lower), np.array(upper)
    big = np.finfo(float).max
    return Ranges(lower, upper, np.full((len(lower), 2), reasons, dtype=np.int8), np.tile([-big, big], (len(lower), 1)))


def candidates(centre, half, slopes):
    """Candidates, numbered by their cells."""
    centre, half, slopes = (np.array(part, dtype=float) for part in (centre, half, slopes))
    return Candidates(np.arange(len(centre)), centre, half, slopes)


def any_boxes(rng, count, m=2):
    """Any boxes of two independent and m dependent coordinates, numbered by their cells."""
    size = 2 + m
    centre, half = rng.normal(size=(count, size)), rng.uniform(0.1, 0.5, (count, size))
    return Candidates(np.arange(count), centre, half, rng.normal(size=(count, m, 2)))


def any_tubes(rng, count, along, n=6, m=2):
    """Any tubes that run along one of n coordinates."""
    tangent, radius = rng.uniform(-1, 1, (count, n)), rng.uniform(0.1, 0.5, (count, n))
    tangent[:, along], radius[:, along] = rng.choice([-1.0, 1.0], count), 0.0
    x = rng.normal(size=(count, n))
    return Tubes(
        x[:, : n - m], x[:, n - m :], rng.normal(size=(count, m)), np.full(count, along), tangent, np.full(count, 0.4),
        radius, np.zeros((count, n, n - 1)), np.zeros(count), radius,
    )  # fmt: skip
