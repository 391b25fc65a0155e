"""Theorem 3, tubes about references, tracking."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_WELLS = ("control/stability/set_point/test_sharp_wells.py",)
_SETS = ("control/stability/set_point/test_sharp_sets.py",)
_ADDED = ("control/stability/set_point/test_sets_of_robots.py::test_what_a_set_adds_to_bounds",)
_SUBLEVEL = ("control/stability/set_point/test_sharp_sublevel.py",)
_TRACKING = ("control/stability/tracking/test_sharp_tracking.py",)
ROOMS: tuple[Room, ...] = (
    Room("control/stability/set_point/certified_cells", ("control/stability/set_point/test_sharp_cells.py",)),
    Room(
        "control/stability/set_point/set_point_cells",
        _SUBLEVEL,
        (
            ("near = np.flatnonzero(np.all((lower", "", "cells apart take nothing away, and fewer cover less"),
            ("require(beta < np.inf", "left × 0.5", "half of ∞ is no less"),
        ),
    ),
    Room("control/stability/set_point/sublevel_claim", _SUBLEVEL),
    Room("control/stability/set_point/potential", _ADDED, places=("_ROUNDING", "gravity_bounds", "potential_of")),
    Room("control/stability/set_point/set_point_reading", _SETS, places=("radii_of",)),
    Room("control/stability/set_point/set_point_certificate", _SETS, places=("SetPointCertificate._highest",)),
    Room(
        "control/stability/set_point/set_point_equations",
        _SETS,
        places=("SetPointEquations.misjudged", "_bodies", "_gravity"),
    ),
    Room(
        "proof/equations",
        ("control/stability/set_point/test_sublevel_claims.py", "control/stability/tracking/test_tube_claims.py"),
        places=("row_of",),
    ),
    Room(
        "control/stability/set_point/set_point_reading",
        ("control/stability/set_point/test_sublevel_claims.py", "control/stability/set_point/test_sharp_wells.py"),
        (("theta[reading.system.independent] = law.q_d", "", "a configuration at another q is refused"),),
    ),
    Room("control/stability/set_point/set_point_equations", ("control/stability/set_point/test_sublevel_claims.py",)),
    Room(
        "control/stability/set_point/starting_cells",
        ("control/stability/set_point/test_sharp_starting_cells.py",),
        (("sprung = system.periodic &", "not asked: system.periodic", "what is not periodic is not made so"),),
    ),
    Room("control/stability/set_point/set_point_certificate", ("control/stability/set_point/test_sharp_theorem3.py",)),
    Room("control/stability/set_point/theorem3", ("control/stability/set_point/test_sharp_theorem3.py",)),
    Room("control/stability/tracking/cell_forms", ("control/stability/tracking/test_sharp_cell_forms.py",)),
    Room(
        "control/stability/tracking/tracking_equations",
        (
            *(
                f"control/stability/tracking/test_tube_claims.py::{test}"
                for test in ("test_equations_that_are_none", "test_equations_cannot_be_written_to")
            ),
            *_TRACKING,
            "control/stability/tracking/test_false_tubes.py::test_honest_searches_prove",
        ),
    ),
    Room(
        "control/stability/tracking/tube_claim",
        ("control/stability/tracking/test_sharp_tube_claim.py", "control/stability/tracking/test_tube_claims.py"),
    ),
    Room(
        "control/stability/tracking/reference_cells",
        ("control/stability/tracking/test_sharp_tube_claim.py", "control/stability/tracking/test_tube_claims.py"),
        (
            ("(1.0 + 8.0 * UNIT_ROUNDOFF)", "8 × 0.9", "1 + 7.2u is 1 + 8u as a double"),
            ("(1.0 + 8.0 * UNIT_ROUNDOFF)", "8 × 1.1", "1 + 8.8u is 1 + 8u as a double"),
        ),
        places=(
            *("OverCells.subjects", "OverCells.covered", "OverCells.states", "OverCells._cells"),
            *("OverCells._require_path", "OverCells._require_covered", "OverCells._require_glued"),
        ),
    ),
    Room(
        "control/stability/tracking/tube_levels",
        _TRACKING,
        (("if k and kicks[k]", "not asked: kicks[k]", "a level that is raised by nothing is only larger by `SLACK`"),),
    ),
    Room(
        "control/stability/set_point/well",
        _WELLS,
        tuple(
            (line, "", "when a search ends: its point, wherever, gives a bound")
            for line in ("if np.all(np.abs(point - before)", "for _ in range(_SWEEPS if")
        ),
    ),
    Room("control/stability/set_point/gains", _WELLS),
    Room("control/stability/set_point/gains", ("domain/test_pickled_certificates.py",), places=("Gains.verdict",)),
    Room("control/stability/tracking/deviation", _TRACKING),
    Room("control/stability/tracking/error_equations", _TRACKING),
    Room(
        "control/stability/tracking/on_line",
        (*_TRACKING, "control/stability/tracking/test_tube_claims.py::test_sigma_on_line_is_of_a_tube"),
        (("while error > sigma_error", "steps < _MOST", "how many steps are tried"),),
    ),
    Room(
        "control/stability/tracking/tracking_error",
        (*_TRACKING, "control/stability/tracking/test_tube_claims.py::test_a_certificate_says_what_its_fact_does"),
    ),
    Room(
        "control/stability/tracking/tube_certificate",
        (
            *_TRACKING,
            "control/stability/tracking/test_tube_claims.py::test_a_certificate_says_what_its_fact_does",
            "identification/test_adaptive_tube_claims.py",
        ),
        places=tuple(
            f"TubeCertificate.{name}"
            for name in ("_known", "_is_of_law", "replay", "_found", "_bounds", "times", "errors", "error", "ultimate")
        ),
    ),
    Room(
        "control/stability/tracking/storage",
        ("control/stability/tracking/test_sharp_storage.py", "proof/test_sharp_every.py"),
        (
            ("np.isfinite(inner)", "any instead of all", "an inverse that is not known is infinite in every entry"),
            ("np.isfinite(M)", "any instead of all", "no eigenvalue of what is no number is above 1e-7"),
            ("np.isfinite(M)", "not asked: np.isfinite(M)", "no eigenvalue of what is no number is above 1e-7"),
            ("(1.0 - _CLEAR)", "without _CLEAR", "1e-9 of 1e-7 at least is below what doubles near 1 tell apart"),
        ),
    ),
)

_PROPOSED = "it proposes cells and corners: `SublevelProved` checks them, and finds the level again"
_TRIED = "which boxes are tried: Theorem K is asked of each"
_TUBE = "it proposes cells, boxes and rooms: `TubeKept` checks them, and finds the bound again"
EXCUSED: tuple[Excused, ...] = (
    Excused("control/stability/set_point/certified_cells", ("_ROOM", "_ROOM_AT_LEAST", "_roomier"), _TRIED),
    Excused(
        "control/stability/set_point/starting_cells",
        ("_SHRINK", "_LARGEST", "_LATTICE", "_Trials.__init__", "_height"),
        _TRIED,
    ),
    Excused("control/stability/set_point/flood", (), _PROPOSED),
    Excused(
        "control/stability/set_point/certified_cells",
        (
            "_ONE",
            "aligned",
            "CellStore.add_first",
            "CellStore.face",
            "CellStore.exposed",
            "CellStore.extend",
            "CellStore.agree",
            "CellStore._append",
            "CellStore._meet",
            "_places_beside",
        ),
        _PROPOSED,
    ),
    Excused("control/stability/set_point/starting_cells", ("cells_around",), _PROPOSED),
    Excused("control/stability/set_point/cell_facts", (), _PROPOSED),
    Excused("control/stability/set_point/set_point_cells", ("CellPart.middle",), _PROPOSED),
    Excused("control/stability/set_point/set_point_certificate", ("SetPointCertificate.reason",), "words"),
    Excused("control/stability/tracking/tracking_error", ("TrackingCertificate.reason",), "words"),
    Excused("control/stability/set_point/theorem3", ("_sampled",), "of a region that is sampled nothing is proved"),
    Excused("control/stability/tracking/reference_tube", (), _TUBE),
    Excused("control/stability/tracking/tube_search", (), _TUBE),
    Excused("control/stability/tracking/cell_forms", ("CellForms.chunk", "CellForms.middles"), _TUBE),
    Excused(
        "control/stability/set_point/well",
        ("_SWEEPS", "_SETTLED"),
        "when a search ends: its point, wherever, gives a bound",
    ),
    Excused(
        "control/stability/set_point/sampled_region",
        (),
        "of a region that is sampled nothing is proved",
    ),
    Excused(
        "control/stability/tracking/deviation", ("_NUMBERS", "deviation_of"), "how many cells are bounded at a time"
    ),
    Excused(
        "control/stability/tracking/error_equations",
        ("_DECAYS", "_CROSS", "_KEPT", "_ellipsoids", "_crossed"),
        "storage functions that are tried: `gain` and `widths` bound what any of them gives",
    ),
    Excused(
        "control/stability/tracking/tracking_error",
        ("_LEAST", "_MIDDLE", "_STRIDE", "_NEAR", "largest_sigma_error"),
        "which ε are tried: each has the certificate that is told",
    ),
)
