"""The table: which functions and constants theorems rest on, which tests are to notice a change, and what need not be.

Every float, square, sum, conjunction and inequality in the places named is changed in turn (`changes`), so nothing in
them can be left out. A change that makes a bound only larger, or a search only less lucky, is *sharpness only*: its
fragment and the reason stand here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from tests.mutants.changes import Change, changes_of
from tests.mutants.running import source_of


class Room(NamedTuple):
    """A module's share of the table.

    Attributes:
        module: As ``domain/boxes``.
        places: Its functions, methods (``Class.method``) and constants that are changed.
        tests: Files or tests under tests/ that are to notice it.
        sharpness: (a fragment of a source line, of what is changed there, the reason why it need not be noticed).
    """

    module: str
    places: tuple[str, ...]
    tests: tuple[str, ...]
    sharpness: tuple[tuple[str, str, str], ...] = ()


class Mutant(NamedTuple):
    """A change, its room, and the reason why it is not run (empty: it is)."""

    room: Room
    change: Change
    reason: str


def mutants_of(room: Room) -> Iterator[Mutant]:
    """All mutants of a module.

    Raises:
        LookupError: A place or a fragment that the module no longer has.
    """
    unused = set(room.sharpness)
    try:
        for change in changes_of(source_of(room.module).read_text(), room.places):
            entries = [e for e in room.sharpness if e[0] in change.text and e[1] in change.what]
            unused -= set(entries)
            yield Mutant(room, change, entries[0][2] if entries else "")
    except KeyError as missing:
        raise LookupError(f"{room.module} has no {missing}: the table of mutants is to be mended") from None
    if unused:
        raise LookupError(f"{room.module} has nothing to change at {sorted(unused)}: the table is to be mended")


_BOUNDS = ("domain/test_sharp_bounds.py",)
_LOOKS = ("auditing/test_sharp_looks.py",)
ROOMS = (
    Room(
        "proof/rounding",
        ("SLACK", "LEAST", "ROUNDINGS", "UNIT_ROUNDOFF", "widened", "blur"),
        _BOUNDS,
        (("SLACK = ", "1e-10 × 1.1", "more room for rounding"),),
    ),
    Room(
        "domain/bounds",
        ("linear_part", "LinearPart.affine", "LinearPart.widths", "LinearPart.curvature_margin", "Image.of"),
        _BOUNDS,
    ),
    Room(
        "domain/bounds_reach",
        (
            "reach_bounds",
            "chain_reach",
            "_trilinear",
            "ReachBounds.mean",
            "ReachBounds.contraction",
            "ReachBounds.curvature",
            "ReachBounds._first",
            "ReachBounds._reach",
        ),
        _BOUNDS,
    ),
    Room(
        "domain/boxes",
        ("_holds", "bounds_of", "measured_from"),
        _BOUNDS,
        (("np.isfinite(image + shrunk)", "without shrunk", "a Z that is no number fails (K2) too"),),
    ),
    Room("domain/newton", ("encloses", "without_turns", "_rounding"), _BOUNDS),
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
        "domain/gravity_bounds",
        ("_remainder", "_slope_bound", "_curvature_change", "_inverse_bound", "_variation", "_symmetric"),
        ("domain/test_sharp_gravity.py",),
    ),
    Room("control/stability/cells", ("CellStore.agree",), ("control/stability/test_sharp_cells.py",)),
    Room(
        "domain/sheets/front",
        ("Front._continued", "Front._first", "Front._try"),
        ("domain/sheets/test_sharp_front.py",),
    ),
    Room("auditing/document", ("widened", "WIDEN"), _LOOKS),
    Room(
        "auditing/boxes",
        ("look", "contracts", "_half_width", "_sum", "_scaled", "_least", "defect"),
        _LOOKS,
        (
            ("weight = np.linalg.solve", "", "any w > 0 will do: it is checked below"),
            ("np.all(weight > 0)", "0 let in", "Mw < w fails where an entry of w is 0"),
        ),
    ),
    Room(
        "auditing/gluing",
        ("near", "in_tube"),
        (*_LOOKS, "auditing/test_sharp_audited_tubes.py"),
        (
            ("initial=0.0) < 1e-13", "", "when Newton's method is ended: what it found is checked below"),
            ("rest < 1.0 and", "rest < 1.0", "follows from size + rest radius < radius"),
            ("rest < 1.0 and", "1 × 1.1", "follows from size + rest radius < radius"),
            ("rest < 1.0 and", "1 × 2", "follows from size + rest radius < radius"),
        ),
    ),
    Room(
        "domain/bounds_planar",
        (
            "planar_bounds",
            "_expanded",
            "_versine",
            "_one_signed",
            "PlanarBounds.mean",
            "PlanarBounds.contraction",
            "PlanarBounds.curvature",
            "PlanarBounds._widths",
            "PlanarBounds._image",
        ),
        ("domain/test_sharp_planar.py",),
    ),
    Room(
        "domain/affine",
        (
            "_GROWN",
            "_TINY",
            "Affine.magnitude",
            "Affine.spread",
            "Affine.swing",
            "Affine.__add__",
            "Affine.__mul__",
            "_lengths",
            "_sum",
            "summed",
            "product",
            "sine_versine",
            "Inverse.solve",
            "inverse",
        ),
        ("domain/test_sharp_affine.py",),
        (
            ("self.defect) @ (size + _TINY)", "without _TINY", "any bound will do: it is checked below"),
            ("weight = solve_many(identity - defect", "", "any w > 0 will do: it is checked below"),
            ("(weight > 0.0) & (shrunk < weight)", "0 let in", "Ew < w fails where an entry of w is 0"),
            ("np.isfinite(defect)", "not asked: np.isfinite", "Ew < w fails where E is no number"),
        ),
    ),
    Room("domain/extended", ("third_bound",), _BOUNDS),
    Room(
        "domain/extended",
        ("proved_within", "UNIT"),
        ("domain/test_sharp_extended.py",),
        (
            ("(kappa * SLACK < 1.0)", "not asked: kappa * SLACK < 1.0", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "kappa * SLACK < 1.0: left", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "1 × 1.1", "follows from the first"),
            ("(kappa * SLACK < 1.0)", "1 × 2", "follows from the first"),
        ),
    ),
    Room(
        "control/stability/storage",
        ("floor", "gain", "widths", "_inverse_form", "_inverted", "_constant", "storage_of", "_blocks"),
        ("control/stability/test_sharp_storage.py",),
        (
            ("np.isfinite(M)", "not asked: np.isfinite(M)", "no eigenvalue of what is no number is above 1e-7"),
            ("(1.0 - _CLEAR)", "without _CLEAR", "1e-9 of 1e-7 at least is below what doubles near 1 tell apart"),
        ),
    ),
    Room("domain/curves/tubes", ("bounds_of", "certify_tubes", "_room"), ("domain/curves/test_sharp_tubes.py",)),
)
