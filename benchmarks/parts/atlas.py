"""What certificates cost: maps at growing depth (n = 1, 2, 3), the largest squares, one ball and one path a mechanism.

CPU seconds of one process; each figure is taken once. The exponent is that of time in boxes: 1 is proportional.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

import ccpin
from benchmarks.measured import Measured, Options
from benchmarks.timing import exponent, timed
from ccpin.domain import certify, certify_path, kantorovich_radius
from tests.oracles import rpdr

PART = "atlas"
WHO = "ccpin"
TORUS_SHARE = 0.999  # certified or empty, of the RPDR's torus: the time to it is told
TO_SHARE, DECIDED = "99.9 % of the torus's branch certified", "99.9 % of the torus certified or proved empty"
WHOLE, EXPONENT = "default certify", "exponent of time in boxes"


class Map(NamedTuple):
    """A mechanism, its seed (rad), a region (lower, upper) in rad or ``None``, and the depths to go to."""

    name: str
    seed: tuple[float, ...]
    region: tuple[tuple[float, ...], tuple[float, ...]] | None
    depths: tuple[int, ...]


MAPS = (
    Map("four_bar", (0.7,), None, (8, 14)),
    Map("rpdr", (-1.885, -1.257), None, (7, 8, 9, 10, 11, 12)),
    Map("planar_3rrr", (-0.675, 1.419, -2.769), ((-1.175, 0.919, -3.269), (-0.175, 1.919, -2.269)), (3, 4, 5)),
    Map("delta", (0.0, 0.0, 0.0), ((-0.4,) * 3, (0.7,) * 3), (4,)),
)
SQUARES = ((-108.0, -72.0), (-108.0, -48.0), (-108.0, -120.0), (-70.0, -110.0))  # degrees, of the RPDR
BALLS = ("four_bar", "rpdr", "planar_3rrr", "delta", "stewart", "hexa")
BALLS_A_PATH, TUBE = 30.0, 1e-4  # a path's length in radii of the ball at its start; its half width, rad


def measure(options: Options) -> Iterator[Measured]:
    """Maps, squares, balls and paths; the default map of the Delta too where minutes do not matter."""
    for case in MAPS if options.deep else MAPS[:1]:
        yield from maps(case if options.deep else case._replace(depths=case.depths[:1]))
    if options.deep:
        mechanism = ccpin.load("delta")
        _, seconds = timed(lambda: certify(mechanism, np.zeros(3)))
        yield Measured(PART, "delta", WHOLE, WHO, seconds)
    for centre in SQUARES if options.deep else SQUARES[:1]:
        yield square(centre)
    for name in BALLS if options.deep else BALLS[:1]:
        yield from ball_and_path(name)


def maps(case: Map) -> Iterator[Measured]:
    """Seconds at each depth with boxes and share, how time grows in boxes, and when 99.9 % of the torus is there."""
    mechanism, boxes, times = ccpin.load(case.name), list[int](), list[float]()
    reached, branch = dict[str, Measured](), branch_share()
    for depth in case.depths:
        atlas, seconds = timed(lambda d=depth: certify(mechanism, case.seed, case.region, max_depth=d))
        boxes.append(len(atlas.boxes.kappa))
        times.append(seconds)
        certified, empty = atlas.certified_fraction, atlas.empty_fraction
        note = f"{boxes[-1]} boxes, {100 * certified:.4f} % certified, {100 * empty:.4f} % proved empty"
        yield Measured(PART, case.name, f"map to depth {depth}", WHO, seconds, note=note)
        for what, share in ((TO_SHARE, certified / branch), (DECIDED, certified + empty)):
            if case.name == "rpdr" and what not in reached and share >= TORUS_SHARE:
                reached[what] = Measured(PART, case.name, what, WHO, seconds, note=f"depth {depth}")
    yield from reached.values()
    if len(set(boxes)) > 1:
        yield Measured(PART, case.name, EXPONENT, WHO, exponent(boxes, times), "")


def branch_share() -> float:
    """The exact share of the torus over which the RPDR closes: where its elbows are within the distal links' reach.

    With d and β distance and direction of elbow 1 from the second motor and a the proximal links' length, the elbows
    are within L where cos(q2 − β) ≥ (d² + a² − L²)/2ad.
    """
    base, proximal, reach = rpdr.C, rpdr.A1, rpdr.A3 + rpdr.A4
    elbow = proximal * np.exp(1j * np.linspace(-np.pi, np.pi, 100_000, endpoint=False)) - base
    cosine = (np.abs(elbow) ** 2 + proximal**2 - reach**2) / (2.0 * proximal * np.abs(elbow))
    return float(np.mean(np.arccos(np.clip(cosine, -1.0, 1.0))) / np.pi)


def square(centre: tuple[float, float]) -> Measured:
    """The largest certified square of the RPDR about a centre (degrees)."""
    mechanism = ccpin.load("rpdr")
    atlas, seconds = timed(lambda: certify(mechanism, np.radians(centre), max_depth=0))
    note = f"± {np.degrees(atlas.radius):.4f}°, {len(atlas.boxes.kappa)} boxes"
    return Measured(PART, "rpdr", f"largest square at ({centre[0]:g}°, {centre[1]:g}°)", WHO, seconds, note=note)


def ball_and_path(name: str) -> Iterator[Measured]:
    """A one-shot ball, and a straight move of 30 balls from the reference."""
    mechanism = ccpin.load(name)
    radius, seconds = timed(lambda: kantorovich_radius(mechanism, mechanism.q_reference))
    yield Measured(PART, name, "one ball", WHO, seconds, note=f"radius {radius:.5f}")
    start = mechanism.parametrization().coordinates.alpha(mechanism.q_reference)
    ends = np.array([start, start + BALLS_A_PATH * radius / np.sqrt(mechanism.n)])
    path, seconds = timed(lambda: certify_path(mechanism, ends, TUBE))
    note = f"{len(path.boxes.kappa)} boxes, {100 * path.reached:.0f} % certified"
    yield Measured(PART, name, f"a path of {BALLS_A_PATH:g} balls", WHO, seconds, note=note)
