"""Geometry as it was meant: redundant rows that agree up to the rounding of a file are made to agree exactly.

Lengths and angles written with five or six decimals make a mechanism that is redundantly constrained (a four-bar whose
parallel axes are tilted in space, Bennett's linkage, parallel bars of equal length) one that does not close, or closes
at single poses only. Redundant rows are measurements of one geometry, each with an error: they are recognised within a
tolerance and the geometry is changed once, as little as possible, so that they agree along the whole motion.

**Recognising.** Near a pose closed within the tolerance the singular values s_k of φ_q′ (direction rows as they are,
point rows by the loop's size) split: r of them measure the motion, the others are of the size of the error. With the r
directions U = [u_1 … u_r], Gauss–Newton steps δ = −(Uᵀφ_q′)⁺ Uᵀφ satisfy r equations whatever the others say, and lead
along an (n′ − r)-dimensional motion; the rank is judged by the median of s_k over poses along it, so a singular pose
does not hide it and no single one decides.

**Repairing.** Let p be the geometry (frames of joints and closures, `ccpin.mechanism.geometry`), N_i an orthonormal
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
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.errors import LoopNotClosedError
from ccpin.kinematics.clusters import Part
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.points import moved
from ccpin.mechanism.closing import close
from ccpin.mechanism.geometry import NO_RELATIONS, Change, Geometry, Shape, shape_of
from ccpin.mechanism.relations import parallel_axes

EXACT = 1e-13
_GAP = 30.0
_LEAST_CUT = 1e-9
_PARALLEL = 10.0
_SAMPLES = 12
_FEWEST = 3
_ROUNDS = 4
_MOST_STEPS = 10
_STRIDE = 0.4
_TRIAL = 0.1
_TRIALS = 3
_MOST_FALSE = 50
_MOST_PARAMETERS = 1500
_SEED = 20003


class Near(NamedTuple):
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


class Repair(NamedTuple):
    """A repaired cluster.

    Attributes:
        change: What was changed.
        part: The cluster as it is now.
        q_free: A closed pose of it.
        note: In words.
    """

    change: Change
    part: Part
    q_free: Array
    note: str


class Rounded:
    """A cluster whose geometry is known up to a tolerance; all rows count here, also those of planar loops.

    Args:
        part: The cluster.
        tolerance: Relative to its size.
    """

    def __init__(self, part: Part, tolerance: float) -> None:
        self.shape = shape_of(part)
        constraints = self.shape.constraints
        self.size = constraints.extent
        self.tolerance, self.open_by = tolerance, open_by(constraints, tolerance)
        self._exact = EXACT * max(self.size, 1.0)
        self._scale = constraints.row_scale()

    def repaired(self, q_free: Array) -> Repair | None:
        """Make redundant rows agree exactly, from a pose closed within the tolerance; ``None`` where nothing is to do.

        A cluster of more than some 120 joints is left as it is: it closes as it stands or is refused.

        Raises:
            LoopNotClosedError: They do not agree within the tolerance.
        """
        start = self._near(self.shape, q_free)
        if self._is_exact([start], start.rank):
            return None
        if Geometry(self.shape, self.size, NO_RELATIONS).count > _MOST_PARAMETERS:
            return None
        start = self._moving(start)
        if self._is_exact([start], start.rank):
            return None
        rank, poses = self._motion(start)
        if rank == self.shape.constraints.size or len(poses) < _FEWEST or self._is_exact(poses, rank):
            return None
        change = None
        for relations in (parallel_axes(self.shape, _PARALLEL * self.tolerance), NO_RELATIONS):
            geometry, known = Geometry(self.shape, self.size, relations), poses
            for k in range(_ROUNDS):
                p, known = self._fit(geometry, known, rank)
                shape = geometry.shape(p)
                others = self._walk(shape, known[k], rank, _SEED + 1 + k)
                if len(others) >= _FEWEST and max(pose.misfit for pose in others) <= self._exact:
                    change = geometry.change(p)
                    if change.largest(self.size)[1] <= self.open_by:
                        return Repair(change, shape.part, known[0].q_free, self._note(poses, rank, change, others))
                    break
                known = [*known, *others]
        raise self._refusal(poses, rank, change)

    def _near(self, shape: Shape, q_free: Array, rank: int | None = None) -> Near:
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

    def _at(self, shape: Shape, q_free: Array, rank: int | None) -> Near:
        point = shape.constraints.value(q_free)
        left, singular, right = np.linalg.svd(self._scale[:, None] * point.jacobian, full_matrices=True)
        r = self._rank(singular) if rank is None else rank
        return Near(q_free, point, self._scale * point.phi, r, left, singular, right)

    def _moving(self, start: Near) -> Near:
        """The pose with the least rank whose directions left over are motions.

        A small singular value near a singular pose belongs to no motion: a finite step along it opens the loops by
        its square, where one along a redundant row opens them by errors of the geometry only.
        """
        generator, model = np.random.default_rng(_SEED), self.shape.constraints.model
        for rank in range(start.rank, min(len(start.singular), start.rank + _MOST_FALSE) + 1):
            here = start if rank == start.rank else self._near(self.shape, start.q_free, rank)
            free, opened = here.right[rank:], 0.0
            for _ in range(_TRIALS if len(free) else 0):
                step = free.T @ generator.standard_normal(len(free))
                away = pin.integrate(model, here.q_free, _TRIAL * step / np.linalg.norm(step))
                opened = max(opened, self._near(self.shape, away, rank).misfit)
            if opened <= 10.0 * self.open_by:
                return here
        return start

    def _rank(self, singular: Array) -> int:
        """How many singular values are above what an error of the geometry makes of zero."""
        return int(np.count_nonzero(singular > _GAP * self.tolerance * max(float(singular.max(initial=0.0)), 1e-12)))

    def _is_exact(self, poses: list[Near], rank: int) -> bool:
        """Whether the rows agree, and those that are redundant are so, up to rounding in the arithmetic."""
        return all(
            pose.misfit <= self._exact and np.all(pose.singular[rank:] <= EXACT * pose.singular[0]) for pose in poses
        )

    def _motion(self, start: Near) -> tuple[int, list[Near]]:
        """The rank that the median of the singular values along the motion tells, and poses along it."""
        rank = start.rank
        poses = [start, *self._walk(self.shape, start, rank, _SEED)]
        typical = self._rank(np.median([pose.singular / pose.singular[0] for pose in poses], axis=0))
        if typical != rank:
            begin = next((pose for pose in poses if self._rank(pose.singular) == typical), start)
            begin = self._near(self.shape, begin.q_free, typical)
            poses = [begin, *self._walk(self.shape, begin, typical, _SEED)]
        return typical, poses

    def _walk(self, shape: Shape, start: Near, rank: int, seed: int) -> list[Near]:
        """Poses along the motion, closed within the tolerance: one random way from the start, then the opposite way."""
        generator, found, constraints = np.random.default_rng(seed), list[Near](), shape.constraints
        first = start.right[rank:].T @ generator.standard_normal(len(start.right) - rank)
        for heading in (first, -first):
            here = start
            for _ in range(_SAMPLES // 2):
                free = here.right[rank:]
                heading = free.T @ (free @ heading + 0.5 * generator.standard_normal(len(free)))
                heading = heading / max(float(np.linalg.norm(heading)), 1e-300)
                step = generator.uniform(0.5, 1.5) * _STRIDE * heading
                away = pin.integrate(constraints.model, here.q_free, step)
                there = self._near(shape, close(constraints, away, self.open_by).q_free, rank)
                if there.misfit <= 10.0 * self.open_by and constraints.aligned(there.q_free):
                    here = there
                    found.append(here)
        return found

    def _fit(self, geometry: Geometry, poses: list[Near], rank: int) -> tuple[Array, list[Near]]:
        """The smallest geometry at which all rows agree at the poses, and the poses there.

        Small singular values of the conditions on p are errors of the geometry themselves as long as it has any: those
        below a cut are left out, and the cut sinks with the misfit.
        """
        p, cut = np.zeros(geometry.count), _GAP * self.tolerance
        shape = geometry.shape(p)
        poses = [self._near(shape, pose.q_free, rank) for pose in poses]
        error = max(pose.misfit for pose in poses)
        for _ in range(_MOST_STEPS):
            conditions, rights = [], []
            for pose in poses:
                loose = pose.left[:, rank:].T
                conditions.append(loose @ (self._scale[:, None] * geometry.jacobian(shape, pose.point)))
                rights.append(conditions[-1] @ p - loose @ pose.phi)
            trial = np.linalg.lstsq(np.vstack(conditions), np.concatenate(rights), rcond=cut)[0]
            trial_shape = geometry.shape(trial)
            there = [self._near(trial_shape, pose.q_free, rank) for pose in poses]
            now = max(pose.misfit for pose in there)
            if now < error:
                p, shape, poses, error = trial, trial_shape, there, now
            if error <= 0.01 * self._exact or cut <= _LEAST_CUT:
                break
            cut = max(0.03 * cut, _LEAST_CUT)
        return p, poses

    def _worst(self, poses: list[Near]) -> tuple[str, float]:
        """The loop that is open most, and by how much, m or rad."""
        open_most = np.max([np.abs(pose.point.phi) for pose in poses], axis=0)
        errors = {name: float(open_most[at].max()) for name, at in self.shape.constraints.row_slices().items()}
        return max(errors.items(), key=lambda item: item[1])

    def _note(self, poses: list[Near], rank: int, change: Change, others: list[Near]) -> str:
        loop, misfit = self._worst(poses)
        frame, most = change.largest(self.size)
        checked = max(pose.misfit for pose in others)
        return (
            f"geometry repaired: the file's numbers leave loop '{loop}' open by up to {misfit:.1e} (m or rad) along "
            f"the motion; {rank} of the {len(poses[0].phi)} rows of {self._loops()} count and the others agree now. "
            f"The largest change is {most:.1e} m, of {frame} (tolerance {self.open_by:.1e} m, which is "
            f"{self.tolerance:g} of the size or of 1 m); at {len(others)} other poses the loops close to {checked:.0e}"
        )

    def _refusal(self, poses: list[Near], rank: int, change: Change | None) -> LoopNotClosedError:
        loop, misfit = self._worst(poses)
        why = "no small change of the geometry makes them agree along the motion"
        if change is not None:
            frame, most = change.largest(self.size)
            why = f"it would take a change of {most:.1e} m ({frame}) to make them agree along the motion"
        errors = {
            name: float(np.linalg.norm(poses[0].point.phi[at]))
            for name, at in self.shape.constraints.row_slices().items()
        }
        return LoopNotClosedError(
            f"{len(poses[0].phi) - rank} of the {len(poses[0].phi)} rows of {self._loops()} are redundant within the "
            f"geometry tolerance ({self.tolerance:g} of the size or of 1 m: {self.open_by:.1e} m), but loop '{loop}' "
            f"stays open by {misfit:.1e} (m or rad) and {why}; state lengths and angles with more decimals, or pass "
            "another geometry_tolerance to load (0 takes every number as exact)",
            q_free=poses[0].q_free,
            errors=errors,
        )

    def _loops(self) -> str:
        names = ", ".join(f"'{closure.name}'" for closure in self.shape.part.closures)
        return f"loop {names}" if len(self.shape.part.closures) == 1 else f"loops {names}"


def open_by(constraints: Constraints, tolerance: float) -> float:
    """How far loops may be open, and frames changed, at a tolerance relative to the cluster's size (1 m at least)."""
    return tolerance * max(constraints.extent, 1.0)
