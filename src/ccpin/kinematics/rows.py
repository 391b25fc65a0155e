"""The rows of all closures side by side as arrays, and their values and exact derivatives at a configuration.

Each row is Σ w (x·y) (`ccpin.description.closure_kinds`). A vector fixed in a body turns with it, ẋ = ω × x; the gap
p_B − p_A moves as its ends do. All is expressed in the world's axes: the rows are scalars, so they do not see that the
common ancestor C moves. The rate of a row is then a power,

    φ̇_i = f_A·V_A + f_B·V_B,

V the bodies' spatial velocities (linear at the world's origin, angular), and f_A, f_B the wrenches, about that origin,
with which the closure acts on its ends for a unit multiplier λ_i. φ_q′ follows with V = S q̇′, S the spatial Jacobian.

There are L loops, R rows, T products in them, K joints that carry an end or an ancestor, and N vectors carried by
these: first those fixed in a body, then the points p_A of every loop, then the points p_B.

Rows being sums of scalar products, second and third derivatives of φ need those of the vectors only. A vector fixed in
a body with spatial velocity V, acceleration A obeys ẋ = ω × x, ẍ = α × x + ω × ẋ, an end's point alike with the linear
parts added, and these relations are differentiated once more. Arrays have the vector axis last.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array, Indices, cross
from ccpin.description.closure_kinds import Fixed, Gap, Product
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.scratch import six_rows
from ccpin.kinematics.tree import Tree


class RowValues(NamedTuple):
    """The closures at one configuration, in world axes.

    Attributes:
        spatial: S, of shape (6, n′).
        vectors: The carried vectors, of shape (N, 3).
        value: φ, of shape (R,).
        wrenches: f_A of every row, then f_B: (force, moment about the world's origin), of shape (2 R, 6).
    """

    spatial: Array
    vectors: Array
    value: Array
    wrenches: Array


class Directions(NamedTuple):
    """k directions of (q′, q̇′) in which to differentiate.

    Attributes:
        dq: Tangent steps of q′ (right increments, as `pin.integrate` takes them), of shape (n′, k).
        dv: Changes of the components of q̇′, of shape (n′, k).
    """

    dq: Array
    dv: Array


class RowStack:
    """The rows of resolved closures.

    Attributes:
        size: R.
        joints: The K joints' numbers.
        supports: 1.0 for the velocity components that move each of them, else 0.0, of shape (K, n′).

    Args:
        tree: The free system.
        loops: The closures.
    """

    def __init__(self, tree: Tree, loops: Sequence[ResolvedClosure]) -> None:
        ends = np.array([(loop.joint_a, loop.joint_b, loop.ancestor) for loop in loops], dtype=np.intp).reshape(-1, 3)
        numbers = np.unique(ends)
        self.size, self.loops = sum(loop.size for loop in loops), len(loops)
        self.joints = tuple(int(joint) for joint in numbers)
        self.supports = np.array([tree.support(joint) for joint in self.joints]).reshape(-1, tree.model.nv)
        rows_of = np.repeat(np.arange(len(loops)), [loop.size for loop in loops])
        # the end that each row of φ pulls at, among all ends: loops' A ends first, then their B ends
        self._pulled = np.concatenate([rows_of, len(loops) + rows_of])
        masks = [*(loop.mask_a for loop in loops), *(loop.mask_b for loop in loops)]
        self._paths = np.array(masks).reshape(-1, tree.model.nv)[self._pulled]
        rows = [(loop, row) for loop in loops for row in loop.rows.rows]
        # where each row's products begin in the list of all
        self._starts = np.cumsum([0, *(len(row) for _, row in rows)], dtype=np.intp)[:-1]
        self._tabulate(loops, [(loop, product) for loop, row in rows for product in row], numbers)

    def _tabulate(
        self, loops: Sequence[ResolvedClosure], products: list[tuple[ResolvedClosure, Product]], numbers: Indices
    ) -> None:
        """Where each vector is carried, where the T products find theirs, and what these turn and pull."""
        carried: list[_Carried] = []
        sides: list[list[int]] = [[], []]  # the number of a carried vector, or −1 − k for the gap of loop k
        place = {id(loop): k for k, loop in enumerate(loops)}
        for loop, product in products:
            for side, vector in zip(sides, (product.left, product.right), strict=True):
                side.append(-1 - place[id(loop)] if isinstance(vector, Gap) else len(carried))
                if not isinstance(vector, Gap):
                    carried.append(_carried(loop, vector))
        self._fixed = len(carried)
        carried += [_Carried("A", loop.joint_a, loop.frame_a[:, 3]) for loop in loops]
        carried += [_Carried("B", loop.joint_b, loop.frame_b[:, 3]) for loop in loops]
        self._carrier = np.searchsorted(numbers, np.array([each.joint for each in carried], dtype=np.intp))
        self._local = np.array([each.local for each in carried]).reshape(-1, 4, 1)
        self._linear = self._local[:, 3, 0].copy()
        self._left, self._right = (
            np.array([k if k >= 0 else self._fixed - 1 - k for k in side], dtype=np.intp) for side in sides
        )
        self._weights = np.array([product.weight for _, product in products])
        frames = np.array([each.frame for each in carried[: self._fixed]] + ["gap"] * len(loops), dtype="<U3")
        left, right = frames[self._left], frames[self._right]
        # (δ × x)·y = δ·(x × y) for x fixed in a body that turns by δ, and the other way round for y
        turning = [self._weights * (1.0 * (left == body) - (right == body)) for body in ("A", "B")]
        self._turning = np.array(turning).T[..., None]
        self._turns = bool(self._turning.any())
        self._left_pulls = (self._weights * (right == "gap"))[:, None]
        self._right_pulls = (self._weights * (left == "gap"))[:, None]

    def place(self, poses: Array, spatial: Array) -> RowValues:
        """The closures where the joints' world poses (K, 4, 4) and the spatial Jacobian (6, n′) are as given."""
        vectors = (poses[self._carrier] @ self._local)[:, :3, 0]
        x, y = self.sides(vectors)
        turning = cross(x, y) if self._turns else None
        wrenches = self._wrenches(vectors, turning, self._left_pulls * x + self._right_pulls * y)
        return RowValues(spatial, vectors, self.summed(self._weights * (x * y).sum(axis=1)), wrenches)

    def wrenches_on_a(self, placed: RowValues) -> Array:
        """f_A of every row as (force, moment about its loop's p_A), of shape (R, 6)."""
        wrenches = placed.wrenches[: self.size].copy()
        wrenches[:, 3:] -= cross(placed.vectors[self._fixed :][self._pulled[: self.size]], wrenches[:, :3])
        return wrenches

    def end_points(self, placed: RowValues) -> Array:
        """p_A of every loop, then p_B, of shape (2 L, 3)."""
        return placed.vectors[self._fixed :]

    def jacobian(self, placed: RowValues) -> Array:
        """φ_q′, of shape (R, n′)."""
        return self._on_paths(placed.wrenches @ placed.spatial)

    def jacobian_rate(self, placed: RowValues, spatial_rate: Array, v_free: Array) -> Array:
        """d/dt φ_q′ along q̇′, of shape (R, n′); `spatial_rate` is Ṡ (6, n′)."""
        rates = self.moved(placed.vectors, self.twists(placed.spatial, v_free))
        (x, y), (x_1, y_1) = self.sides(placed.vectors), self.sides(rates)
        turning = cross(x_1, y) + cross(x, y_1) if self._turns else None
        change = self._wrenches(placed.vectors, turning, self._left_pulls * x_1 + self._right_pulls * y_1)
        change[:, 3:] += cross(rates[self._fixed :][self._pulled], placed.wrenches[:, :3])
        return self._on_paths(change @ placed.spatial + placed.wrenches @ spatial_rate)

    def bias(self, placed: RowValues, spatial_rate: Array, v_free: Array) -> Array:
        """φ̇_q′ q̇′, of shape (R,): φ̈ = Σ w (ẍ·y + 2 ẋ·ẏ + x·ÿ) with q̈′ = 0."""
        twists, accelerations = self.twists(placed.spatial, v_free), self.twists(spatial_rate, v_free)
        rates = self.moved(placed.vectors, twists)
        second = self.moved(placed.vectors, accelerations) + self.turned(rates, twists)
        (x, y), (x_1, y_1), (x_2, y_2) = (self.sides(each) for each in (placed.vectors, rates, second))
        return self.summed(self._weights * (x_2 * y + 2.0 * x_1 * y_1 + x * y_2).sum(axis=1))

    def second_derivative(self, placed: RowValues, rates: Array, w: Array, steps: Array) -> Array:
        """D_k (φ_q′ w_j) for velocity components w (n′, j) held and tangent steps (n′, k), of shape (R, j, k).

        `rates` are the `column_rates` along the steps.
        """
        by_w, by_step = (np.moveaxis((self.supports[:, None] * placed.spatial) @ each, 2, 1) for each in (w, steps))
        mixed = np.einsum("nl,lj,clk->njkc", self.supports, w, rates, optimize=True)
        x = placed.vectors[:, None]
        x_w, x_s = self.moved(x, by_w)[:, :, None], self.moved(x, by_step)[:, None]
        x_ws = self.moved(x[:, None], mixed) + self.turned(x_s, by_w[:, :, None])
        (a, b), (a_w, b_w), (a_s, b_s), (a_ws, b_ws) = (self.sides(each) for each in (x[:, None], x_w, x_s, x_ws))
        return self.weighted((a_ws * b + a_w * b_s + a_s * b_w + a * b_ws).sum(axis=-1))

    def acceleration_derivative(
        self, placed: RowValues, model: pin.Model, data: pin.Data, directions: Directions
    ) -> Array:
        """D(φ_q′ q̈′ + φ̇_q′ q̇′) in each direction, the components of q̈′ held, of shape (R, k).

        `data` is as `pin.computeForwardKinematicsDerivatives` leaves it at (q′, q̇′, q̈′).
        """
        jets = [_jet(model, data, joint, directions) for joint in self.joints]
        twist, second, step, d_twist, d_second = (np.array(each) for each in zip(*jets, strict=True))
        twist, second, x = twist[:, None], second[:, None], placed.vectors[:, None]
        x_1 = self.moved(x, twist)
        x_2 = self.moved(x, second) + self.turned(x_1, twist)
        dx = self.moved(x, step)
        dx_1 = self.moved(x, d_twist) + self.turned(dx, twist)
        dx_2 = self.moved(x, d_second) + self.turned(dx, second) + self.turned(x_1, d_twist) + self.turned(dx_1, twist)
        (a, b), (a_1, b_1), (a_2, b_2), (da, db), (da_1, db_1), (da_2, db_2) = (
            self.sides(each) for each in (x, x_1, x_2, dx, dx_1, dx_2)
        )
        change = a_2 * db + b_2 * da + 2.0 * (a_1 * db_1 + b_1 * da_1) + a * db_2 + b * da_2
        return self.weighted(change.sum(axis=-1))

    def twists(self, spatial: Array, v_free: Array) -> Array:
        """S q̇′ of the K joints' bodies, of shape (K, 6)."""
        return np.asarray((self.supports * v_free) @ spatial.T)

    def turned(self, vectors: Array, twists: Array) -> Array:
        """ω × x of vectors (N, …, 3) as the joints' bodies turn with twists (K, …, 6)."""
        return cross(twists[self._carrier, ..., 3:], vectors)

    def moved(self, vectors: Array, twists: Array) -> Array:
        """How carried vectors change as the bodies move: ω × x, and v + ω × p for points."""
        linear = self._linear.reshape(-1, *(1,) * (twists.ndim - 1))
        return np.asarray(linear * twists[self._carrier, ..., :3] + self.turned(vectors, twists))

    def sides(self, vectors: Array) -> tuple[Array, Array]:
        """The two vectors of each product (or their derivatives), of shape (T, …) both."""
        start, half = self._fixed, self._fixed + self.loops
        # fixed vectors, then the gaps p_B − p_A: `vectors` ends with all p_A and all p_B
        complete = np.concatenate([vectors[:start], vectors[half:] - vectors[start:half]])
        return complete[self._left], complete[self._right]

    def summed(self, products: Array) -> Array:
        """Products (T, …) added up to rows (R, …)."""
        if len(products) == self.size:
            return products
        return np.asarray(np.add.reduceat(products, self._starts, axis=0))

    def weighted(self, products: Array) -> Array:
        """Σ w (…) of products (T, …), by row."""
        return self.summed(products * self._weights.reshape(-1, *(1,) * (products.ndim - 1)))

    def _wrenches(self, vectors: Array, turning: Array | None, pull: Array) -> Array:
        """f_A, then f_B, of rows whose products turn by w x × y (``None``: none does) and pull at the gap."""
        wrenches, pull = np.empty((2 * self.size, 6)), self.summed(pull)
        forces, moments = wrenches[:, :3], wrenches[:, 3:]
        np.negative(pull, out=forces[: self.size])
        forces[self.size :] = pull
        moments[:] = cross(vectors[self._fixed :][self._pulled], forces)
        if turning is not None:
            turned = self.summed(self._turning * turning[:, None])
            moments[: self.size] += turned[:, 0]
            moments[self.size :] += turned[:, 1]
        return wrenches

    def _on_paths(self, columns: Array) -> Array:
        """Columns (2 R, n′) kept between the ancestor and each end, both ends added."""
        kept = columns * self._paths
        return np.asarray(kept[: self.size] + kept[self.size :])


class _Carried(NamedTuple):
    """A vector fixed in a body: its closure frame, the joint that carries it, and itself there, homogeneous (4,)."""

    frame: str
    joint: int
    local: Array


def _carried(loop: ResolvedClosure, vector: Fixed) -> _Carried:
    frames = {"A": (loop.joint_a, loop.frame_a), "B": (loop.joint_b, loop.frame_b), "C": (loop.ancestor, np.eye(4))}
    joint, frame = frames[vector.frame]
    return _Carried(vector.frame, joint, np.append(frame[:3, :3] @ vector.local, 0.0))


def column_rates(before: Array, spatial: Array, steps: Array) -> Array:
    """D_k S_l = V_l × S_l, V_l the velocity of column l's body under step k, of shape (6, n′, k).

    Args:
        before: 1.0 where a velocity component moves the body of another, of shape (n′, n′).
        spatial: S, of shape (6, n′).
        steps: Tangent steps of q′, of shape (n′, k).
    """
    columns = spatial.T[:, None]
    velocity = np.einsum("lm,cm,mk->lkc", before, spatial, steps, optimize=True)
    linear = cross(velocity[..., 3:], columns[..., :3]) + cross(velocity[..., :3], columns[..., 3:])
    return np.moveaxis(np.concatenate([linear, cross(velocity[..., 3:], columns[..., 3:])], axis=-1), 2, 0)


class _BodyJet(NamedTuple):
    """A body's spatial velocity and acceleration (6,), and in each direction its step and their changes, (k, 6)."""

    velocity: Array
    acceleration: Array
    step: Array
    d_velocity: Array
    d_acceleration: Array


def _jet(model: pin.Model, data: pin.Data, joint: int, directions: Directions) -> _BodyJet:
    """Pinocchio's derivatives of the components in the body's frame, carried to the world (linear at its origin).

    That adds δ × V for the body's own step δ. Its derivatives in the world's axes are wrong for joints of several
    degrees of freedom beyond the first.
    """
    if joint == 0:
        return _BodyJet(np.zeros(6), np.zeros(6), *(np.zeros((directions.dq.shape[1], 6)) for _ in range(3)))
    dq, dv, placement = directions.dq, directions.dv, data.oMi[joint]
    local = pin.getJointAccelerationDerivatives(model, data, joint, pin.ReferenceFrame.LOCAL)
    by_q, second_by_q, second_by_v, columns = (six_rows(each) for each in local)
    velocity, acceleration, to_world = placement.act(data.v[joint]), placement.act(data.a[joint]), placement.action
    step = to_world @ (columns @ dq)
    d_velocity = to_world @ (by_q @ dq + columns @ dv) - velocity.action @ step
    d_acceleration = to_world @ (second_by_q @ dq + second_by_v @ dv) - acceleration.action @ step
    return _BodyJet(velocity.vector, acceleration.vector, step.T, d_velocity.T, d_acceleration.T)
