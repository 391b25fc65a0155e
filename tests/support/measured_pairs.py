"""Pairs of motor and joint angles of linkages whose lengths are other than their files state, in closed form."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.identification.calibration.geometry_numbers import numbers_on_loops
from ccpin.transmission import Transmission, identify_geometry
from tests.oracles.linkages import Ankle, Knee, about_x, about_y, crank_angle
from tests.support.linkage_models import transmission_of

NOISE = np.radians(0.02)
INSIDE = 1.959964  # standard deviations: 95 % of normal errors are within


class Linkage(NamedTuple):
    """A transmission, what is measured of it, and what its true numbers make of that.

    Attributes:
        transmission: As its file states it.
        numbers: What is unknown.
        error: How far the file is off, a standard deviation, m or a ratio.
        span: Joints are measured within ± these, rad.
        motors: q_m of numbers and of q_j of shape (N, n).
    """

    transmission: Transmission
    numbers: tuple[str, ...]
    error: float
    span: tuple[float, ...]
    motors: Callable[[np.ndarray, np.ndarray], np.ndarray]

    @property
    def stated(self):
        """The file's numbers."""
        found = {each.name: each.value for each in numbers_on_loops(self.transmission.joint_model)}
        return np.array([found[name] for name in self.numbers])

    def measured(self, truth, count, rng, noise=NOISE):
        """Pairs of a linkage of these numbers, with errors on both sides, of shape (count, n) each."""
        q = rng.uniform(-1.0, 1.0, (count, len(self.span))) * self.span
        return self.motors(truth, q) + noise * rng.normal(size=q.shape), q + noise * rng.normal(size=q.shape)


def ankle():
    """Of each side crank, rod and the heel's anchor."""
    parts = ("_{}/x", "_heel/A/z", "_heel/B/x", "_heel/B/y", "_heel/B/z")
    sides = (("left", "ball"), ("right", "swing"))
    numbers = tuple(f"origin:{side}{part.format(crank)}" for side, crank in sides for part in parts)

    def motors(p, q):
        turns = np.array([about_y(pitch) @ about_x(roll) for pitch, roll in q])
        sides = zip(p.reshape(2, 5), Ankle.PIVOTS, strict=True)
        return np.stack([crank_angle(-r, -L, (turns @ heel - at).T) for (r, L, *heel), at in sides], axis=1)

    return Linkage(transmission_of("ankle"), numbers, 1e-3, (0.6, 0.4), motors)


def knee():
    """Crank, rod and lever, the thigh being known."""

    def motors(p, q):
        turns = np.array([about_y(angle) for angle in q[:, 0]])
        return crank_angle(-p[0], p[1], (turns @ [p[2], 0.0, 0.0] - [0.0, 0.0, Knee.THIGH]).T)[:, None]

    numbers = ("origin:rod_swing/x", "origin:lever/A/z", "origin:lever/B/x")
    return Linkage(transmission_of("knee"), numbers, 1e-3, (1.0,), motors)


def neck():
    """Four ratios of a differential."""
    numbers = tuple(f"ratio:tendon_{k}/{joint}" for k in (1, 2) for joint in ("pitch", "roll"))
    return Linkage(transmission_of("neck"), numbers, 1e-2, (0.5, 0.4), lambda p, q: -q @ p.reshape(2, 2).T)


LINKAGES = {"ankle": ankle, "knee": knee, "neck": neck}


class Run(NamedTuple):
    """One simulated identification: errors of numbers in predicted standard deviations, these, and the misfit."""

    errors: np.ndarray
    deviations: np.ndarray
    misfit: float


def simulated(linkage, runs, count=40, seed=0):
    """So many identifications, each of another true geometry and with other noise."""
    rng = np.random.default_rng(seed)
    for _ in range(runs):
        truth = linkage.stated + linkage.error * rng.normal(size=len(linkage.numbers))
        pairs = linkage.measured(truth, count, rng)
        found = identify_geometry(linkage.transmission, *pairs, parameters=linkage.numbers)
        yield Run((found.values - truth) / found.standard_deviations, found.standard_deviations, found.misfit)
