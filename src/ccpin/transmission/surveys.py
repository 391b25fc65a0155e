"""A transmission over the range of its joints: postures on a grid, and what they have in common."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, instance, vector, whole
from ccpin.errors import InvalidInputError, SingularConfigurationError, UnreachableError
from ccpin.transmission.posture import Posture
from ccpin.transmission.transmission import Transmission

_UNSTATED = 0.5  # rad or m about the reference, of a joint that states no limits, or more than half a turn
_LEAST = 1e-6  # reciprocal condition number of J: motors below hold nothing


class Survey(NamedTuple):
    """Postures on a grid over joints' ranges.

    Attributes:
        transmission: Of what.
        lower, upper: The ranges, of shape (n,).
        postures: Those reached from the reference, at which the motors hold the joints.
        missed: How many points of the grid were not.
    """

    transmission: Transmission
    lower: Array
    upper: Array
    postures: tuple[Posture, ...]
    missed: int

    @property
    def rotor_inertias(self) -> Array:
        """`Posture.rotor_inertia` of each, of shape (N, n, n)."""
        return np.array([posture.rotor_inertia for posture in self.postures])

    @property
    def axis_ratios(self) -> Array:
        """`Posture.axis_ratios` of each, of shape (N, n)."""
        return np.array([posture.axis_ratios for posture in self.postures])

    @property
    def rcond(self) -> float:
        """The least 1/κ(J)."""
        return min(posture.rcond for posture in self.postures)


def survey(
    transmission: Transmission, lower: ArrayLike | None = None, upper: ArrayLike | None = None, *, count: int = 9
) -> Survey:
    """Postures on a grid over joints' ranges, each reached from its neighbour: samples, between which nothing is said.

    Args:
        transmission: The transmission.
        lower: Of each joint, rad or m, of shape (n,); default the limits that the file states, else (or if they
            are more than π/2 away) 0.5 below the reference.
        upper: Likewise.
        count: Points along each joint.

    Raises:
        InvalidInputError: A lower end above its upper one.
    """
    instance(transmission, "transmission", Transmission)
    model, side, n = transmission.joint_model, transmission.joint_side, transmission.n
    home = transmission.reference
    ends = []
    given_ends = zip((lower, upper), ("lower", "upper"), model.mechanism.position_limits, (-1, 1), strict=True)
    for given, name, stated, sign in given_ends:
        limits = np.array([stated[part.q_free][0] if part.kind.nq == 1 else np.nan for part in side.coordinates.parts])
        wide = ~np.isfinite(limits) | (np.abs(limits - home.q_joint) > np.pi / 2)
        limits = np.where(wide, home.q_joint + sign * _UNSTATED, limits)
        ends.append(limits if given is None else vector(given, name, n))
    if not (ends[0] <= ends[1]).all():
        raise InvalidInputError(f"lower = {ends[0]} must not be above upper = {ends[1]}")
    axes = [np.linspace(low, high, whole(count, "count")) for low, high in zip(*ends, strict=True)]
    nearest = sorted(product(*axes), key=lambda q: float(np.linalg.norm(np.array(q) - home.q_joint)))
    reached, missed = [home], 0
    for q in nearest:
        near = min(reached, key=lambda posture: float(np.linalg.norm(posture.q_joint - q)))
        try:
            posture = transmission.at(q, near)
        except (UnreachableError, SingularConfigurationError):
            missed += 1
            continue
        if posture.rcond < _LEAST:
            missed += 1
            continue
        reached.append(posture)
    return Survey(transmission, ends[0], ends[1], tuple(reached[1:] or reached), missed)
