"""A periodic motion of the joints to try a transmission with."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, instance, positive, vector, whole
from ccpin.control.references import Reference, ReferenceState
from ccpin.transmission.transmission import Transmission


class Swing(Reference):
    """q_d(t) = centre − amplitude cos 2πft over whole cycles, all joints in step: at rest at both ends.

    Args:
        transmission: Whose joints.
        amplitude: Of each joint, rad or m, of shape (n,).
        frequency: f, Hz.
        centre: q_j in the middle, of shape (n,); default the reference's.
        cycles: How many.

    Raises:
        InvalidInputError: A wrong shape, or a number out of its range.
    """

    def __init__(
        self,
        transmission: Transmission,
        amplitude: ArrayLike,
        frequency: float,
        centre: ArrayLike | None = None,
        cycles: int = 1,
    ) -> None:
        n = instance(transmission, "transmission", Transmission).n
        self._side = transmission.joint_side
        self._amplitude = frozen(vector(amplitude, "amplitude", n))
        self._centre = frozen(transmission.reference.q_joint if centre is None else vector(centre, "centre", n))
        self._rate = 2.0 * np.pi * positive(frequency, "frequency")
        self.duration = whole(cycles, "cycles") * 2.0 * np.pi / self._rate

    def at(self, t: float) -> ReferenceState:
        """q_d, q̇_d and q̈_d at time t."""
        w, A = self._rate, self._amplitude
        rest = t < 0.0 or t > self.duration
        phase = 0.0 if rest else w * t
        v, a = (np.zeros_like(A),) * 2 if rest else (w * np.sin(phase) * A, w * w * np.cos(phase) * A)
        position: Array = self._centre - np.cos(phase) * A
        return ReferenceState(self._side.configuration(position), v, a)

    def next_switch(self, t: float) -> float:
        """The start, then the end."""
        return 0.0 if t < 0.0 else self.duration if t < self.duration else np.inf
