"""Systems of singular configurations, folds and cusps, and what proves their zeros."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_TOLD = ("domain/singular/test_sharp_cusps.py",)
_BEGUN = "where Newton begins, and with which l: the theorems are about any, and `proof.facts.prove_some` asks them"
ROOMS: tuple[Room, ...] = (
    Room("proof/curves/curve_equations", ("domain/singular/test_sharp_systems.py",)),
    Room("proof/prolongations", ("proof/test_sharp_prolongations.py",)),
    Room(
        "proof/prolongations",
        ("proof/test_sharp_extended.py",),
        (
            ("(kappa * SLACK < 1.0)", "not asked: kappa * SLACK < 1.0", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "kappa * SLACK < 1.0: left", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "1 × 1.1", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "1 × 2", "follows from the first"),
        ),
        places=("proved_within",),
    ),
    Room("proof/zeros", ("proof/test_sharp_zeros.py",)),
    Room(
        "proof/lines",
        ("proof/test_sharp_lines.py",),
        (
            ("delta = np.min(room", "1e-300 ×", "where the line does not move there is room enough"),
            ("wide = box._replace(", "", "`check` asks Theorem N of the wider tube"),
        ),
    ),
    Room("domain/singular/folds", _TOLD, (("y + ahead.aside", "", _BEGUN),)),
    Room("domain/singular/cusp_points", _TOLD),
)

EXCUSED: tuple[Excused, ...] = (
    Excused("proof/lines", ("_ROOM",), "which wider tubes are tried: `check` asks Theorem N of them"),
    Excused("proof/prolongations", ("_RADII",), "which radii are tried: `proved_within` checks each"),
    Excused(
        "domain/singular/folds",
        ("Folds.near", "Folds.directions", "Folds.along"),
        _BEGUN,
    ),
    Excused(
        "domain/singular/cusp_points",
        ("_turning", "cusps"),
        "where cusps are looked for, and which are wanted: `proof.facts.prove_some` finds those proved; others are "
        "not denied",
    ),
)
