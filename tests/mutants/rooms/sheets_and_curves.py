"""Sheets of configurations."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS: tuple[Room, ...] = (
    Room(
        "domain/sheets/cover",
        ("Front._continued", "Front._first", "Front._try"),
        ("domain/sheets/test_sharp_front.py",),
    ),
)

EXCUSED: tuple[Excused, ...] = ()
