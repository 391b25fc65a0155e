"""Distance closures in joint space: each as the rod it stands for.

A closure that keeps |p_B − p_A| = L is quadratic in its chain. Bounds are for rows linear in chain tips, so a rod is
put in: an end point p_A + L d(a, b) carried by frame A, d a unit vector turned by one angle a about the normal of a
planar loop, or by two (a universal joint) of a spatial one, and the rows p_B − p_A − L d = 0 in the ancestor's axes in
place of

    φ_k = (|p_B − p_A|² − L²) / 2L = 0.

**Lemma.** Where cos b ≠ 0 (always, in the plane), (θ, a, b) ↦ θ is a diffeomorphism near every solution from the
solutions of the rows with rods onto those of the rows without, and φ_y is nonsingular at one exactly where it is at
the other.

*Proof.* With rods p_B − p_A = L d, whose length is L. Conversely (p_B − p_A)/L is a unit vector, and d is a local
diffeomorphism onto the sphere where cos b ≠ 0. Let r = p_B − p_A − L d be the rod's rows and t, t′ span the plane
perpendicular to d. At a solution dᵀr_θ = dᵀ(p_B − p_A)_θ = φ_kθ (as frame A turns, d moves perpendicular to itself),
dᵀr_ab = 0, and (t, t′)ᵀr_ab = −L (t, t′)ᵀd_ab is nonsingular with determinant ±L² cos b (±L in the plane). So the
matrix with rods is, up to a rotation of rows, block triangular with φ_y and that one on its diagonal. ∎

So Theorem N for the rows with rods says of the mechanism what it says of any other: σ exists, is unique in its tube,
smooth and nonsingular. Near cos b = 0 nothing is proved, as near 90° of a ball joint's chart; b is measured from where
the rod is at the chart's centre.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.closure_kinds import Gap, X, Y, Z
from ccpin.domain.closures.scalar_coordinates import Elementary
from ccpin.kinematics.loops import ResolvedClosure

_IN_PLANE = 1e-12  # of a rod's length: out of the plane by less is what rounding leaves of a planar one


class Rod(NamedTuple):
    """One rod.

    Attributes:
        place: Its one or two angles in θ.
        length: L in metres.
        reference: The axes of the rod's joint in frame A, as columns, of shape (3, 3): the rod lies along x (planar,
            turning about z) or along z (spatial, turning about x, then y) where its angles are zero.
        path_a, path_b: The joints from C to frame A and to frame B.
        frame_a, frame_b: The frames in their carriers, 4×4.
    """

    place: slice
    length: float
    reference: Array
    path_a: tuple[Elementary, ...]
    path_b: tuple[Elementary, ...]
    frame_a: Array
    frame_b: Array

    @property
    def planar(self) -> bool:
        """Whether one angle is enough."""
        return bool(self.place.stop - self.place.start == 1)

    @property
    def tip(self) -> Array:
        """Its end in its own axes."""
        return self.length * (X if self.planar else Z)

    def steps(self) -> list[Elementary]:
        """Its joint behind frame A, as elementary steps."""
        start, at_a = self.place.start, np.eye(4)
        at_a[:3, :3] = self.reference
        first = self.frame_a @ at_a
        if self.planar:
            return [Elementary(first, Z, False, start)]
        return [Elementary(first, X, False, start), Elementary(np.eye(4), Y, False, start + 1)]

    def angles(self, theta: Array) -> Array:
        """The rod's angles where the joints are at θ (n′,): where it points from A to B, of shape (1,) or (2,)."""
        x, y, z = self.reference.T @ gap_seen_from_a(self, theta) / self.length
        if self.planar:
            return np.array([np.arctan2(y, x)])
        return np.array([np.arctan2(-y, z), np.arctan2(x, np.hypot(y, z))])


def rod_length(loop: ResolvedClosure) -> float | None:
    """L where a closure's one row is (|p_B − p_A|² − L²)/2L, else ``None``."""
    if loop.size != 1 or len(loop.rows.rows[0]) != 2:
        return None
    (_, left, right), (_, rod, again) = loop.rows.rows[0]
    if not (isinstance(left, Gap) and isinstance(right, Gap)) or isinstance(rod, Gap) or rod is not again:
        return None
    return float(np.linalg.norm(rod.local))


def rod_of(
    loop: ResolvedClosure,
    length: float,
    paths: tuple[Sequence[Elementary], Sequence[Elementary]],
    theta: Array,
    start: int,
) -> Rod:
    """The rod of a distance closure, its angles zero where the joints are at θ (n′,) and from `start` on in θ.

    `paths` lead from C to frame A and to frame B.
    """
    path_a, path_b = paths
    whole = Rod(slice(start, start + 2), length, np.eye(3), tuple(path_a), tuple(path_b), loop.frame_a, loop.frame_b)
    gap = gap_seen_from_a(whole, theta)
    normal = (
        None if loop.normal is None else carried(path_a, loop.frame_a, np.zeros_like(theta))[:3, :3].T @ loop.normal
    )
    if normal is not None and abs(normal @ gap) <= _IN_PLANE * length:
        along = gap - (normal @ gap) * normal
        along /= np.linalg.norm(along)
        return whole._replace(
            place=slice(start, start + 1), reference=np.column_stack([along, np.cross(normal, along), normal])
        )
    return whole._replace(reference=_basis_with_z(gap / np.linalg.norm(gap)))


def _basis_with_z(direction: Array) -> Array:
    """A rotation whose last column is a unit vector."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    x = np.cross(other, direction)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(direction, x), direction])


def gap_seen_from_a(rod: Rod, theta: Array) -> Array:
    """The vector p_B − p_A in the axes of frame A, of shape (3,)."""
    pose_a, pose_b = carried(rod.path_a, rod.frame_a, theta), carried(rod.path_b, rod.frame_b, theta)
    return np.asarray(pose_a[:3, :3].T @ (pose_b[:3, 3] - pose_a[:3, 3]))


def carried(path: Sequence[Elementary], frame: Array, theta: Array) -> Array:
    """The pose of a frame behind elementary joints at θ (n′,), seen from before the first, 4×4."""
    pose = np.eye(4)
    for step in path:
        pose = pose @ step.placement @ _moved(step, float(theta[step.position]))
    return np.asarray(pose @ frame)


def _moved(step: Elementary, by: float) -> Array:
    motion = np.eye(4)
    if step.prismatic:
        motion[:3, 3] = by * step.axis
    else:
        x, y, z = step.axis
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        motion[:3, :3] += np.sin(by) * cross + 2.0 * np.sin(0.5 * by) ** 2 * (cross @ cross)
    return motion
