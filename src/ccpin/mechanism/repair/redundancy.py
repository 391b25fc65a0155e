"""Geometry as it was meant: redundant rows that agree up to the rounding of a file are made to agree exactly.

Lengths and angles written with five or six decimals make a mechanism that is redundantly constrained (a four-bar whose
parallel axes are tilted in space, Bennett's linkage, parallel bars of equal length) one that does not close, or closes
at single poses only. Redundant rows are measurements of one geometry, each with an error: they are recognised within a
tolerance and the geometry is changed once, as little as possible, so that they agree along the whole motion.

**Recognising.** Which rows are redundant within the tolerance is judged by the gap of φ_q′'s singular values, by their
median over poses along the motion (`open_poses`): a singular pose does not hide a rank, and no single pose decides.
Axes parallel within the tolerance are made exactly so first (`relations`); planar loops are then planar by proof.

**Repairing.** Let p be the geometry (frames of joints and closures, `geometry`), N_i an orthonormal
basis of the left null directions of φ_q′ at pose q_i. φ(q_i + δ, p + dp) = 0 has a solution δ to first order exactly
if N_iᵀ(φ_i + φ_p,i dp) = 0. Of all p that do so at all poses the smallest is taken (least squares, minimum norm), the
poses are brought back, and so on: Gauss–Newton on a problem whose residual can vanish, hence quadratic.

**Why it holds.** Let r rows of φ have independent gradients at a pose of the repaired geometry. Their zeros near it are
an analytic manifold of dimension n = n′ − r (implicit function theorem). If the other rows vanish on it, φ = 0 is that
manifold and rank φ_q′ = r along it, so that σ, ρ and certificates stand on one smooth manifold with all rows kept, as
for a geometry that is exact. The other rows are analytic on the manifold: on a connected piece they vanish everywhere
or on a thin subset only (identity theorem), to which poses drawn at random do not belong. So a row that vanishes at
random poses other than those fitted vanishes throughout with probability one, in exact arithmetic; what is computed
is that it is below 1e-13 of the size there. This is evidence, not a certificate; notes tell how many poses it is from.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import LoopNotClosedError
from ccpin.kinematics.clusters import ClusterTree
from ccpin.mechanism.repair.geometry import NO_RELATIONS, Change, Geometry, shape_of
from ccpin.mechanism.repair.open_poses import GAP, SEED, OpenPose, OpenPoses
from ccpin.mechanism.repair.relations import parallel_axes

_LEAST_CUT = 1e-9  # of the conditions' largest singular value: the cut sinks no farther
_PARALLEL = 10.0  # times the tolerance: axes this near to parallel are meant to be
_FEWEST = 3  # poses along the motion, for a fit and for what is held against it
_ROUNDS = 4  # fits, until new poses bear one out
_MOST_STEPS = 30  # of one fit
_MOST_PARAMETERS = 1500  # of a geometry: a larger one is left as it is, as its fits take long


class Repair(NamedTuple):
    """A repaired cluster.

    Attributes:
        change: What was changed.
        part: The cluster as it is now.
        q_free: A closed pose of it.
        note: In words.
    """

    change: Change
    part: ClusterTree
    q_free: Array
    note: str


class Rounded:
    """A cluster whose geometry is known up to a tolerance; all rows count here, also those of planar loops.

    Args:
        part: The cluster.
        tolerance: Relative to its size.
    """

    def __init__(self, part: ClusterTree, tolerance: float) -> None:
        self.shape = shape_of(part)
        self.poses = OpenPoses(self.shape.constraints, tolerance)

    def repaired(self, q_free: Array) -> Repair | None:
        """Make redundant rows agree exactly, from a pose closed within the tolerance; ``None`` where nothing is to do.

        A cluster of more than some 120 joints is left as it is: it closes as it stands or is refused.

        Raises:
            LoopNotClosedError: They do not agree within the tolerance.
        """
        start = self.poses.near(self.shape, q_free)
        if self.poses.is_exact([start], start.rank):
            return None
        if Geometry(self.shape, self.poses.size, NO_RELATIONS).count > _MOST_PARAMETERS:
            return None
        start = self.poses.moving(self.shape, start)
        if self.poses.is_exact([start], start.rank):
            return None
        rank, poses = self.poses.motion(self.shape, start)
        if rank == self.shape.constraints.size or len(poses) < _FEWEST or self.poses.is_exact(poses, rank):
            return None
        change = None
        for relations in (parallel_axes(self.shape, _PARALLEL * self.poses.tolerance), NO_RELATIONS):
            geometry, known = Geometry(self.shape, self.poses.size, relations), poses
            for k in range(_ROUNDS):
                p, known = self._fit(geometry, known, rank)
                shape = geometry.shape(p)
                others = self.poses.walk(shape, known[k], rank, SEED + 1 + k)
                if len(others) >= _FEWEST and max(pose.misfit for pose in others) <= self.poses.exact:
                    change = geometry.change(p)
                    if change.largest(self.poses.size)[1] <= self.allowed(geometry):
                        return Repair(change, shape.part, known[0].q_free, self._note(poses, rank, change, others))
                    break
                known = [*known, *others]
        raise self._refusal(poses, rank, change)

    def allowed(self, geometry: Geometry) -> float:
        """How far one frame may be changed, m: errors of k frames, each within the tolerance, add up to √k of it."""
        return self.poses.open_by * float(np.sqrt(geometry.frames))

    def _fit(self, geometry: Geometry, poses: list[OpenPose], rank: int) -> tuple[Array, list[OpenPose]]:
        """The smallest geometry at which all rows agree at the poses, and the poses there.

        Small singular values of the conditions on p are errors of the geometry themselves as long as it has any: those
        below a cut are left out, and the cut sinks with the misfit.
        """
        p, cut = np.zeros(geometry.count), GAP * self.poses.tolerance
        shape = geometry.shape(p)
        poses = [self.poses.near(shape, pose.q_free, rank) for pose in poses]
        error = max(pose.misfit for pose in poses)
        for _ in range(_MOST_STEPS):
            conditions, rights = [], []
            for pose in poses:
                loose = pose.left[:, rank:].T
                conditions.append(loose @ (self.poses.scale[:, None] * geometry.jacobian(shape, pose.point)))
                rights.append(conditions[-1] @ p - loose @ pose.phi)
            trial = np.linalg.lstsq(np.vstack(conditions), np.concatenate(rights), rcond=cut)[0]
            trial_shape = geometry.shape(trial)
            there = [self.poses.near(trial_shape, pose.q_free, rank) for pose in poses]
            last, now = error, max(pose.misfit for pose in there)
            if now < error:
                p, shape, poses, error = trial, trial_shape, there, now
            if error <= 0.01 * self.poses.exact or (cut <= _LEAST_CUT and now > 0.5 * last):
                break
            cut = max(0.03 * cut, _LEAST_CUT)
        return p, poses

    def _worst(self, poses: list[OpenPose]) -> tuple[str, str]:
        """The loop that is open most, and by how much, in words."""
        open_most = np.max([np.abs(pose.point.phi) for pose in poses], axis=0)
        rows = self.shape.constraints.row_slices()
        worst = max(rows, key=lambda name: float(open_most[rows[name]].max()))
        return worst, self.shape.constraints.misfit(open_most, rows[worst])

    def _note(self, poses: list[OpenPose], rank: int, change: Change, others: list[OpenPose]) -> str:
        loop, misfit = self._worst(poses)
        frame, most = change.largest(self.poses.size)
        checked = max(pose.misfit for pose in others)
        return (
            f"geometry repaired: the file's numbers leave loop '{loop}' open by up to {misfit} along "
            f"the motion; {rank} of the {len(poses[0].phi)} rows of {self._loops()} count and the others agree now. "
            f"The largest change is {most:.1e} m, of {frame} (tolerance {self.poses.open_by:.1e} m, which is "
            f"{self.poses.tolerance:g} of the size or of 1 m); at {len(others)} other poses the loops close to "
            f"{checked:.0e}"
        )

    def _refusal(self, poses: list[OpenPose], rank: int, change: Change | None) -> LoopNotClosedError:
        loop, misfit = self._worst(poses)
        why = "no small change of the geometry makes them agree along the motion"
        if change is not None:
            frame, most = change.largest(self.poses.size)
            why = f"it would take a change of {most:.1e} m ({frame}) to make them agree along the motion"
        errors = {
            name: float(np.linalg.norm(poses[0].point.phi[at]))
            for name, at in self.shape.constraints.row_slices().items()
        }
        return LoopNotClosedError(
            f"{len(poses[0].phi) - rank} of the {len(poses[0].phi)} rows of {self._loops()} are redundant within the "
            f"geometry tolerance ({self.poses.tolerance:g} of the size or of 1 m: {self.poses.open_by:.1e} m), but "
            f"loop '{loop}' stays open by {misfit} and {why}; state lengths and angles with more "
            "decimals, or pass another geometry_tolerance to load (0 takes every number as exact)",
            q_free=poses[0].q_free,
            errors=errors,
        )

    def _loops(self) -> str:
        names = ", ".join(f"'{closure.name}'" for closure in self.shape.part.closures)
        return f"loop {names}" if len(self.shape.part.closures) == 1 else f"loops {names}"
