"""Theorem 3, tubes about references, tracking."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

_WELLS = ("control/stability/set_point/test_sharp_wells.py",)
_TRACKING = ("control/stability/tracking/test_sharp_tracking.py",)
ROOMS: tuple[Room, ...] = (
    Room(
        "control/stability/set_point/certified_cells",
        ("CellStore.agree",),
        ("control/stability/set_point/test_sharp_cells.py",),
    ),
    Room(
        "control/stability/set_point/well",
        ("_ROUNDING", "Well.range_over", "Well.quadratic", "Well._descend", "wells", "_efforts"),
        _WELLS,
    ),
    Room(
        "control/stability/set_point/gains",
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
    Room("control/stability/tracking/deviation", ("Deviation.size", "_motion", "thickened"), _TRACKING),
    Room("control/stability/tracking/on_line", ("online_demand", "_speed", "_newton", "_worst"), _TRACKING),
    Room(
        "control/stability/tracking/tube_search",
        (
            "_ROOM",
            "TubeSearch.found",
            "TubeSearch._levels",
            "TubeSearch._open",
            "TubeSearch._proven",
            "TubeSearch._undecided",
            "_reached",
        ),
        _TRACKING,
    ),
    Room(
        "control/stability/tracking/tracking_error",
        ("TrackingCertificate.error", "_certificate", "_bound", "_check"),
        _TRACKING,
    ),
    Room(
        "control/stability/tracking/storage",
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
        ("control/stability/tracking/test_sharp_storage.py", "proof/test_sharp_every.py"),
        (
            ("np.isfinite(inner)", "any instead of all", "an inverse that is not known is infinite in every entry"),
            ("np.isfinite(M)", "any instead of all", "no eigenvalue of what is no number is above 1e-7"),
            ("np.isfinite(M)", "not asked: np.isfinite(M)", "no eigenvalue of what is no number is above 1e-7"),
            ("(1.0 - _CLEAR)", "without _CLEAR", "1e-9 of 1e-7 at least is below what doubles near 1 tell apart"),
        ),
    ),
)

EXCUSED: tuple[Excused, ...] = (
    Excused(
        "control/stability/set_point/well",
        ("_SWEEPS", "_SETTLED"),
        "when a search ends: its point, wherever, gives a bound",
    ),
    Excused(
        "control/stability/set_point/well",
        ("checked_region", "sample_region"),
        "of a region that is sampled nothing is proved",
    ),
    Excused(
        "control/stability/tracking/deviation", ("_NUMBERS", "deviation_of"), "how many cells are bounded at a time"
    ),
    Excused(
        "control/stability/tracking/storage",
        ("_DECAYS", "_CROSS", "_KEPT", "plan_for", "_ellipsoids"),
        "plans that are tried: `gain` and `widths` bound what any of them gives",
    ),
    Excused("control/stability/tracking/tube_search", ("_FIRST", "_MORE"), "how rooms grow that are tried"),
    Excused("control/stability/tracking/tube_search", ("TubeSearch.__init__",), "counts rounds, for words"),
    Excused(
        "control/stability/tracking/tube_search",
        ("TubeSearch._planned", "TubeSearch._stopped"),
        "a plan that is tried, and words",
    ),
    Excused(
        "control/stability/tracking/tracking_error",
        ("_LEAST", "_MIDDLE", "_STRIDE", "_NEAR", "largest_sigma_error"),
        "which ε are tried: each has the certificate that is told",
    ),
)
