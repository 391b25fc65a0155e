"""What of a mechanism can be searched: a region of its independent coordinates, ranges of the dependent ones."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.covering.region import Corners, Region, corners_of
from ccpin.domain.closures.seeds import Seed
from ccpin.domain.closures.system import Reading
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.kinematics.coordinates import component_names
from ccpin.mechanism.mechanism import Mechanism
from ccpin.proof.ranges import NO_LIMIT, Ranges, ranges_of
from ccpin.proof.rounding import TURN

_SLACK = 1e-9  # rad: what a full turn may lack
_MOST_INDEPENDENT = 3  # cells double with every halving of every edge
MOST_DEPENDENT = 8
"""Dependent coordinates: the search of all values of more would not end."""


def region_of(mechanism: Mechanism, seed: Seed, region: Corners | None) -> Region:
    """The region asked for, or by default a full turn for a joint whose limits allow it, the limits otherwise.

    A periodic coordinate given a full turn (to 1e-9) closes on itself. A default full turn is [−π, π].

    Raises:
        InvalidInputError: Bounds are malformed, do not hold q₀ or exceed a full turn; or a slide has no limits.
    """
    system = seed.reading.system
    periodic, q0 = system.periodic[system.independent], seed.q
    names = mechanism.independent
    lower, upper = corners_of(_limits(mechanism, seed) if region is None else region, names, slices=True)
    wrapped = periodic & (upper - lower >= TURN - _SLACK)
    if np.any(upper - lower > TURN + _SLACK, where=periodic):
        raise InvalidInputError("a region may not exceed a full turn of a revolute joint")
    upper[wrapped] = lower[wrapped] + TURN
    inside = wrapped | ((q0 >= lower) & (q0 <= upper))
    if not np.all(inside):
        name = names[int(np.argmin(inside))]
        raise InvalidInputError(f"q0 = {q0.tolist()} lies outside the region in '{name}'")
    return Region(lower, upper, wrapped)


def _limits(mechanism: Mechanism, seed: Seed) -> tuple[Array, Array]:
    """Default bounds of the independent coordinates."""
    system, model = seed.reading.system, mechanism.tree.model
    lower, upper = np.full(system.n, -np.pi), np.full(system.n, np.pi)
    for row, index in enumerate(system.independent):
        joint = next(joint for joint in seed.reading.chart.joints if joint.v.start <= index < joint.v.stop)
        low, high = -np.inf, np.inf
        if joint.kind.nq == 1:
            low, high = float(model.lowerPositionLimit[joint.q.start]), float(model.upperPositionLimit[joint.q.start])
        if system.periodic[index] and not high - low < TURN - _SLACK:
            continue
        if not np.isfinite(high - low):
            raise InvalidInputError(f"joint '{joint.name}' has no limits: give a region")
        lower[row], upper[row] = low, high
    return lower, upper


def check_searchable(mechanism: Mechanism, reading: Reading, what: str = "sheets cannot be counted") -> None:
    """What cannot be searched exhaustively."""
    why, system = None, reading.system
    if not 1 <= mechanism.n <= _MOST_INDEPENDENT:
        why = f"it has {mechanism.n} independent coordinates, and sheets are for one to three"
    elif system.m > MOST_DEPENDENT:
        why = f"{system.m} of its coordinates depend, and all values of more than {MOST_DEPENDENT} take too long"
    elif any(joint.kind.unit == 4 for joint in reading.chart.joints):
        why = "it has ball joints, whose turns have no range to be searched; universal joints have"
    elif reading.rods:
        why = "distance closures stand for rods with two angles, which say the same twice"
    elif np.any(system.moduli):
        why = "it has couplings of continuous joints"
    elif turnable := [loop.closure for loop in mechanism.constraints().loops if loop.turnable]:
        why = (
            f"the rows of closure '{turnable[0].name}' ({turnable[0].kind}) vanish with its ends turned over too, and "
            "these would count; cut the loop open at a joint about one axis, or at a ball joint"
        )
    if why is not None:
        raise UnsupportedMechanismError(f"{mechanism.name}: its {what}: {why}")


def region_about(mechanism: Mechanism, reading: Reading, region: Corners | None) -> Region:
    """The region asked for, or what the joints allow."""
    theta = reading.theta(mechanism.q_reference)
    if region is not None:
        theta[reading.system.independent] = np.mean(corners_of(region, mechanism.independent), axis=0)
    return region_of(mechanism, Seed(reading, theta), region)


def searched_ranges(mechanism: Mechanism, reading: Reading, region: Region) -> Ranges:
    """What is searched of the dependent coordinates over a region (Lemma R): all there is within the joints' limits.

    Raises:
        UnsupportedMechanismError: Nothing bounds one of them.
    """
    system, model, names = reading.system, mechanism.tree.model, component_names(mechanism.tree)
    limits = np.tile([-NO_LIMIT, NO_LIMIT], (system.n_free, 1))
    for joint in reading.chart.joints:
        if joint.kind.nq == 1:
            low, high = model.lowerPositionLimit[joint.q.start], model.upperPositionLimit[joint.q.start]
            limits[joint.v.start] = max(low, -NO_LIMIT), min(high, NO_LIMIT)
    middle = reading.theta(mechanism.q_reference)
    return ranges_of(system, middle, (region.lower, region.upper), limits[system.dependent], names)


def all_values(reading: Reading, lower: Array, upper: Array) -> Ranges | None:
    """Ranges that hold every closed configuration over lower ≤ q ≤ upper (n,); ``None`` where there are none known."""
    system = reading.system
    if reading.rods or np.any(system.moduli) or any(joint.kind.unit == 4 for joint in reading.chart.joints):
        return None
    limits = np.tile([-NO_LIMIT, NO_LIMIT], (system.m, 1))
    names = [str(j) for j in range(system.n_free)]
    try:
        return ranges_of(system, np.zeros(system.n_free), (lower, upper), limits, names)
    except UnsupportedMechanismError:
        return None
