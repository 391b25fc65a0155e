"""How φ changes with the geometry: origins of joints and ends of closures moved along axes of the links they are on.

A row's rate is the power of its wrenches on the bodies' velocities, φ̇_i = f_A·V_A + f_B·V_B (`ccpin.kinematics.rows`).
An origin that moves by δ along a unit vector d of its link moves what it carries as a velocity d without a turn would,
so that ∂φ_i/∂δ is the sum of f·d over the ends that are carried. The frame of a closure carries its own end, a joint
the ends whose path to the common ancestor it is on; an end before the ancestor moves with the axes that rows are
measured in, and nothing changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.tree import Tree


class Origin(NamedTuple):
    """A coordinate of an origin on a link.

    Attributes:
        link: The link in whose frame it is stated.
        axis: Which coordinate.
        carried: The ends (loop's number, ``"A"`` or ``"B"``) that move with it.
    """

    link: str
    axis: int
    carried: tuple[tuple[int, str], ...]


class OriginSlopes:
    """∂φ/∂(coordinates of origins).

    Args:
        tree: The free system.
        constraints: φ.
        origins: The coordinates.
    """

    def __init__(self, tree: Tree, constraints: Constraints, origins: Sequence[Origin]) -> None:
        self._model, self._constraints = tree.model, constraints
        rows = np.repeat(np.arange(len(constraints.loops)), [loop.size for loop in constraints.loops])
        places = [tree.attachments[origin.link] for origin in origins]
        self._joints = [place.joint for place in places]
        axes = [place.placement[:3, origin.axis] for place, origin in zip(places, origins, strict=True)]
        self._axes = np.array(axes).reshape(-1, 3)
        masks = [[[(int(loop), end) in origin.carried for loop in rows] for end in "AB"] for origin in origins]
        self._masks = np.array(masks, dtype=np.float64).reshape(len(origins), 2, len(rows))

    def at(self, point: ConstraintValue) -> Array:
        """At a configuration, of shape (m, number of coordinates)."""
        with self._constraints.scratch.lent() as data:
            pin.forwardKinematics(self._model, data, point.q_free)
            turns = np.array([data.oMi[joint].rotation for joint in self._joints]).reshape(-1, 3, 3)
        along = np.einsum("kij,kj->ki", turns, self._axes)
        forces = point.placed.wrenches[:, :3].reshape(2, -1, 3)
        slopes = np.zeros((self._constraints.size, len(along)))
        slopes[: forces.shape[1]] = np.einsum("keR,eRi,ki->Rk", self._masks, forces, along)
        return slopes
