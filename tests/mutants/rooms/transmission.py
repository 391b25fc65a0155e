"""Claims about transmissions: `ccpin.transmission`."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS = (
    Room(
        "transmission/motor_limits_claim",
        (
            "transmission/test_motor_limits_claim.py",
            "transmission/test_motor_limits.py",
            "transmission/test_motor_limits.py::test_no_posture_of_the_region_asks_more[100-0.4-64-ankle-box-effort]",
            "transmission/test_motor_limits.py::test_no_posture_of_the_region_asks_more[100-0.4-64-ankle-ellipsoid-speed]",
        ),
        (
            ("_LEAST", "without _LEAST", "only what underflows could be below it"),
            ("_ROUNDED", "without _ROUNDED", "room for rounding of P L, which no test of a double sees"),
            ("bound > 0.0", "0 let in", "what is given is above 0, so that a bound of 0 is not above it"),
        ),
    ),
)

EXCUSED = (
    Excused(
        "transmission/motor_limits_claim",
        ("_OUT", "_ROUNDED", "_LEAST", "_above"),
        "room for rounding; and W is proposed, (1) is asked of it",
    ),
)
