"""What is proved of σ over a region of each mechanism: its shares sum to 100 %. CPU seconds of one process, taken once.

A region is the joints' whole ranges (full turns where limits allow) unless stated; with more than three coordinates it
is a cube about the reference, in multiples of the half width that one box proves.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import ccpin
from benchmarks.measured import Measured, Options
from benchmarks.timing import timed
from ccpin import MechanismDescription
from ccpin.domain import Atlas, certify, kantorovich_radius, scalar_coordinates_at
from ccpin.errors import UnsupportedMechanismError
from tests.support.rods import rod_ankle, rod_stewart
from tests.support.walkthrough import file

PART = "certificates"
WHO = "ccpin"
SHARES = ("certified", "empty", "singular", "undecided", "unreached")
Source = str | Callable[[], MechanismDescription]


class Subject(NamedTuple):
    """A mechanism, how far its region reaches to either side of the seed (``None``: whole ranges), and the depth.

    Attributes:
        name: In the table.
        source: A model's name or file, or a description.
        reach: Half widths of the region, rad or m, or a multiple of the one-box radius where `boxes`.
        depth: How often an edge may be halved; ``None``: the default.
        boxes: See `reach`.
    """

    name: str
    source: Source
    reach: float | None = None
    depth: int | None = None
    boxes: bool = False


SUBJECTS = (
    Subject("four_bar", "four_bar"),
    Subject("slider_crank", "slider_crank"),
    Subject("rpdr", "rpdr"),
    Subject("planar_3rrr", "planar_3rrr", 0.5, 5),
    Subject("delta", "delta", 1.2, 5),
    Subject("hexa", "hexa", 2.0, 3, True),
    Subject("stewart", "stewart", 2.0, 3, True),
    Subject("sarrus", "sarrus"),
    Subject("bennett", "bennett"),
    Subject("two-rod ankle", str(file("ankle"))),
    Subject("two-rod ankle, rods as distances", rod_ankle),
    Subject("gripper on couplings", str(file("gripper"))),
    Subject("Stewart platform, rods as distances", rod_stewart, 2.0, 3, True),
)


def measure(options: Options) -> Iterator[Measured]:
    """Coordinates, boxes, shares and seconds of each mechanism's map."""
    for subject in SUBJECTS if options.deep else SUBJECTS[-2:]:
        yield from _figures(subject)


def _figures(subject: Subject) -> Iterator[Measured]:
    mechanism = ccpin.load(subject.source() if callable(subject.source) else subject.source)
    yield Measured(PART, subject.name, "n", WHO, float(mechanism.n), "")
    try:
        atlas, seconds = timed(lambda: _map(mechanism, subject))
    except UnsupportedMechanismError as error:
        yield Measured(PART, subject.name, "CPU time", WHO, None, note=f"refused: {str(error).split('. ')[0]}")
        return
    yield Measured(PART, subject.name, "boxes", WHO, float(len(atlas.boxes.kappa)), "")
    for share in SHARES:
        yield Measured(PART, subject.name, f"{share} %", WHO, 100.0 * getattr(atlas, f"{share}_fraction"), "")
    yield Measured(PART, subject.name, "CPU time", WHO, seconds, note=f"{atlas.verdict}; {_region(subject)}")


def _map(mechanism: ccpin.Mechanism, subject: Subject) -> Atlas:
    seed = scalar_coordinates_at(mechanism, mechanism.q_reference)
    if subject.reach is None:
        return certify(mechanism, seed, max_depth=subject.depth)
    half = subject.reach * (kantorovich_radius(mechanism, mechanism.q_reference) if subject.boxes else 1.0)
    return certify(mechanism, seed, (seed - half, seed + half), max_depth=subject.depth)


def _region(subject: Subject) -> str:
    if subject.reach is None:
        return "whole ranges"
    return (
        f"± {subject.reach:g} {'one-box radii' if subject.boxes else 'rad'} about the reference, depth {subject.depth}"
    )
