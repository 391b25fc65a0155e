"""Mobility: how many independent motions the loops leave.

n = n′ − rank φ_q′, the rank taken at several closed configurations, because at a single one it may be
accidentally low (a singular pose) and because redundant rows make φ's size say nothing. All of it is asked of one
cluster of joints at a time (`ccpin.kinematics.clusters`); ranks add up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.constraints import Constraints
from ccpin.mechanism.poses.loop_closing import close

_RANK_TOLERANCE = 1e-7  # of the largest singular value (1 at least): smaller ones are zero
_SAMPLES = 6  # closed configurations nearby, by default: the generic rank is the largest of theirs


class Mobility(NamedTuple):
    """What the constraints leave free.

    Attributes:
        n_free: n′, velocity components of the free system.
        rows: Number of constraint rows kept in φ.
        rank: Generic rank of φ_q′.
        mobility: n = n′ − rank.
        idle: Sentences naming mobilities that move nothing else, e.g. a rod free to spin about its axis.
        notes: How the independent set came about, where the author did not state it exactly.
    """

    n_free: int
    rows: int
    rank: int
    mobility: int
    idle: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


class Tangent(NamedTuple):
    """The velocities φ_q′ allows at a configuration: singular values and right singular vectors of the scaled φ_q′.

    Attributes:
        q_free: q′, of shape (nq,).
        singular: Singular values, largest first.
        directions: Right singular vectors as rows, of shape (n′, n′).
    """

    q_free: Array
    singular: Array
    directions: Array

    @property
    def rank(self) -> int:
        """Numerical rank of φ_q′."""
        return int(np.count_nonzero(self.singular > _RANK_TOLERANCE * max(float(self.singular.max(initial=0.0)), 1.0)))

    def basis(self, rank: int) -> Array:
        """An orthonormal basis of the velocities φ_q′ allows, of shape (n′, n′ − rank)."""
        return self.directions[rank:].T

    def conditioning(self, rank: int) -> float:
        """The smallest singular value that counts towards the rank, relative to the largest."""
        return float(self.singular[rank - 1] / self.singular[0]) if rank else 1.0


def tangent(constraints: Constraints, q_free: Array) -> Tangent:
    """The singular value decomposition of the scaled φ_q′ at a configuration."""
    if not constraints.size:
        return Tangent(q_free, np.zeros(0), np.eye(constraints.model.nv))
    jacobian = scaled_jacobian(constraints, q_free)
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=jacobian.shape[0] < jacobian.shape[1])
    return Tangent(q_free, singular, directions)


def scaled_jacobian(constraints: Constraints, q_free: Array) -> Array:
    """φ_q′ with the rows of points and lengths divided by the cluster's size: dimensionless, tiny rows stay tiny."""
    return np.asarray(constraints.row_scale()[:, None] * constraints.value(q_free).jacobian)


def null_space(constraints: Constraints, q_free: Array, rank: int) -> Array:
    """An orthonormal basis of the velocities φ_q′ allows, of shape (n′, n′ − rank)."""
    return tangent(constraints, q_free).basis(rank)


def sample_closed(
    constraints: Constraints, start: Tangent, count: int = _SAMPLES, stride: float = 0.3
) -> list[Tangent]:
    """Closed configurations near one: deterministic random steps along the allowed velocities, closed again."""
    generator = np.random.default_rng(20002)
    samples, here = [start], start
    for _ in range(3 * count):
        basis = here.basis(here.rank)
        if len(samples) > count or basis.shape[1] == 0:
            break
        direction = basis @ generator.standard_normal(basis.shape[1])
        step = stride * direction / np.linalg.norm(direction)
        attempt = close(constraints, pin.integrate(constraints.model, here.q_free, step))
        if attempt.closed and constraints.aligned(attempt.q_free):
            here = tangent(constraints, attempt.q_free)
            samples.append(here)
    return samples


def generic_rank(constraints: Constraints, start: Tangent) -> tuple[int, list[Tangent]]:
    """The generic rank of φ_q′, and closed configurations that have it: `start` first if it does.

    Where the first samples' ranks differ, more are taken, further away.
    """
    samples = sample_closed(constraints, start)
    if start.rank < max(sample.rank for sample in samples):
        highest = max(samples, key=lambda sample: sample.rank)
        samples += sample_closed(constraints, highest, count=24)[1:]
    rank = max(sample.rank for sample in samples)
    return rank, [sample for sample in samples if sample.rank == rank]
