"""Sheets of configurations, curves of singular ones, folds and cusps."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS: tuple[Room, ...] = (
    Room(
        "domain/sheets/narrowing",
        ("alone_in",),
        ("domain/sheets/test_sharp_narrowing.py",),
        (
            ("weight = 0.5 * (weight", "", "any w > 0 will do: it is checked below"),
            ("alone & np.isfinite", "not asked: np.isfinite", "Zw < w fails where Z is no number"),
        ),
    ),
    Room(
        "domain/sheets/front",
        ("Front._continued", "Front._first", "Front._try"),
        ("domain/sheets/test_sharp_front.py",),
    ),
    Room("domain/curves/tubes", ("bounds_of", "certify_tubes", "_room"), ("domain/curves/test_sharp_tubes.py",)),
)

EXCUSED: tuple[Excused, ...] = ()
