"""The region of q-space an atlas is asked for."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.domain.atlas.cells import Region
from ccpin.domain.chains import Seed
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism

TURN = 2.0 * np.pi
_SLACK = 1e-9


def region_of(mechanism: Mechanism, seed: Seed, region: ArrayLike | None) -> Region:
    """The region asked for, or by default a full turn for a joint whose limits allow it, the limits otherwise.

    A periodic coordinate given a full turn (to 1e-9) closes on itself. A default full turn is [−π, π].

    Raises:
        InvalidInputError: Bounds are malformed, do not hold q₀ or exceed a full turn; or a slide has no limits.
    """
    system = seed.system
    periodic, q0 = system.periodic[system.independent], seed.theta[system.independent]
    bounds = _limits(mechanism, seed) if region is None else np.array(region, dtype=np.float64)
    names = mechanism.independent
    if bounds.shape != (system.n, 2) or not np.all(np.isfinite(bounds)):
        raise InvalidInputError(
            f"region must be finite lower and upper bounds of {', '.join(names)}, of shape ({system.n}, 2); "
            f"it has shape {bounds.shape}"
        )
    lower, upper = bounds[:, 0].copy(), bounds[:, 1].copy()
    wrapped = periodic & (upper - lower >= TURN - _SLACK)
    if np.any(upper - lower > TURN + _SLACK, where=periodic):
        raise InvalidInputError("a region may not exceed a full turn of a revolute joint")
    upper[wrapped] = lower[wrapped] + TURN
    if np.any(upper <= lower):
        raise InvalidInputError("the region's upper bounds must exceed its lower bounds")
    inside = wrapped | ((q0 >= lower) & (q0 <= upper))
    if not np.all(inside):
        name = names[int(np.argmin(inside))]
        raise InvalidInputError(f"q0 = {q0.tolist()} lies outside the region in '{name}'")
    return Region(lower, upper, wrapped)


def _limits(mechanism: Mechanism, seed: Seed) -> Array:
    """Default bounds of the independent coordinates."""
    system, model = seed.system, mechanism.tree.model
    bounds = np.tile(np.array([-np.pi, np.pi]), (system.n, 1))
    for row, index in enumerate(system.independent):
        joint = next(joint for joint in system.chart.joints if joint.v.start <= index < joint.v.stop)
        low, high = -np.inf, np.inf
        if joint.kind.nq == 1:
            low, high = float(model.lowerPositionLimit[joint.q.start]), float(model.upperPositionLimit[joint.q.start])
        if system.periodic[index] and not high - low < TURN - _SLACK:
            continue
        if not np.isfinite(high - low):
            raise InvalidInputError(f"joint '{joint.name}' has no limits: give a region")
        bounds[row] = low, high
    return bounds
