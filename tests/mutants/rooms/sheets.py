"""Sheets of configurations: how many there are, how they hang together."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_ANSWERS = ("domain/sheets/test_sharp_answers.py",)
_FRONT = ("domain/sheets/test_sharp_front.py",)
ROOMS: tuple[Room, ...] = (
    Room("domain/sheets/sheet_claims", _ANSWERS),
    Room("domain/sheets/cover", _FRONT, places=("Front._continued", "Front._first", "Front._try")),
    Room(
        "domain/sheets/cover",
        ("domain/sheets/test_sharp_carrying.py",),
        (
            ("waiting = leaves[(self.tree.status", "not asked: self.part", "none beside it is certified of no part"),
            ("both = np.flatnonzero(", "not asked: np.isin", "what has no box has no pair"),
        ),
    ),
    Room(
        "domain/sheets/seams",
        ("domain/sheets/test_sharp_seams.py",),
        (
            ("away <= _REACH", "any instead of all", "which proved folds are followed"),
            ("away <= _REACH", "left × 0.5", "which proved folds are followed"),
            ("away = np.abs(", "without theta", "which proved folds are followed"),
            ("k = int(np.clip(", "without 2", "a curve that is walked goes beyond its middle"),
        ),
    ),
    Room("domain/sheets/sheets", _ANSWERS),
    Room(
        "domain/sheets/certifying",
        _ANSWERS,
        (
            ("0.5 * effort.seconds", "", "how long is searched"),
            ("effort.depth + _DEEPER", "", "how far cells are halved"),
        ),
    ),
    Room("domain/sheets/merged", _ANSWERS),
)

EXCUSED: tuple[Excused, ...] = (
    Excused("domain/sheets/sheets", ("SheetAtlas.__repr__",), "words"),
    Excused("domain/sheets/sheets", ("SheetAtlas.save",), "files: `load` reads all that is to be there"),
    Excused(
        "domain/sheets/sheets",
        ("SheetAtlas.folds", "SheetAtlas._ends"),
        "from which boxes folds are looked for: `seams.cross` asks what is proved of them",
    ),
    Excused(
        "domain/sheets/sheets",
        ("SheetAtlas.mode_change",),
        "which cell is tried: `solutions` and `way` refuse what is not proved",
    ),
    Excused(
        "domain/sheets/seams",
        ("_REACH", "_STRIDE"),
        "which folds are followed and how long boxes are tried: `cross` asks what is proved of them",
    ),
    Excused("domain/sheets/cover", ("Front.run",), "what is told of progress"),
    Excused(
        "domain/sheets/cover",
        ("_NEAR", "_near"),
        "for which pairs a proof is tried: what is not glued is not claimed to be one sheet",
    ),
    Excused(
        "domain/sheets/counting",
        ("cover_singular", "_halve_cells"),
        "how far cells are halved, and along which edge: `exhausted.Excluded` goes through all once more",
    ),
    Excused(
        "domain/sheets/counting",
        ("_WIDEST", "_NEAR", "all_solutions", "_near", "_others"),
        "which boxes over a q are tried: `solution_counts.CountedCells` asks if they hold all, each once",
    ),
    Excused(
        "domain/sheets/sheet_claims",
        ("excluded_over",),
        "where full turns are cut open: `exhausted.Excluded` holds about any middle",
    ),
    Excused(
        "domain/sheets/sheet_claims",
        ("counted_parts", "proved_sheets", "proved_again"),
        "what is handed to the kernel: `exhausted.Excluded`, `solution_counts.CountedCells` and `CompleteCells` and "
        "`solutions.GluedBoxes` check it, and `ProvedSheets.says` and `mark` ask them",
    ),
)
