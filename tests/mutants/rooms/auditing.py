"""The checker that stands alone."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_LOOKS = ("auditing/test_sharp_looks.py",)
ROOMS: tuple[Room, ...] = (
    Room("auditing/reading", ("widened", "WIDEN"), _LOOKS),
    Room(
        "auditing/boxes",
        ("look", "contracts", "_half_width", "_sum", "_scaled", "_least", "defect"),
        (*_LOOKS, "domain/test_sharp_every.py", "auditing/test_sharp_every_row.py"),
        (
            ("np.isfinite(rough)", "any instead of all", "no weight is positive where an entry is infinite"),
            ("weight = np.linalg.solve", "", "any w > 0 will do: it is checked below"),
            ("np.all(weight > 0)", "0 let in", "Mw < w fails where an entry of w is 0"),
        ),
    ),
    Room(
        "auditing/gluing",
        ("near", "in_tube"),
        (*_LOOKS, "auditing/test_sharp_audited_tubes.py", "auditing/test_sharp_every_row.py"),
        (
            ("np.isfinite(inverse)", "", "what is no number is within no radius below"),
            ("np.isfinite(theta)", "", "what is no number is within no radius below"),
            ("initial=0.0) < 1e-13", "", "when Newton's method is ended: what it found is checked below"),
            ("rest < 1.0 and", "rest < 1.0", "follows from size + rest radius < radius"),
            ("rest < 1.0 and", "1 × 1.1", "follows from size + rest radius < radius"),
            ("rest < 1.0 and", "1 × 2", "follows from size + rest radius < radius"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = ()
