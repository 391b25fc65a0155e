"""Poses of a cluster whose rows agree within a tolerance only: satisfied in the directions that count.

Near a pose closed within the tolerance the singular values s_k of φ_q′ (rows of points divided by the cluster's size)
split: r of them measure the motion, the others are of the size of the error. With U the left singular vectors of the
r largest, Gauss–Newton steps on Uᵀφ satisfy r equations whatever the others say and lead along an (n′ − r)-dimensional
motion.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.errors import LoopNotClosedError
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.points import moved
from ccpin.mechanism.poses.loop_closing import close
from ccpin.mechanism.repair.geometry import ClusterGeometry

EXACT = 1e-13  # of the size (1 at least) and of the largest singular value: rounding in the arithmetic
GAP = 30.0  # times the tolerance: singular values below, of the largest, may be zero but for errors of the geometry
SEED = 20003  # any: the same ways each time
_SAMPLES = 12  # poses along the motion, half of them each way
_MOST_STEPS = 10  # of Newton's method, which ends where steps stop halving
_STRIDE = 0.4  # rad and m: of a step along the motion, on the average
_TRIAL = 0.1  # rad and m: of a step that tells a motion from a redundant row
_TRIALS = 3  # such steps, in random directions
_MOST_FALSE = 50  # directions that may turn out to be no motions


class OpenPose(NamedTuple):
    """A pose that satisfies the directions of φ that count, and what the others say there.

    Attributes:
        q_free: q′.
        point: φ and φ_q′.
        phi: φ with the rows of points divided by the size.
        rank: r, how many directions that is.
        left, singular, right: The singular value decomposition of φ_q′ scaled likewise: left singular vectors as
            columns (m, m), singular values, right singular vectors as rows (n′, n′).
    """

    q_free: Array
    point: ConstraintValue
    phi: Array
    rank: int
    left: Array
    singular: Array
    right: Array

    @property
    def misfit(self) -> float:
        """The largest entry of φ, m or rad."""
        return float(np.abs(self.point.phi).max(initial=0.0))


class OpenPoses:
    """Finds poses of a cluster, with its own geometry or a changed one.

    Attributes:
        tolerance: Of the geometry, relative to the size.
        size: The cluster's, m.
        open_by: How far loops may be open, m or rad, and frames changed, m.
        exact: Below this an entry of φ is rounding in the arithmetic.
        scale: What makes each row dimensionless, of shape (m,).

    Args:
        constraints: All rows of the cluster.
        tolerance: As above.
    """

    def __init__(self, constraints: Constraints, tolerance: float) -> None:
        self.tolerance, self.size, self.open_by = tolerance, constraints.extent, open_by(constraints, tolerance)
        self.exact = EXACT * max(self.size, 1.0)
        self.scale = constraints.row_scale()

    def near(self, shape: ClusterGeometry, q_free: Array, rank: int | None = None) -> OpenPose:
        """Satisfy the r directions that count, from a pose nearly closed; r is judged at each step if not given."""
        here, last = self._at(shape, q_free, rank), np.inf
        for _ in range(_MOST_STEPS):
            r = here.rank
            step = -here.right[:r].T @ ((here.left[:, :r].T @ here.phi) / here.singular[:r])
            length = float(np.linalg.norm(step))
            if length >= 0.5 * last or length > 1.0:
                break
            here, last = self._at(shape, moved(shape.constraints.model, here.q_free, step), rank), length
        return here

    def _at(self, shape: ClusterGeometry, q_free: Array, rank: int | None) -> OpenPose:
        point = shape.constraints.value(q_free)
        try:
            left, singular, right = np.linalg.svd(self.scale[:, None] * point.jacobian, full_matrices=True)
        except np.linalg.LinAlgError:
            message = "the rows of the loops are no numbers, or too large, at a pose that was tried"
            raise LoopNotClosedError(message, q_free=q_free, errors={}) from None
        r = self.rank(singular) if rank is None else rank
        return OpenPose(q_free, point, self.scale * point.phi, r, left, singular, right)

    def rank(self, singular: Array) -> int:
        """How many singular values are above what an error of the geometry makes of zero."""
        return int(np.count_nonzero(singular > GAP * self.tolerance * max(float(singular.max(initial=0.0)), 1e-12)))

    def is_exact(self, poses: list[OpenPose], rank: int) -> bool:
        """Whether the rows agree, and those that are redundant are so, up to rounding in the arithmetic."""
        return all(
            pose.misfit <= self.exact and np.all(pose.singular[rank:] <= EXACT * pose.singular[0]) for pose in poses
        )

    def moving(self, shape: ClusterGeometry, start: OpenPose) -> OpenPose:
        """The pose with the least rank whose directions left over are motions.

        A small singular value near a singular pose belongs to no motion: a finite step along it opens the loops by
        its square, where one along a redundant row opens them by errors of the geometry only.
        """
        generator, model = np.random.default_rng(SEED), shape.constraints.model
        for rank in range(start.rank, min(len(start.singular), start.rank + _MOST_FALSE) + 1):
            here = start if rank == start.rank else self.near(shape, start.q_free, rank)
            free, opened = here.right[rank:], 0.0
            for _ in range(_TRIALS if len(free) else 0):
                step = free.T @ generator.standard_normal(len(free))
                away = pin.integrate(model, here.q_free, _TRIAL * step / np.linalg.norm(step))
                opened = max(opened, self.near(shape, away, rank).misfit)
            if opened <= 10.0 * self.open_by:
                return here
        return start

    def motion(self, shape: ClusterGeometry, start: OpenPose) -> tuple[int, list[OpenPose]]:
        """The rank that the median of the singular values along the motion tells, and poses along it."""
        rank = start.rank
        poses = [start, *self.walk(shape, start, rank, SEED)]
        typical = self.rank(np.median([pose.singular / pose.singular[0] for pose in poses], axis=0))
        if typical != rank:
            begin = next((pose for pose in poses if self.rank(pose.singular) == typical), start)
            begin = self.near(shape, begin.q_free, typical)
            poses = [begin, *self.walk(shape, begin, typical, SEED)]
        return typical, poses

    def walk(self, shape: ClusterGeometry, start: OpenPose, rank: int, seed: int) -> list[OpenPose]:
        """Poses along the motion, closed within the tolerance: one random way from the start, then the opposite way."""
        generator, found, constraints = np.random.default_rng(seed), list[OpenPose](), shape.constraints
        first = start.right[rank:].T @ generator.standard_normal(len(start.right) - rank)
        for heading in (first, -first):
            here = start
            for _ in range(_SAMPLES // 2):
                free = here.right[rank:]
                heading = free.T @ (free @ heading + 0.5 * generator.standard_normal(len(free)))
                heading = heading / max(float(np.linalg.norm(heading)), 1e-300)
                step = generator.uniform(0.5, 1.5) * _STRIDE * heading
                away = pin.integrate(constraints.model, here.q_free, step)
                there = self.near(shape, close(constraints, away, self.open_by).q_free, rank)
                if there.misfit <= 10.0 * self.open_by and constraints.aligned(there.q_free):
                    here = there
                    found.append(here)
        return found


def open_by(constraints: Constraints, tolerance: float) -> float:
    """How far loops may be open, and frames changed, at a tolerance relative to the cluster's size (1 m at least)."""
    return tolerance * max(constraints.extent, 1.0)
