"""What every proof stands on: rounding, ranges, digests."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_BOUNDS = ("domain/test_sharp_bounds.py",)
ROOMS: tuple[Room, ...] = (
    Room(
        "proof/rounding",
        ("SLACK", "LEAST", "ROUNDINGS", "UNIT_ROUNDOFF", "widened", "blur"),
        _BOUNDS,
        (("SLACK = ", "1e-10 × 1.1", "more room for rounding"),),
    ),
)

EXCUSED: tuple[Excused, ...] = ()
