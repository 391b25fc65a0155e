"""Compensation of Coulomb friction, on top of a set-point law.

The feedforward of the paper's experiments was "g(q_d) plus Coulomb friction estimated at q_d" (Section IV-B). It gives
no formula. Two readings are offered, both exact about what a motor can know:

- towards the goal (`q_start` given): ĉ sign(q_d − q_start), computed once and constant like g(q_d). It is the friction
  of the joints as they arrive at q_d, and so the literal reading. While a joint moves to its goal it cancels
  friction; when it comes back from an overshoot it doubles it.
- by the error (`q_start` left out): ĉ sat(q̃/width), which pushes towards q_d from either side and fades out linearly
  within `width`, so that a sampled loop does not chatter there. It adds ĉ/width to the proportional gain near q_d, so
  K_v has to damp that much more.

ĉ above the true level makes the second reading hunt, and the first one push the joint past its goal.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.control.laws import ControlLaw, PDFullGravity, PDSimpleGravity
from ccpin.errors import InvalidInputError, UnsupportedMechanismError

Array = NDArray[np.float64]


class CoulombCompensation(ControlLaw):
    """A PD law plus ĉ times a direction: sign(q_d − q_start), or sat(q̃/width).

    Args:
        law: The PD law; its motors must be on the independent joints.
        coulomb: ĉ, the estimated Coulomb levels, N m or N: a number or (n,).
        q_start: Where the move starts, of shape (nq_independent,), for the first reading.
        width: Where the second reading fades out, rad or m.

    Raises:
        InvalidInputError: Levels that are negative, not finite or too many; a width that is not positive.
        UnsupportedMechanismError: The motors are not on the independent joints.
    """

    def __init__(
        self,
        law: PDSimpleGravity | PDFullGravity,
        coulomb: ArrayLike,
        q_start: ArrayLike | None = None,
        width: float = 0.01,
    ) -> None:
        model = law.model
        if model.mechanism.actuated != model.mechanism.independent:
            raise UnsupportedMechanismError(
                "friction compensation needs the motors on the independent joints, in order"
            )
        level = np.asarray(coulomb, dtype=np.float64)
        if level.shape not in ((), (model.n,)) or not np.isfinite(level).all() or np.any(level < 0):
            raise InvalidInputError(f"coulomb must be a number or ({model.n},), finite and at least zero: {coulomb!r}")
        if not (np.isfinite(width) and width > 0):
            raise InvalidInputError(f"width = {width} must be positive")
        self._law, self._width = law, width
        self._level = np.array(np.broadcast_to(level, (model.n,)))
        self._direction = None if q_start is None else np.sign(law.error(model.checked_q(q_start)))

    def torque(self, t: float, q: Array, v: Array, guess: Array | None = None) -> Array:
        """The PD law's efforts plus the compensation, of shape (motors,)."""
        direction = self._direction
        if direction is None:
            direction = np.clip(self._law.error(q) / self._width, -1.0, 1.0)
        return np.asarray(self._law.torque(t, q, v, guess) + self._level * direction)
