"""Claims about transmissions: `ccpin.transmission`."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS = (
    Room(
        "transmission/effort_box_claim",
        ("EffortBoxHeld.examined", "EffortBoxHeld._used", "balance"),
        ("transmission/test_effort_box_claim.py", "transmission/test_effort_box.py"),
        (
            ("_LEAST", "without _LEAST", "only what underflows could be below it"),
            ("bound > 0.0", "0 let in", "what is given is above 0, so that a bound of 0 is not above it"),
        ),
    ),
)

EXCUSED = (
    Excused(
        "transmission/effort_box_claim",
        ("_OUT", "_LEAST", "_above"),
        "room for rounding; and W is proposed, (1) is asked of it",
    ),
)
