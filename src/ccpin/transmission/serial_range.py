"""A range that a serial robot may have, and the limits of effort and speed that its motors keep over it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, corners, whole
from ccpin.errors import InvalidInputError
from ccpin.transmission.motor_bounds import stated_efforts, stated_speeds
from ccpin.transmission.motor_limits import LimitsCertificate, certify_limits
from ccpin.transmission.posture import Posture
from ccpin.transmission.serial_misfits import most
from ccpin.transmission.surveys import Survey, survey
from ccpin.transmission.transmission import Transmission

_SMALLER = 0.95  # of a range of which something is not reached
_LEAST = 0.05  # of the stated one
_BELOW = 1.0 - 1e-12  # room for rounding
_CLOSE = 1e-9  # rad or m beyond a limit


class Reached(NamedTuple):
    """A range, of shape (n,) each, and its postures, in the order of a grid."""

    lower: Array
    upper: Array
    grid: tuple[Posture, ...]


def reached(transmission: Transmission, region: tuple[ArrayLike, ArrayLike] | None, count: int) -> Reached:
    """The region, or the joints' own limits drawn towards the reference until all of it is reached.

    Raises:
        InvalidInputError: Of a region something is not reached, or outside other joints' limits; or of any range.
    """
    if region is not None:
        ends = corners(region, "region", transmission.n)
        found = survey(transmission, *ends, count=count)
        lacking = _lacking(found)
        if lacking:
            raise InvalidInputError(f"region: {lacking}")
        return _in_order(found, count)
    found = survey(transmission, count=count)
    home, lower, upper = transmission.reference.q_joint, found.lower, found.upper
    part = 1.0
    while lacking := _lacking(found):
        part *= _SMALLER
        if part < _LEAST:
            raise InvalidInputError(f"no range about the reference: {lacking}; give region=")
        found = survey(transmission, home + part * (lower - home), home + part * (upper - home), count=count)
    return _in_order(found, count)


def _lacking(found: Survey) -> str:
    """What is wrong with a range; nothing where all is well."""
    if found.missed:
        return f"{found.missed} of its {found.missed + len(found.postures)} postures are not reached"
    mechanism = found.transmission.joint_model.mechanism
    least, greatest = mechanism.position_limits
    for joint in mechanism.tree.joints:
        if joint.name in found.transmission.joints or joint.kind.nq != 1:
            continue
        at = np.array([posture.state.q_free[joint.q][0] for posture in found.postures])
        if at.min() < least[joint.q][0] - _CLOSE or at.max() > greatest[joint.q][0] + _CLOSE:
            return f"'{joint.name}' leaves its limits there"
    return ""


def _in_order(found: Survey, count: int) -> Reached:
    """Its postures as a grid has them, the last joint's displacement changing fastest."""
    steps = (found.upper - found.lower) / (whole(count, "count", 3) - 1)
    if not (steps > 0.0).all():
        raise InvalidInputError("a joint whose limits leave it no range: give region=")
    places = {tuple(np.rint((p.q_joint - found.lower) / steps).astype(int).tolist()): p for p in found.postures}
    return Reached(found.lower, found.upper, tuple(places[place] for place in sorted(places)))


class EffortLimits(NamedTuple):
    """Half-widths of a box, of shape (n,), ∞ where none is stated of the motors; and its certificate, if any."""

    box: Array
    held: LimitsCertificate | None


def effort_limits(
    transmission: Transmission, found: Reached, count: int, effort: ArrayLike | None, cells: int
) -> EffortLimits:
    """Efforts of joints that the motors give at every posture: proved, or else of samples with what may lie between.

    Raises:
        InvalidInputError: A motor that gives one way only, or an effort that is none.
        CcpinError: What proves is not installed.
    """
    try:
        least, greatest = stated_efforts(transmission.joint_model, transmission.motors, effort)
    except InvalidInputError:
        if effort is not None:
            raise
        return EffortLimits(np.full(transmission.n, np.inf), None)
    room = np.minimum(greatest, -least)
    if not (room > 0.0).all():
        raise InvalidInputError(f"every motor must give both ways: {least} … {greatest}")
    held = certify_limits(transmission, (found.lower, found.upper), effort=room, max_cells=cells) if cells else None
    if held is not None and held.verdict == "proven":
        return EffortLimits(held.half_widths, held)
    asked = most(np.array([posture.inverse.T for posture in found.grid]), count, transmission.n)
    shape = _middle(found).torque_polytope(effort=room, friction=0.0).largest_box()
    return EffortLimits(shape * float((room / (asked @ shape)).min()), held)


def motor_speeds(transmission: Transmission, speed: ArrayLike | None) -> Array | None:
    """The motors' largest speeds; ``None`` where neither the caller nor the mechanism states any.

    Raises:
        InvalidInputError: A speed that is none.
    """
    try:
        return stated_speeds(transmission.joint_model, transmission.motors, transmission.motor_side.rows, speed)
    except InvalidInputError:
        if speed is not None:
            raise
        return None


def speed_limits(found: Reached, rates: Array, room: Array | None) -> Array:
    """Speeds of joints at which no motor is faster than `room`, if |J| ≤ `rates` all over the range; ∞ without it."""
    if room is None:
        return np.full(rates.shape[1], np.inf)
    shape = _middle(found).speed_polytope(speed=room).largest_box()
    return np.asarray(shape * float((room / (rates @ shape)).min()) * _BELOW)


def _middle(found: Reached) -> Posture:
    return found.grid[len(found.grid) // 2]
