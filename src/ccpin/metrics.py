"""Numbers that summarise a set-point motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.coordinates import IndependentCoordinates
from ccpin.trajectory import Trajectory

Array = NDArray[np.float64]


class Metrics(NamedTuple):
    """A set-point motion in numbers (rad or m, N m or N, s).

    Attributes:
        band: The band the settling time is about.
        settling_time: First time after which every |q̃| stays within the band; ``None`` if it does not at the end.
        overshoot: Largest excursion of each coordinate beyond the goal, seen from the start, of shape (n,).
        peak_torque: Largest |u| of each motor, of shape (motors,).
        steady_state_error: |q̃| at the last sample, of shape (n,).
        largest_closure_error: Largest ‖φ(q′)‖ of all samples.
    """

    band: float
    settling_time: float | None
    overshoot: Array
    peak_torque: Array
    steady_state_error: Array
    largest_closure_error: float

    def as_json(self) -> dict[str, Any]:
        """The same as plain numbers and lists, SI units and radians."""
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in self._asdict().items()
        }


def set_point_metrics(
    trajectory: Trajectory, coordinates: IndependentCoordinates, goal: ArrayLike, band: float = np.radians(2.0)
) -> Metrics:
    """Summarise a motion towards a goal.

    Args:
        trajectory: The motion.
        coordinates: The model's independent coordinates.
        goal: q_d, of shape (nq_independent,).
        band: Settling band, rad or m.
    """
    q_d = np.asarray(goal, dtype=np.float64)
    error = np.array([coordinates.difference(q, q_d) for q in trajectory.q])
    outside = np.flatnonzero(np.abs(error).max(axis=1) > band)
    settled: float | None = 0.0
    if outside.size:
        settled = None if outside[-1] + 1 == len(error) else float(trajectory.t[outside[-1] + 1])
    direction = np.sign(error[0])
    return Metrics(
        band=float(band),
        settling_time=settled,
        overshoot=np.maximum(0.0, -(error * direction).min(axis=0)),
        peak_torque=np.abs(trajectory.u).max(axis=0),
        steady_state_error=np.abs(error[-1]),
        largest_closure_error=float(trajectory.closure_error.max()),
    )
