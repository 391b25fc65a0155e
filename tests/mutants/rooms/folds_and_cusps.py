"""Systems of singular configurations, folds and cusps, and what proves their zeros."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_TESTS = ("domain/singular/test_sharp_systems.py",)
ROOMS: tuple[Room, ...] = (
    Room(
        "proof/curves/curve_equations",
        ("values_at", "rounding_at", "first_order", "Drift.along", "drift"),
        _TESTS,
    ),
    Room(
        "domain/singular/folds",
        ("_System.at", "_System.value", "_System.slope", "_System.drift", "_proved_within"),
        _TESTS,
    ),
    Room(
        "domain/singular/cusp_points",
        (
            "_SAME",
            "_CuspEquations.at",
            "_CuspEquations.value",
            "_CuspEquations.slope",
            "_CuspEquations._assembled",
            "_CuspEquations.drift",
            "_CuspEquations.rounding",
            "_CuspEquations._whole",
            "_proved_within",
            "distinct",
            "_same",
        ),
        _TESTS,
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused(
        "domain/singular/folds",
        ("singular_points", "Folds.near", "Folds.directions", "Folds.along"),
        "where Newton begins, and with which l: Theorem S is about any, and `_proved_within` asks it",
    ),
    Excused(
        "domain/singular/cusp_points",
        ("_turning", "cusps"),
        "where cusps are looked for, and which are wanted: `_proved_within` proves those found; others are not denied",
    ),
)
