"""Closures of chains written down by hand, as the producer and the auditor read them."""

from types import SimpleNamespace

import numpy as np

from ccpin.auditing.reading import StatedRanges
from ccpin.proof.chains import Chain

X, Y, Z = np.eye(3)
NO_LIMIT = np.finfo(float).max
NONE = [-NO_LIMIT, NO_LIMIT]


def chain(joints, weights, tip=(0.0, 0.0, 0.0)):
    """A chain of (coordinate, link before it, axis, whether it slides), unturned."""
    numbers, links, axes, slides = zip(*joints, strict=True)
    turns = np.tile(np.eye(3), (len(joints), 1, 1))
    tip = np.array(tip, dtype=float)
    return Chain(
        np.array(numbers), turns, np.array(links, dtype=float), np.array(axes), np.array(slides), tip, False, weights
    )


def planar(joints, tip):
    """One that two rows see in the plane."""
    return chain(joints, np.array([X, Y]), tip)


def closures(chains, size, independent, couplings=(), offset=(), moduli=()):
    """φ of chains, and of rows of couplings behind theirs."""
    rows = max([len(c.weights) for c in chains], default=0)
    linear = np.zeros((rows + len(couplings), size))
    linear[rows:] = np.reshape(couplings, (-1, size))
    chains = [c._replace(weights=np.vstack([c.weights, np.zeros((len(couplings), 3))])) for c in chains]
    total = np.zeros(len(linear))
    total[: len(offset)] = offset
    slides = np.zeros(size, dtype=bool)
    for c in chains:
        slides[c.joints[c.prismatic]] = True
    return SimpleNamespace(
        chains=chains,
        couplings=linear,
        offset=total,
        moduli=np.array([*moduli, *np.zeros(len(linear) - len(moduli))]),
        independent=np.array(independent),
        dependent=np.setdiff1d(np.arange(size), independent),
        periodic=~slides & ~np.any(linear != 0.0, axis=0),
    )


def leg_and_anchor(weights=(X, Y), turns=(), slide=X, **anchor):
    """A slide behind turns about some axes, of coordinate 1, whose end is where coordinate 0 and a link take it."""
    joints = [(2 + k, np.zeros(3), axis, False) for k, axis in enumerate(turns)]
    leg = chain([*joints, (1, np.zeros(3), np.array(slide), True)], np.array(weights))
    other = chain([(0, np.zeros(3), X, True)], -np.array(weights), **anchor)
    return closures([leg, other], 2 + len(turns), [0])


def stated(system, lower, upper, limits=None, ends=None, reasons=3):
    """The closures as a document with a region and ranges."""
    m = len(system.dependent)
    limits = np.tile(NONE, (m, 1)) if limits is None else np.array(limits)
    ends = np.tile([-1e3, 1e3], (m, 1)) if ends is None else np.array(ends)
    reasons = np.broadcast_to(np.array(reasons), (m, 2))
    ranges = StatedRanges(ends[:, 0], ends[:, 1], reasons, limits)
    return SimpleNamespace(**vars(system), lower=np.array(lower), upper=np.array(upper), ranges=ranges)
