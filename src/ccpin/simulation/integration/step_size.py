"""How far one step of the integrator may reach, so that nothing is stepped over.

The error estimate of a step sees the forces at its stages only, and at rest steps grow without bound; a torque that
comes and goes between two stages would never be felt. So:

- Where the forces say when they change as functions of time (`next_switch`), the integrator starts afresh at each such
  time, and between them the equations are smooth and the error estimate is to be trusted.
- Where they do not say so, and where something is watched for (events, a region, dry friction), no step is longer than
  a 32nd of the time in which the mechanism would fall its own length: 10 ms for the RPDR. What lasts longer than such a
  step is found, whatever the sample period; what is shorter must be named.
"""

from __future__ import annotations

from typing import Protocol, runtime_checkable

import numpy as np

from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.wireframe import outline

_PART = 1 / 32  # of √(2 l/g), the time of a fall through the mechanism's own length
_G = 9.81  # m/s², whatever gravity is stated: a scale of time


@runtime_checkable
class HasSwitches(Protocol):
    """What says when it changes; a law, or a function of time for wrenches."""

    def next_switch(self, t: float) -> float | None:
        """The first time after t at which it jumps or kinks; infinite: never; ``None``: not known."""


def natural_step(mechanism: Mechanism) -> float:
    """A 32nd of √(2 l/g), with l the length of the mechanism's diagonal at its reference, s."""
    shape = outline(mechanism, mechanism.q_reference)
    points = np.concatenate([shape.segments.reshape(-1, 3), shape.joints, shape.loops])
    length = float(np.linalg.norm(np.ptp(points, axis=0))) if len(points) > 1 else 0.0
    return _PART * float(np.sqrt(2 * (length or 1.0) / _G))
