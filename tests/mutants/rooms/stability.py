"""Theorem 3, tubes about references, tracking."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_WELLS = ("control/stability/test_sharp_wells.py",)
_TRACKING = ("control/stability/test_sharp_tracking.py",)
ROOMS: tuple[Room, ...] = (
    Room("control/stability/cells", ("CellStore.agree",), ("control/stability/test_sharp_cells.py",)),
    Room(
        "control/stability/well",
        ("_ROUNDING", "Well.range_over", "Well.quadratic", "Well._descend", "wells", "_efforts"),
        _WELLS,
    ),
    Room(
        "control/stability/gains",
        (
            "_ABOVE",
            "_ACCURACY",
            "local_gains",
            "_damped",
            "suggest_gains",
            "_norm_over",
            "_what_limits",
            "_what_is_too_much",
            "gravity_slope_over",
        ),
        _WELLS,
    ),
    Room("control/stability/deviation", ("Deviation.size", "_motion", "thickened"), _TRACKING),
    Room("control/stability/on_line", ("online_demand", "_speed", "_newton", "_worst"), _TRACKING),
    Room(
        "control/stability/tracking_search",
        ("_ROOM", "Search.found", "Search._levels", "Search._open", "Search._proven", "Search._undecided", "_reached"),
        _TRACKING,
    ),
    Room("control/stability/tracking_error", ("TrackingCertificate.error", "_certificate", "_bound", "_check"), _TRACKING),
    Room(
        "control/stability/storage",
        (
            "_CLEAR",
            "_DEFINITE",
            "floor",
            "gain",
            "widths",
            "_inverse_form",
            "_inverted",
            "_constant",
            "storage_of",
            "_blocks",
        ),
        ("control/stability/test_sharp_storage.py", "domain/test_sharp_every.py"),
        (
            ("np.isfinite(inner)", "any instead of all", "an inverse that is not known is infinite in every entry"),
            ("np.isfinite(M)", "any instead of all", "no eigenvalue of what is no number is above 1e-7"),
            ("np.isfinite(M)", "not asked: np.isfinite(M)", "no eigenvalue of what is no number is above 1e-7"),
            ("(1.0 - _CLEAR)", "without _CLEAR", "1e-9 of 1e-7 at least is below what doubles near 1 tell apart"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused("control/stability/well", ("_SWEEPS", "_SETTLED"), "when a search ends: its point, wherever, gives a bound"),
    Excused("control/stability/well", ("checked_region", "sample_region"), "of a region that is sampled nothing is proved"),
    Excused("control/stability/deviation", ("_NUMBERS", "deviation_of"), "how many cells are bounded at a time"),
    Excused(
        "control/stability/storage",
        ("_DECAYS", "_CROSS", "_KEPT", "plan_for", "_ellipsoids"),
        "plans that are tried: `gain` and `widths` bound what any of them gives",
    ),
    Excused("control/stability/tracking_search", ("_FIRST", "_MORE"), "how rooms grow that are tried"),
    Excused("control/stability/tracking_search", ("Search.__init__",), "counts rounds, for words"),
    Excused("control/stability/tracking_search", ("Search._planned", "Search._stopped"), "a plan that is tried, and words"),
    Excused(
        "control/stability/tracking_error",
        ("_LEAST", "_MIDDLE", "_STRIDE", "_NEAR", "largest_sigma_error"),
        "which ε are tried: each has the certificate that is told",
    ),
)
