"""Claims about transmissions: `ccpin.transmission`."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS = (
    Room(
        "transmission/effort_box_claim",
        ("EffortBoxHeld.examined", "EffortBoxHeld._used", "balance"),
        ("transmission/test_effort_box.py",),
    ),
)

EXCUSED = (
    Excused(
        "transmission/effort_box_claim",
        ("_OUT", "_LEAST", "_above"),
        "room for rounding; and W is proposed, (1) is asked of it",
    ),
)
