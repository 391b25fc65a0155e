"""Sheets of configurations, curves of singular ones, folds and cusps."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_TUBES = (("hull = np.minimum(", "maximum instead of minimum", "the curve is within a wider hull too"),)
ROOMS: tuple[Room, ...] = (
    Room(
        "domain/sheets/front",
        ("Front._continued", "Front._first", "Front._try"),
        ("domain/sheets/test_sharp_front.py",),
    ),
    Room(
        "domain/curves/tubes", ("bounds_of", "certify_tubes", "_room"), ("domain/curves/test_sharp_tubes.py",), _TUBES
    ),
)

EXCUSED: tuple[Excused, ...] = ()
