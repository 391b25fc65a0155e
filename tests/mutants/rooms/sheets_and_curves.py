"""Curves of singular configurations, folds and cusps."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_TUBES = (("hull = np.minimum(", "maximum instead of minimum", "the curve is within a wider hull too"),)
ROOMS: tuple[Room, ...] = (
    Room(
        "domain/singular/tubes",
        ("bounds_of", "certify_tubes", "_room"),
        ("domain/singular/test_sharp_tubes.py",),
        _TUBES,
    ),
)

EXCUSED: tuple[Excused, ...] = ()
