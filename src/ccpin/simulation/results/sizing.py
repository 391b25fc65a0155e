"""What a motion asks of motors and bearings: for choosing them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import trapezoid

from ccpin.arrays import Array, instance
from ccpin.control.references import Reference
from ccpin.dynamics.drives import HELD
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.dynamics.wrenches import Pushes, Wrenches
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.results.forces import PeakForce, closure_forces, joint_forces
from ccpin.simulation.results.limit_violations import at_effort_limits, shares_in_words
from ccpin.simulation.results.trajectory import Trajectory

_SIMULATED = (
    "trajectory is a reference, which states neither assembly mode nor friction: give the motion that tracks it, from "
    "start = reference.at(0.0): ccpin.simulate(model, control.ComputedTorque(model, reference, K_p, K_v), start.q, "
    "start.v, duration=reference.duration)"
)


class Sizing(NamedTuple):
    """Motors in their own units (u and the rate it works on: N m and rad/s, N and m/s), of shape (motors,) each.

    Integrals are those of the trapezoidal rule over the samples.

    Attributes:
        motors: Their names.
        rms_effort: √(∫u² dt / T).
        peak_effort: Largest |u|. peak_speed: largest |rate|.
        peak_power: Largest power given to the mechanism, W.
        work: ∫u·rate dt, J. drive_work: of its positive part; braking_work: of its negative part, J.
        bearings: The peak loads of closures and of the tree's joints.
        notes: That motors gave all they have, so that efforts are those and not what the motion that was wanted takes.
    """

    motors: tuple[str, ...]
    rms_effort: Array
    peak_effort: Array
    peak_speed: Array
    peak_power: Array
    work: Array
    drive_work: Array
    braking_work: Array
    bearings: tuple[PeakForce, ...]
    notes: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The motors' numbers as lists, and the bearings' as ``force_NAME`` (N) and ``moment_NAME`` (N m)."""
        numbers = {name: value.tolist() for name, value in self._asdict().items() if isinstance(value, np.ndarray)}
        loads = ({f"force_{peak.name}": peak.force, f"moment_{peak.name}": peak.moment} for peak in self.bearings)
        return numbers | {name: value for each in loads for name, value in each.items()}


def demands(
    model: ReducedModel | Mechanism,
    trajectory: Trajectory,
    wrenches: Wrenches | Pushes | None = None,
    *,
    bearings: bool = True,
) -> Sizing:
    """What a motion asked of its motors and bearings.

    Args:
        model: The reduced model, or a mechanism.
        trajectory: A motion of it.
        wrenches: On links, as for `simulate`.
        bearings: Whether to compute the bearings' loads, which costs most.

    Raises:
        InvalidInputError: It is no trajectory. A reference states neither assembly mode nor friction: simulate its
            tracking first (the message says how).
        DifferentSubjectsError: The trajectory is not this model's.
    """
    if isinstance(trajectory, Reference):
        raise InvalidInputError(_SIMULATED)
    instance(trajectory, "trajectory", Trajectory)
    model = trajectory.of("demands on motors and bearings", model, "closures", "dynamics")
    t, u = trajectory.t, trajectory.u
    S = model.actuation  # of the rates S q̇′ that each u works on
    rates = np.array([v if S is None else S @ state.v_free(v) for state, v, _ in trajectory.states(model)])
    power, duration = u * rates, max(float(t[-1] - t[0]), np.finfo(float).tiny)
    loads = (
        (*closure_forces(model, trajectory, wrenches), *joint_forces(model, trajectory, wrenches)) if bearings else ()
    )
    return Sizing(
        motors=model.mechanism.actuated,
        rms_effort=np.sqrt(trapezoid(u**2, t, axis=0) / duration),
        peak_effort=np.abs(u).max(axis=0),
        peak_speed=np.abs(rates).max(axis=0),
        peak_power=power.max(axis=0),
        work=trapezoid(power, t, axis=0),
        drive_work=trapezoid(np.maximum(power, 0.0), t, axis=0),
        braking_work=trapezoid(np.minimum(power, 0.0), t, axis=0),
        bearings=tuple(load.peak() for load in loads),
        notes=tuple(_given(model.mechanism, trajectory)),
    )


def _given(mechanism: Mechanism, trajectory: Trajectory) -> Iterator[str]:
    """Which efforts are the motors' limits, and whether these hold the mechanism, as the motion's notes have it."""
    at = at_effort_limits(mechanism, trajectory.u)
    if at:
        yield (
            f"peak_effort is what the motors gave, at their limits: {shares_in_words(at)} of the samples; "
            'simulated with limits=Limits(effort="ignore") it is what the motion takes'
        )
        yield from (note for note in trajectory.notes if HELD in note)
