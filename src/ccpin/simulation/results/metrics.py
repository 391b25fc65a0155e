"""Numbers that summarise a set-point motion."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, positive
from ccpin.control.control_law import ControlLaw, stated
from ccpin.control.laws import PDFullGravity, PDSimpleGravity
from ccpin.dynamics.reduced_model import ReducedModel, coordinates_of
from ccpin.errors import InvalidInputError
from ccpin.kinematics.coordinates import checked_q
from ccpin.mechanism.mechanism import Mechanism, mechanism_of
from ccpin.proof.digests import require_same
from ccpin.simulation.results.trajectory import Trajectory


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
    trajectory: Trajectory, mechanism: Mechanism | ReducedModel, goal: ArrayLike, band: float = np.radians(2.0)
) -> Metrics:
    """Summarise a motion towards a goal.

    Args:
        trajectory: The motion.
        mechanism: What moved: a mechanism or model.
        goal: q_d, of shape (model.nq,).
        band: Settling band, rad or m.

    Raises:
        InvalidInputError: The goal has the wrong shape or is not finite.
        DifferentSubjectsError: It is a motion of another mechanism.
    """
    instance(trajectory, "trajectory", Trajectory)
    band = positive(band, "band", "a positive number (rad or m)")
    require_same("metrics of a motion", mechanism_of(mechanism).digests, trajectory.origin, "closures")
    coordinates = coordinates_of(mechanism)
    q_d = checked_q(coordinates, goal, "goal")
    each = trajectory.q
    error = q_d - each if coordinates.scalar else np.array([coordinates.difference(q, q_d) for q in each])
    outside = np.flatnonzero(np.abs(error).max(axis=1) > band)
    settled: float | None = 0.0
    if outside.size:
        settled = None if outside[-1] + 1 == len(error) else float(trajectory.t[outside[-1] + 1])
    direction = np.sign(error[0])
    return Metrics(
        band=band,
        settling_time=settled,
        overshoot=np.maximum(0.0, -(error * direction).min(axis=0)),
        peak_torque=np.abs(trajectory.u).max(axis=0),
        steady_state_error=np.abs(error[-1]),
        largest_closure_error=float(trajectory.closure_error.max()),
    )


def band_in_words(mechanism: Mechanism, band: float) -> str:
    """A band (rad or m) of coordinates that turn in degrees, of those that slide in millimetres, of both in both."""
    slides = [slide for part in mechanism.parametrization().coordinates.parts for slide in part.slides]
    told = {True: f"{1e3 * band:.3g} mm", False: f"{np.degrees(band):.3g}°"}
    return " or ".join(told[slide] for slide in dict.fromkeys(slides))


# The Lyapunov function of a set point along a motion.


class LyapunovHistory(NamedTuple):
    """𝒱 and its rate at the samples of a motion.

    Attributes:
        V: 𝒱 in joules, of shape (T,).
        V_dot: 𝒱̇ in watts, from the power of the efforts and dampers that acted, of shape (T,).
        dissipation: −q̇ᵀ(K_v + damping)q̇ in watts, what Theorem 3 says 𝒱̇ is, of shape (T,).
    """

    V: Array
    V_dot: Array
    dissipation: Array


def lyapunov_along(law: PDSimpleGravity | PDFullGravity, trajectory: Trajectory) -> LyapunovHistory:
    """𝒱 of a law along a motion under it.

    The energy balance d/dt(½q̇ᵀDq̇ + V) = q̇ᵀ(ρᵀSᵀu − damping q̇) makes 𝒱̇ = q̇ᵀ(ρᵀSᵀu − damping q̇ − K_p q̃ − g(q_d)) with
    simple compensation (28) and q̇ᵀ(ρᵀSᵀu − damping q̇ − K_p q̃ − g(q)) with full compensation (30), whatever u was. Under
    the law itself this is −q̇ᵀ(K_v + damping)q̇; a saturated or sampled controller departs from it. The power of dry
    friction, of contacts, end stops and wrenches is not in it: where they act 𝒱 changes otherwise than 𝒱̇ says.

    Raises:
        InvalidInputError: Another law.
        DifferentSubjectsError: The motion is of another mechanism than the law's: of a nominal one, say, which is no
            Lyapunov function of that plant.
    """
    told = stated(instance(law, "law", ControlLaw))
    if told is None or not told.holds or told.kind not in ("pd", "pd_gravity"):
        raise InvalidInputError(f"law must be PDSimpleGravity or PDFullGravity, not {type(law).__name__}")
    instance(trajectory, "trajectory", Trajectory)
    model, samples = trajectory.of("𝒱 along a motion", law.model, "closures", "dynamics"), []
    for state, v, u in trajectory.states(model):
        force = (
            state.generalized_force(u)
            - law.K_p @ law.error(state.q)
            - (state.g if told.kind == "pd_gravity" else told.constant)
        )
        lost = v @ state.damping @ v
        samples.append((law.lyapunov(state, v), v @ force - lost, -(v @ law.K_v @ v) - lost))
    return LyapunovHistory(*np.array(samples).T)
