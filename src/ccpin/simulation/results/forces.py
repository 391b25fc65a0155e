"""The forces inside: what closures and joints carry along a motion, in newtons and newton metres.

λ of the descriptor form (17), D′q̈′ + C′q̇′ + g′ = Sᵀu + φ_q′ᵀλ, has one entry a row of φ, in that row's own axes and
units. Here it is put together into the wrench that a closure exerts on its end A: a force and a moment about the
closure point of A, in world axes. End B receives the opposite wrench about the same point. From the closures' wrenches
and the bodies' accelerations follow, by Newton and Euler, those of the tree's joints.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from ccpin.arrays import Array, Mask, cross, instance
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.dynamics.wrenches import Pushes, Wrenches, applied_wrenches, pushes_of, wrench_rows
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.points import BodyMotion, body_motion, joint_poses
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.results.trajectory import Trajectory

_NULL = 1e-9  # of the largest singular value of φ_q′ᵀ: a singular value below is zero
_SEEN = 1e-7  # of a null vector's wrenches: components below are not changed by it


class PeakForce(NamedTuple):
    """What one bearing has to carry, the largest of all samples.

    Attributes:
        name: The closure's or joint's name.
        force: Largest |force|, N. force_time: when, s.
        radial, axial: Largest force across and along the bearing's axis, N.
        moment: Largest |moment|, N m. moment_time: when, s.
        undetermined: What rigid bodies leave undetermined, in a sentence; empty where all is determined.
    """

    name: str
    force: float
    force_time: float
    radial: float
    axial: float
    moment: float
    moment_time: float
    undetermined: str


class BearingForce(NamedTuple):
    """The wrench that one closure or joint carries along a motion; world axes.

    The equations of rigid bodies do not fix a component along which the loops constrain the motion more than once
    (out of the plane of a planar loop; throughout an overconstrained linkage). Such components belong to the solution
    in which the rows that planarity took out of φ carry nothing and the others have the least norm; the true ones
    depend on clearances and elasticity.

    Attributes:
        name: The closure's or joint's name.
        t: Times, s, of shape (T,).
        point: The closure point of A, or the joint's origin, m, of shape (T, 3).
        axis: The z axis of A's closure frame, or the joint's axis, of shape (T, 3).
        force: Force on the closure's end A, or on the joint's child from its parent, N, of shape (T, 3).
        moment: Moment about the point on the same, N m, of shape (T, 3).
        determined: Whether each component of (force, moment) is fixed by the equations, of shape (T, 6).
    """

    name: str
    t: Array
    point: Array
    axis: Array
    force: Array
    moment: Array
    determined: Mask

    def peak(self) -> PeakForce:
        """The largest loads of the motion, for choosing the bearing."""
        size, turning = np.linalg.norm(self.force, axis=1), np.linalg.norm(self.moment, axis=1)
        axial = np.einsum("ti,ti->t", self.force, self.axis)
        radial = np.linalg.norm(self.force - axial[:, None] * self.axis, axis=1)
        names = ("force x", "force y", "force z", "moment x", "moment y", "moment z")
        free = [name for k, name in enumerate(names) if not self.determined[:, k].all()]
        return PeakForce(
            name=self.name,
            force=float(size.max()),
            force_time=float(self.t[size.argmax()]),
            radial=float(radial.max()),
            axial=float(np.abs(axial).max()),
            moment=float(turning.max()),
            moment_time=float(self.t[turning.argmax()]),
            undetermined=f"rigid bodies do not determine {', '.join(free)} (world axes)" if free else "",
        )


def closure_forces(
    model: ReducedModel | Mechanism, trajectory: Trajectory, wrenches: Wrenches | Pushes | None = None
) -> tuple[BearingForce, ...]:
    """The wrench each closure exerts on its end A at every sample of a motion, closure by closure.

    Args:
        model: The reduced model, or a mechanism.
        trajectory: A motion of it; its friction and the forces of its stops and contacts are counted.
        wrenches: On links, as for the `simulate` that made it.

    Raises:
        DifferentSubjectsError: The trajectory is not this model's.
    """
    instance(trajectory, "trajectory", Trajectory)
    bearings = _Bearings(trajectory.of("forces in closures", model, "closures", "dynamics"))
    return _histories(
        bearings.closures, trajectory.t, [bearings.of_closures(*row) for row in bearings.rows(trajectory, wrenches)]
    )


def closure_forces_at(
    model: ReducedModel | Mechanism,
    q: ArrayLike | State,
    v: ArrayLike,
    u: ArrayLike,
    near: Near = None,
    wrenches: Wrenches | None = None,
    loads: ArrayLike | None = None,
) -> tuple[BearingForce, ...]:
    """`closure_forces` at one q or State; every field has a leading axis of length one, and t = 0.

    `loads` is what else acts on the free system's joints, friction say, of shape (n′,).
    """
    bearings = _Bearings(model_of(model))
    sample = bearings.of_closures(bearings.model.at(q, near), _LoadCase(v, u, wrenches, loads))
    return _histories(bearings.closures, np.zeros(1), [sample])


def joint_forces(
    model: ReducedModel | Mechanism, trajectory: Trajectory, wrenches: Wrenches | Pushes | None = None
) -> tuple[BearingForce, ...]:
    """The wrench each joint of the tree passes from parent to child at every sample, joint by joint.

    Along a joint's free directions it is the effort of its motor, spring and damper less what accelerates its rotor, or
    that of its couplings; across them it is what the bearing carries. Arguments and errors as for `closure_forces`.

    Where a `Contact` pushes on a link, `trajectory.limits` has what it does to the joints' motion, not its point: what
    passes on from there through the bearings between the link and the ground is not in them.
    """
    instance(trajectory, "trajectory", Trajectory)
    bearings = _Bearings(trajectory.of("forces in joints", model, "closures", "dynamics"))
    return _histories(
        bearings.model.mechanism.tree.names,
        trajectory.t,
        [bearings.of_joints(*row) for row in bearings.rows(trajectory, wrenches)],
    )


class _LoadCase(NamedTuple):
    """q̇, and what acts: the motors' efforts, wrenches on links, and efforts on the free system's joints or none."""

    v: ArrayLike
    u: ArrayLike
    wrenches: Wrenches | None
    loads: ArrayLike | None


class _Loads(NamedTuple):
    """What closures or joints carry at one sample, a row each; `BearingForce` has the fields, wrench both parts."""

    point: Array
    axis: Array
    wrench: Array
    determined: Mask


class _Bearings:
    """λ as wrenches on the bodies, and from them, by Newton and Euler, what the joints carry.

    Attributes:
        closures: The closures' names.
        sides: +1 where a joint's subtree holds a closure's end A alone, −1 where end B alone, of shape (joints, L).
    """

    def __init__(self, model: ReducedModel) -> None:
        mechanism, self.model, self.free = model.mechanism, model, model.free_system.model
        self.tree, self.loops = mechanism.tree, model.parametrization.constraints.loops
        self.closures = tuple(loop.closure.name for loop in self.loops)
        self.slices = model.parametrization.constraints.row_slices()
        self.complete = Constraints(
            mechanism.tree, (*mechanism.closures, *mechanism.locks), mechanism.couplings, reduce_planar=False
        )
        self.complete_slices = self.complete.row_slices()
        self.subtrees = [list(self.free.subtrees[joint.number]) for joint in self.tree.joints]
        held = [[(loop.joint_a in all_, loop.joint_b in all_) for loop in self.loops] for all_ in self.subtrees]
        ends = np.array(held, dtype=np.float64).reshape(len(held), len(self.loops), 2)
        self.sides = ends[..., 0] - ends[..., 1]
        self.axes = np.array([joint.axis for joint in self.tree.joints]).reshape(-1, 3)
        self.masses = np.array([inertia.mass for inertia in self.free.inertias])
        self.inertias = np.array([inertia.inertia for inertia in self.free.inertias])
        self.masses[0] = 0.0

    def rows(self, trajectory: Trajectory, wrenches: Wrenches | Pushes | None) -> Iterator[tuple[State, _LoadCase]]:
        """The State, and what acts there, at every sample."""
        pushes = pushes_of(self.tree, wrenches)
        loads = trajectory.friction + trajectory.limits
        for t, (state, v, u), load in zip(trajectory.t.tolist(), trajectory.states(self.model), loads, strict=True):
            yield state, _LoadCase(v, u, pushes(t, state, v), load if load.any() else None)

    def of_closures(self, state: State, acting: _LoadCase) -> _Loads:
        """The wrenches on the closures' ends A at one state."""
        answer = self.asked(state, acting)
        if answer is None:
            wrenches, poses = self.closure_wrenches(state, acting), self.poses(state)
        else:
            wrenches, _, poses = answer
        frames = self.frames(poses)
        return _Loads(frames[:, :3, 3], frames[:, :3, 2], wrenches, _determined(self.freedoms(state)))

    def of_joints(self, state: State, acting: _LoadCase) -> _Loads:
        """The wrenches that the joints pass on to their children at one state."""
        answer = self.asked(state, acting)
        poses = self.poses(state) if answer is None else answer[2]
        points, origins = self.frames(poses)[:, :3, 3], poses[1:, :3, 3]
        if answer is None:
            passed = self.passed(self.closure_wrenches(state, acting)[:, None], points, origins)[:, 0]
            wrenches = self.subtree_wrenches(state, acting) - passed
        else:
            wrenches = answer[1]
        axes = np.einsum("jik,jk->ji", poses[1:, :3, :3], self.axes)
        determined = _determined(self.passed(self.freedoms(state), points, origins))
        return _Loads(origins, axes, wrenches, determined)

    def asked(self, state: State, acting: _LoadCase) -> Any:
        """The compiled core's answer: the closures' wrenches, the joints', and the joints' poses."""
        if acting.loads is not None:
            return None
        rows = wrench_rows(self.tree, acting.wrenches)
        return self.model.core.bearing_forces(state.q_free, acting.v, acting.u, None, rows)

    def poses(self, state: State) -> Array:
        return joint_poses(self.model.free_system.scratch, state.q_free)

    def frames(self, poses: Array) -> Array:
        """The closures' frames on their ends A in the world, of shape (L, 4, 4)."""
        return np.array([poses[loop.joint_a] @ loop.frame_a for loop in self.loops]).reshape(-1, 4, 4)

    def closure_wrenches(self, state: State, acting: _LoadCase) -> Array:
        """Of shape (L, 6)."""
        multipliers = state.constraint_forces(*acting)
        rows = self.model.parametrization.constraints.wrenches(state.point.constraints)
        found = [rows[self.slices[name]].T @ multipliers[self.slices[name]] for name in self.closures]
        return np.array(found).reshape(-1, 6)

    def freedoms(self, state: State) -> Array:
        """The wrenches that each null vector of φ_q′ᵀ, all its rows kept, adds to each closure, of shape (L, r, 6)."""
        complete = self.complete.value(state.q_free)
        loose, wrenches = _left_null_space(complete.jacobian), self.complete.wrenches(complete)
        found = [loose[rows].T @ wrenches[rows] for rows in (self.complete_slices[name] for name in self.closures)]
        return np.array(found).reshape(len(self.loops), loose.shape[1], 6)

    def passed(self, wrenches: Array, points: Array, origins: Array) -> Array:
        """What wrenches (L, r, 6) at the closures' points are to the joints' subtrees, of shape (joints, r, 6)."""
        forces, moments = wrenches[..., :3], wrenches[..., 3:]
        arms = (points - origins[:, None])[:, :, None]
        moved = moments + cross(arms, forces)
        forces = np.einsum("jl,lri->jri", self.sides, forces)
        return np.concatenate([forces, np.einsum("jl,jlri->jri", self.sides, moved)], axis=2)

    def subtree_wrenches(self, state: State, acting: _LoadCase) -> Array:
        """Newton and Euler: what each joint's subtree asks for, closures aside, about its origin, (joints, 6)."""
        motion, forces, moments = self.momentum_rates(state, acting)
        for one in applied_wrenches(self.tree, acting.wrenches):
            pose = motion.poses[one.joint]
            arm = pose[:3, :3] @ one.point + pose[:3, 3] - motion.centres[one.joint]
            forces[one.joint] -= one.force
            moments[one.joint] -= one.moment + cross(arm, one.force)
        found = np.empty((len(self.subtrees), 6))
        for joint, carried, wrench in zip(self.tree.joints, self.subtrees, found, strict=True):
            arms = motion.centres[carried] - motion.poses[joint.number, :3, 3]
            wrench[:3] = forces[carried].sum(axis=0)
            wrench[3:] = (moments[carried] + cross(arms, forces[carried])).sum(axis=0)
        return found

    def momentum_rates(self, state: State, acting: _LoadCase) -> tuple[BodyMotion, Array, Array]:
        """The bodies' motion, and the force and the moment about its centre that each one's motion and weight take."""
        a_free = state.a_free(acting.v, state.forward_dynamics(*acting))
        motion = body_motion(self.model.free_system.scratch, state.q_free, state.v_free(acting.v), a_free)
        turns = motion.poses[:, :3, :3]
        inertias = turns @ self.inertias @ turns.transpose(0, 2, 1)
        forces = self.masses[:, None] * (motion.accelerations - self.model.gravity_vector)
        spins = np.einsum("bij,bj->bi", inertias, motion.omega)
        moments = np.einsum("bij,bj->bi", inertias, motion.alpha) + cross(motion.omega, spins)
        return motion, forces, moments


def _histories(names: Sequence[str], t: Array, samples: Sequence[_Loads]) -> tuple[BearingForce, ...]:
    """The samples' loads, one closure or joint after the other."""
    point, axis, wrench, determined = (np.array(column) for column in zip(*samples, strict=True))
    return tuple(
        BearingForce(name, t.copy(), point[:, k], axis[:, k], wrench[:, k, :3], wrench[:, k, 3:], determined[:, k])
        for k, name in enumerate(names)
    )


def _determined(freedoms: Array) -> Mask:
    """Which components no null vector of φ_q′ᵀ changes, of shape (K, 6)."""
    return np.asarray(np.abs(freedoms).max(axis=1, initial=0.0) < _SEEN)


def _left_null_space(jacobian: Array) -> Array:
    """An orthonormal basis of {λ : φ_q′ᵀλ = 0}, of shape (m, r)."""
    return null_space(jacobian.T, rcond=_NULL) if jacobian.size else np.eye(len(jacobian))
