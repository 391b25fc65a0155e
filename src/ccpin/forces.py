"""The forces inside: what a loop's closure carries along a motion, in newtons and newton metres.

λ of the descriptor form (17), D′q̈′ + C′q̇′ + g′ = Sᵀu + φ_q′ᵀλ, has one entry a row of φ, in that row's own axes and
units. Here it is put together into the wrench that the closure exerts on its end A: a force and a moment about the
closure point of A, in world axes. End B receives the opposite wrench about the same point.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.constraints import Constraints
from ccpin.errors import InvalidInputError
from ccpin.kinematics import joint_poses
from ccpin.loops import Loop
from ccpin.reduced_model import ReducedModel
from ccpin.trajectory import Trajectory

Array = NDArray[np.float64]
_NULL = 1e-9
_SEEN = 1e-7


class PeakForce(NamedTuple):
    """What the bearing of one closure has to carry, the largest of all samples.

    Attributes:
        closure: The closure's name.
        force: Largest |force|, N. force_time: when, s.
        radial, axial: Largest force across and along the closure's z axis (a revolute closure's pin), N.
        moment: Largest |moment|, N m. moment_time: when, s.
        undetermined: What rigid bodies leave undetermined, in a sentence; empty where all is determined.
    """

    closure: str
    force: float
    force_time: float
    radial: float
    axial: float
    moment: float
    moment_time: float
    undetermined: str


class ClosureForce(NamedTuple):
    """The wrench a closure exerts on its end A along a motion; world axes.

    The equations of rigid bodies do not fix a component along which the loops constrain the motion more than once
    (out of the plane of a planar loop; throughout an overconstrained linkage). Such components are zero where
    planarity took their rows out of φ and of least norm otherwise; the true ones depend on clearances and elasticity.

    Attributes:
        closure: The closure's name.
        t: Times, s, of shape (T,).
        point: The closure point of A, m, of shape (T, 3).
        axis: The z axis of A's closure frame, of shape (T, 3).
        force: Force on A, N, of shape (T, 3).
        moment: Moment on A about the point, N m, of shape (T, 3).
        determined: Whether each component of (force, moment) is fixed by the equations, of shape (T, 6).
    """

    closure: str
    t: Array
    point: Array
    axis: Array
    force: Array
    moment: Array
    determined: NDArray[np.bool_]

    def peak(self) -> PeakForce:
        """The largest loads of the motion, for choosing the bearing."""
        size, turning = np.linalg.norm(self.force, axis=1), np.linalg.norm(self.moment, axis=1)
        axial = np.einsum("ti,ti->t", self.force, self.axis)
        radial = np.linalg.norm(self.force - axial[:, None] * self.axis, axis=1)
        names = ("force x", "force y", "force z", "moment x", "moment y", "moment z")
        free = [name for k, name in enumerate(names) if not self.determined[:, k].all()]
        return PeakForce(
            closure=self.closure,
            force=float(size.max()),
            force_time=float(self.t[size.argmax()]),
            radial=float(radial.max()),
            axial=float(np.abs(axial).max()),
            moment=float(turning.max()),
            moment_time=float(self.t[turning.argmax()]),
            undetermined=f"rigid bodies do not determine {', '.join(free)} (world axes)" if free else "",
        )


def closure_forces(model: ReducedModel, trajectory: Trajectory) -> tuple[ClosureForce, ...]:
    """The wrench each closure exerts on its end A at every sample of a motion, closure by closure.

    Args:
        model: The reduced model.
        trajectory: A motion of it, from `simulate`, for instance.

    Raises:
        InvalidInputError: The trajectory is not this model's.
    """
    if trajectory.q_free.shape[1:] != (model.mechanism.nq,) or trajectory.u.shape[1:] != (model.n_actuated,):
        raise InvalidInputError(
            f"the trajectory has configurations of {trajectory.q_free.shape[1:]} entries and {trajectory.u.shape[1:]} "
            f"efforts; this model has {model.mechanism.nq} and {model.n_actuated}"
        )
    wrenches = _Wrenches(model)
    samples = zip(trajectory.q, trajectory.v, trajectory.u, trajectory.q_free, strict=True)
    return wrenches.history(trajectory.t.copy(), [wrenches.at(*sample) for sample in samples])


def closure_wrench(
    model: ReducedModel, q: ArrayLike, v: ArrayLike, u: ArrayLike, guess: ArrayLike | None = None
) -> tuple[ClosureForce, ...]:
    """The closures' wrenches at one state; every field has a leading axis of length one, and t = 0."""
    q_free = model.sigma(q, guess)
    velocity, effort = model.checked(v, "v", model.n), model.checked(u, "u", model.n_actuated)
    wrenches = _Wrenches(model)
    return wrenches.history(np.zeros(1), [wrenches.at(model.checked_q(q), velocity, effort, q_free)])


class _Sample(NamedTuple):
    """`ClosureForce`'s fields at one sample."""

    point: Array
    axis: Array
    force: Array
    moment: Array
    determined: NDArray[np.bool_]


class _Wrenches:
    """λ as wrenches, with the scratch memory that takes."""

    def __init__(self, model: ReducedModel) -> None:
        mechanism = model.mechanism
        self.model = model
        self.loops = model.parametrization.constraints.loops
        self.slices = model.parametrization.constraints.row_slices()
        self.complete = Constraints(mechanism.tree, mechanism.closures, mechanism.couplings, reduce_planar=False)
        self.complete_slices = self.complete.row_slices()
        self.data = mechanism.pin_model.createData()

    def at(self, q: Array, v: Array, u: Array, q_free: Array) -> list[_Sample]:
        """The wrenches at one state, closure by closure."""
        multipliers = self.model.constraint_forces(q, v, u, q_free)
        poses = joint_poses(self.model.mechanism.pin_model, self.data, q_free)
        loose = _left_null_space(self.complete.value(q_free).jacobian)
        samples = []
        for loop, whole in zip(self.loops, self.complete.loops, strict=True):
            wrench = wrench_map(loop, poses) @ multipliers[self.slices[loop.closure.name]]
            freedom = wrench_map(whole, poses) @ loose[self.complete_slices[loop.closure.name]]
            frame = poses[loop.joint_a] @ loop.frame_a
            determined = np.asarray(np.abs(freedom).max(axis=1, initial=0.0) < _SEEN)
            samples.append(_Sample(frame[:3, 3], frame[:3, 2], wrench[:3], wrench[3:], determined))
        return samples

    def history(self, t: Array, samples: list[list[_Sample]]) -> tuple[ClosureForce, ...]:
        """Samples of all closures as one history a closure."""
        return tuple(
            ClosureForce(
                loop.closure.name,
                t,
                point=np.array([sample[k].point for sample in samples]),
                axis=np.array([sample[k].axis for sample in samples]),
                force=np.array([sample[k].force for sample in samples]),
                moment=np.array([sample[k].moment for sample in samples]),
                determined=np.array([sample[k].determined for sample in samples]),
            )
            for k, loop in enumerate(self.loops)
        )


def wrench_map(loop: Loop, poses: Array) -> Array:
    """W with (force, moment) on end A = W λ, λ being the loop's rows of λ; world axes, about A's closure point.

    The columns follow from the rows' rates (see `ccpin.closures`) by equal power: a point row e pushes A along e; a
    direction row Σ w (a·b) turns A about Σ w a × b; an offset row a pushes A along −a at B's closure point; a
    distance row pushes A along −(p_B − p_A)/L.

    Args:
        loop: The loop.
        poses: World poses of the joint frames, of shape (joints, 4, 4).

    Returns:
        Array: Of shape (6, loop.size).
    """
    frame_a, frame_b = poses[loop.joint_a] @ loop.frame_a, poses[loop.joint_b] @ loop.frame_b
    gap = frame_b[:3, 3] - frame_a[:3, 3]
    turn_a, turn_b = frame_a[:3, :3], frame_b[:3, :3]
    axes = poses[loop.ancestor][:3, :3] @ loop.basis.T
    columns = [np.concatenate([axis, np.zeros(3)]) for axis in axes.T]
    for row in loop.rows.directions:
        normal = sum((w * np.cross(turn_a @ a, turn_b @ b) for w, a, b in row.products), np.zeros(3))
        columns.append(np.concatenate([np.zeros(3), normal]))
    for a in loop.rows.offsets:
        along = turn_a @ a
        columns.append(np.concatenate([-along, np.cross(along, gap)]))
    if loop.rows.distance is not None:
        columns.append(np.concatenate([-gap / loop.rows.distance, np.zeros(3)]))
    return np.array(columns).reshape(-1, 6).T


def _left_null_space(jacobian: Array) -> Array:
    """An orthonormal basis of {λ : φ_q′ᵀλ = 0}, of shape (m, r)."""
    if jacobian.size == 0:
        return np.eye(len(jacobian))
    u, s, _ = np.linalg.svd(jacobian)
    return np.asarray(u[:, int(np.count_nonzero(s > _NULL * s[0])) :])
