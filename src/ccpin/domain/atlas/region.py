"""The region of q-space an atlas is asked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.domain.atlas.cells import Region
from ccpin.domain.chains import Seed
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism

Corners = Sequence[ArrayLike] | Array  # (lower, upper)
TURN = 2.0 * np.pi
_SLACK = 1e-9


def corners_of(region: Corners, names: Sequence[str]) -> tuple[Array, Array]:
    """The corners (lower, upper) of a region over named coordinates, n finite numbers each, lower below upper.

    Raises:
        InvalidInputError: They are not.
    """
    n = len(names)
    try:
        corners = np.array(region, dtype=np.float64)
    except (TypeError, ValueError):
        corners = np.empty(0)
    if corners.shape != (2, n) or not np.all(np.isfinite(corners)):
        raise InvalidInputError(
            f"a region is (lower, upper), each of shape ({n},) and finite: one bound a coordinate ({', '.join(names)})"
        )
    if np.any(corners[1] <= corners[0]):
        raise InvalidInputError(
            f"the region's lower corner {corners[0].tolist()} must be below its upper corner {corners[1].tolist()}"
        )
    return corners[0], corners[1]


def region_of(mechanism: Mechanism, seed: Seed, region: Corners | None) -> Region:
    """The region asked for, or by default a full turn for a joint whose limits allow it, the limits otherwise.

    A periodic coordinate given a full turn (to 1e-9) closes on itself. A default full turn is [−π, π].

    Raises:
        InvalidInputError: Bounds are malformed, do not hold q₀ or exceed a full turn; or a slide has no limits.
    """
    system = seed.system
    periodic, q0 = system.periodic[system.independent], seed.theta[system.independent]
    names = mechanism.independent
    lower, upper = corners_of(_limits(mechanism, seed) if region is None else region, names)
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
    system, model = seed.system, mechanism.tree.model
    lower, upper = np.full(system.n, -np.pi), np.full(system.n, np.pi)
    for row, index in enumerate(system.independent):
        joint = next(joint for joint in system.chart.joints if joint.v.start <= index < joint.v.stop)
        low, high = -np.inf, np.inf
        if joint.kind.nq == 1:
            low, high = float(model.lowerPositionLimit[joint.q.start]), float(model.upperPositionLimit[joint.q.start])
        if system.periodic[index] and not high - low < TURN - _SLACK:
            continue
        if not np.isfinite(high - low):
            raise InvalidInputError(f"joint '{joint.name}' has no limits: give a region")
        lower[row], upper[row] = low, high
    return lower, upper
