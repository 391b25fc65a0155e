"""What constants explain of a log that they were, or were not, found from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, instance
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.errors import InvalidInputError
from ccpin.identification.logs.log import Log
from ccpin.identification.logs.smoothing import Smoothed, smoothed
from ccpin.mechanism.mechanism import Mechanism


class Explained(NamedTuple):
    """Generalised forces ρᵀSᵀu of a log and what constants say of them, N m or N.

    Attributes:
        t: Times of the samples that have all efforts, s, of shape (K,).
        v: The velocities q̇ at them, of shape (K, n).
        measured: ρᵀSᵀu as measured, of shape (K, n). told: Y π, alike.
        names: Of the independent coordinates.
    """

    t: Array
    v: Array
    measured: Array
    told: Array
    names: tuple[str, ...]

    @property
    def left(self) -> Array:
        """What the constants do not explain, of shape (K, n)."""
        return self.measured - self.told

    @property
    def share(self) -> Array:
        """Root mean square of what is left, over that of what was measured, of shape (n,)."""
        left = np.sqrt((self.left**2).mean(axis=0))
        return np.asarray(left / np.maximum(np.sqrt((self.measured**2).mean(axis=0)), np.finfo(float).tiny))


def explained(
    model: ReducedModel | Mechanism,
    parameters: DynamicParameters,
    log: Log,
    *,
    spacing: float | None = None,
    noise: Mapping[str, float] | None = None,
) -> Explained:
    """What constants explain of a log.

    Args:
        model: The mechanism.
        parameters: Its constants, stated or found.
        log: What was measured.
        spacing: As `smoothed` takes it.
        noise: As `smoothed` takes it.

    Raises:
        InvalidInputError: The constants are another mechanism's, or no sample has all efforts.
    """
    model = model_of(model)
    if instance(parameters, "parameters", DynamicParameters).names != model.parameters.names:
        raise InvalidInputError("the constants are those of another mechanism")
    found = told_of_motion(model, parameters, smoothed(log, model, spacing=spacing, noise=noise))
    if not len(found.t):
        raise InvalidInputError(f"no sample of {log!r} has the efforts of all motors")
    return found


def told_of_motion(model: ReducedModel, parameters: DynamicParameters, motion: Smoothed) -> Explained:
    """What constants explain of a log's motion."""
    rows = motion.with_efforts()
    measured, Y = motion.forces(model, rows), model.regressor_many(motion.q[rows], motion.v[rows], motion.a[rows])
    names = tuple(model.coordinates.names)
    return Explained(motion.t[rows], motion.v[rows], measured, Y @ parameters.values, names)
