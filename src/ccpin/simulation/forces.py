"""The forces inside: what closures and joints carry along a motion, in newtons and newton metres.

λ of the descriptor form (17), D′q̈′ + C′q̇′ + g′ = Sᵀu + φ_q′ᵀλ, has one entry a row of φ, in that row's own axes and
units. Here it is put together into the wrench that a closure exerts on its end A: a force and a moment about the
closure point of A, in world axes. End B receives the opposite wrench about the same point. From the closures' wrenches
and the bodies' accelerations follow, by Newton and Euler, those of the tree's joints.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from ccpin.arrays import Array, Mask, cross, instance, skew
from ccpin.dynamics.reduced_model import ReducedModel, model_of
from ccpin.dynamics.state import Near, State
from ccpin.dynamics.wrenches import Pushes, Wrenches, applied_wrenches, pushes_of
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.points import BodyMotion, body_motion, joint_poses
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.trajectory import Trajectory

_NULL = 1e-9
_SEEN = 1e-7


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
        trajectory: A motion of it under the motors' efforts and `wrenches` (friction is not in its u, so its share
            would be missing here).
        wrenches: On links, as for `simulate`.

    Raises:
        InvalidInputError: The trajectory is not this model's.
    """
    bearings = _Wrenches(model_of(model))
    instance(trajectory, "trajectory", Trajectory)
    return _histories(trajectory.t, [bearings.closures(*row).loads for row in bearings.rows(trajectory, wrenches)])


def closure_forces_at(
    model: ReducedModel | Mechanism,
    q: ArrayLike | State,
    v: ArrayLike,
    u: ArrayLike,
    guess: Near = None,
    wrenches: Wrenches | None = None,
) -> tuple[BearingForce, ...]:
    """`closure_forces` at one q or State; every field has a leading axis of length one, and t = 0."""
    bearings = _Wrenches(model_of(model))
    return _histories(np.zeros(1), [bearings.closures(bearings.model.at(q, guess), v, u, wrenches).loads])


def joint_forces(
    model: ReducedModel | Mechanism, trajectory: Trajectory, wrenches: Wrenches | Pushes | None = None
) -> tuple[BearingForce, ...]:
    """The wrench each joint of the tree passes from parent to child at every sample, joint by joint.

    Along a joint's free directions it is the effort of its motor, spring and damper less what accelerates its rotor, or
    that of its couplings; across them it is what the bearing carries. Arguments and errors as for `closure_forces`.
    """
    bearings = _Wrenches(model_of(model))
    instance(trajectory, "trajectory", Trajectory)
    return _histories(trajectory.t, [bearings.joints(*row) for row in bearings.rows(trajectory, wrenches)])


class _Load(NamedTuple):
    """What one closure or joint carries at one sample; `BearingForce` has the fields."""

    name: str
    point: Array
    axis: Array
    wrench: Array
    determined: Mask


class _Closures(NamedTuple):
    """The closures' loads, and the wrenches that each null vector of φ_q′ᵀ would add to each of them, (6, r) each."""

    loads: list[_Load]
    freedoms: list[Array]


class _Wrenches:
    """λ as wrenches on the bodies."""

    def __init__(self, model: ReducedModel) -> None:
        mechanism = model.mechanism
        self.model = model
        self.free = model.free_system.model
        self.loops = model.parametrization.constraints.loops
        self.slices = model.parametrization.constraints.row_slices()
        self.complete = Constraints(mechanism.tree, mechanism.closures, mechanism.couplings, reduce_planar=False)
        self.complete_slices = self.complete.row_slices()
        self.masses = np.array([inertia.mass for inertia in self.free.inertias])
        self.inertias = np.array([inertia.inertia for inertia in self.free.inertias])
        self.masses[0] = 0.0

    def rows(
        self, trajectory: Trajectory, wrenches: Wrenches | Pushes | None
    ) -> Iterator[tuple[State, Array, Array, Wrenches | None]]:
        """(State, q̇, u, wrenches on links) at every sample."""
        pushes = pushes_of(self.model.mechanism.tree, wrenches)
        for t, (state, v, u) in zip(trajectory.t.tolist(), trajectory.states(self.model), strict=True):
            yield state, v, u, pushes(t, state, v)

    def closures(self, state: State, v: ArrayLike, u: ArrayLike, pushed: Wrenches | None) -> _Closures:
        """The wrenches on the closures' ends A at one state."""
        multipliers = state.constraint_forces(v, u, pushed)
        poses = joint_poses(self.model.free_system.scratch, state.q_free)
        constraints, complete = self.model.parametrization.constraints, self.complete.value(state.q_free)
        loose = _left_null_space(complete.jacobian)
        wrenches = constraints.wrenches(state.point.constraints)
        all_wrenches = self.complete.wrenches(complete)
        loads, freedoms = [], []
        for loop in self.loops:
            name, frame = loop.closure.name, poses[loop.joint_a] @ loop.frame_a
            rows, all_rows = self.slices[name], self.complete_slices[name]
            freedoms.append(all_wrenches[all_rows].T @ loose[all_rows])
            wrench = wrenches[rows].T @ multipliers[rows]
            loads.append(_Load(name, frame[:3, 3], frame[:3, 2], wrench, _determined(freedoms[-1])))
        return _Closures(loads, freedoms)

    def joints(self, state: State, v: Array, u: Array, pushed: Wrenches | None) -> list[_Load]:
        """Newton and Euler for what each joint carries: its subtree's momentum, weight, closures and wrenches."""
        closures = self.closures(state, v, u, pushed)
        motion, forces, moments = self.momentum_rates(state, v, u, pushed)
        for one in applied_wrenches(self.model.mechanism.tree, pushed):
            pose = motion.poses[one.joint]
            arm = pose[:3, :3] @ one.point + pose[:3, 3] - motion.centres[one.joint]
            forces[one.joint] -= one.force
            moments[one.joint] -= one.moment + cross(arm, one.force)
        loads = []
        for joint in self.model.mechanism.tree.joints:
            carried, origin = list(self.free.subtrees[joint.number]), motion.poses[joint.number, :3, 3]
            turning = moments[carried] + cross(motion.centres[carried] - origin, forces[carried])
            wrench = np.concatenate([forces[carried].sum(axis=0), turning.sum(axis=0)])
            freedom = np.zeros((6, closures.freedoms[0].shape[1] if closures.freedoms else 0))
            for loop, load, loose in zip(self.loops, *closures, strict=True):
                side = float(loop.joint_a in carried) - float(loop.joint_b in carried)
                shift = _shift(load.point - origin)
                wrench -= side * (shift @ load.wrench)
                freedom -= side * (shift @ loose)
            turned = motion.poses[joint.number, :3, :3] @ joint.axis
            loads.append(_Load(joint.name, origin, turned, wrench, _determined(freedom)))
        return loads

    def momentum_rates(
        self, state: State, v: Array, u: Array, pushed: Wrenches | None
    ) -> tuple[BodyMotion, Array, Array]:
        """The bodies' motion, and the force and the moment about its centre that each one's motion and weight take."""
        a_free = state.a_free(v, state.forward_dynamics(v, u, pushed))
        motion = body_motion(self.model.free_system.scratch, state.q_free, state.v_free(v), a_free)
        turns = motion.poses[:, :3, :3]
        inertias = turns @ self.inertias @ turns.transpose(0, 2, 1)
        forces = self.masses[:, None] * (motion.accelerations - self.model.gravity_vector)
        spins = np.einsum("bij,bj->bi", inertias, motion.omega)
        moments = np.einsum("bij,bj->bi", inertias, motion.alpha) + cross(motion.omega, spins)
        return motion, forces, moments


def _histories(t: Array, samples: list[list[_Load]]) -> tuple[BearingForce, ...]:
    """The samples' loads, one closure or joint after the other."""
    histories = []
    for loads in zip(*samples, strict=True):
        (name, *_), *columns = zip(*loads, strict=True)
        point, axis, wrench, determined = map(np.array, columns)
        histories.append(BearingForce(name, t.copy(), point, axis, wrench[:, :3], wrench[:, 3:], determined))
    return tuple(histories)


def _determined(freedom: Array) -> Mask:
    """Which components no null vector of φ_q′ᵀ changes, of shape (6,)."""
    return np.asarray(np.abs(freedom).max(axis=1, initial=0.0) < _SEEN)


def _shift(arm: Array) -> Array:
    """The 6×6 matrix that takes a wrench about origin + arm to the same wrench about the origin."""
    shift = np.eye(6)
    shift[3:, :3] = skew(arm)
    return shift


def _left_null_space(jacobian: Array) -> Array:
    """An orthonormal basis of {λ : φ_q′ᵀλ = 0}, of shape (m, r)."""
    return null_space(jacobian.T, rcond=_NULL) if jacobian.size else np.eye(len(jacobian))
