"""Atlases of σ's domain, Theorem 2, bounds of the dynamics."""

from __future__ import annotations

from tests.mutants.room import Excused, Room

ROOMS: tuple[Room, ...] = (
    Room(
        "control/stability/set_point/potential",
        ("_remainder", "_slope_bound", "_curvature_change", "_inverse_bound", "_variation", "_symmetric"),
        ("control/stability/set_point/test_sharp_gravity.py",),
    ),
)

EXCUSED: tuple[Excused, ...] = ()
