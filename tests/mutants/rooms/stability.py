"""Theorem 3, tubes about references, tracking."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS: tuple[Room, ...] = (
    Room(
        "control/stability/set_point/certified_cells",
        ("CellStore.agree",),
        ("control/stability/set_point/test_sharp_cells.py",),
    ),
    Room(
        "control/stability/tracking/storage",
        ("floor", "gain", "widths", "_inverse_form", "_inverted", "_constant", "storage_of", "_blocks"),
        ("control/stability/tracking/test_sharp_storage.py", "proof/test_sharp_every.py"),
        (
            ("np.isfinite(inner)", "any instead of all", "an inverse that is not known is infinite in every entry"),
            ("np.isfinite(M)", "any instead of all", "no eigenvalue of what is no number is above 1e-7"),
            ("np.isfinite(M)", "not asked: np.isfinite(M)", "no eigenvalue of what is no number is above 1e-7"),
            ("(1.0 - _CLEAR)", "without _CLEAR", "1e-9 of 1e-7 at least is below what doubles near 1 tell apart"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = ()
