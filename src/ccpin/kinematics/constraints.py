"""φ(q′) = 0 with its Jacobian, its rate and its derivatives: loop closures and couplings stacked (3)."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.model import Coupling, LoopClosure
from ccpin.kinematics.loops import resolve_closures, resolve_coupling
from ccpin.kinematics.rows import Directions, RowStack, RowValues, column_rates
from ccpin.kinematics.scratch import six_rows
from ccpin.kinematics.tree import Tree

_NOTHING = 1e-12  # m or rad: a misfit this small is not told beside a larger one


class ConstraintValue(NamedTuple):
    """φ at one configuration, with what its rates and derivatives are computed from.

    Attributes:
        phi: φ, of shape (m,).
        jacobian: φ_q′, of shape (m, n′).
        q_free: q′, of shape (nq,).
        placed: The closures' vectors in the world.
    """

    phi: Array
    jacobian: Array
    q_free: Array
    placed: RowValues


class Constraints:
    """The constraint functions of a tree with loop closures and couplings.

    φ stacks, closure by closure in the order declared, the rows that `ccpin.description.closure_kinds` defines: point
    rows (metres, in the nearest common ancestor's axes), direction rows (dimensionless), offset rows (m), distance row
    (m); then one row a coupling (rad or m). Every row is exact off the manifold too.

    Args:
        tree: The free system.
        closures: Loop closures.
        couplings: Joint couplings.
        reduce_planar: Drop the rows of planar loops that are constant by proof (see `ccpin.kinematics.loops`).
    """

    def __init__(
        self,
        tree: Tree,
        closures: tuple[LoopClosure, ...],
        couplings: tuple[Coupling, ...],
        *,
        reduce_planar: bool = True,
    ) -> None:
        self.model = tree.model
        self.loops = resolve_closures(tree, closures, reduce_planar)
        self.couplings = tuple(resolve_coupling(tree, coupling) for coupling in couplings)
        self.size = sum(loop.size for loop in self.loops) + len(self.couplings)
        self._rows = RowStack(tree, self.loops)
        self.scratch = tree.scratch
        self._before = _before(tree)
        turns = [turns for loop in self.loops for turns in loop.rows.direction_rows]
        self._units = [*("rad" if each else "m" for each in turns), *(_unit(tree, each) for each in couplings)]

    def row_slices(self) -> dict[str, slice]:
        """Which rows of φ belong to each closure and coupling, by name."""
        names = [*(loop.closure.name for loop in self.loops), *(each.coupling.name for each in self.couplings)]
        stops = np.cumsum([*(loop.size for loop in self.loops), *(1 for _ in self.couplings)], dtype=int).tolist()
        return {name: slice(start, stop) for name, start, stop in zip(names, [0, *stops], stops, strict=False)}

    def misfit(self, phi: Array, rows: slice = slice(None)) -> str:
        """How far rows of φ (default all) are from zero, in words: the largest gap and the largest misalignment."""
        sizes, units = np.abs(phi[rows]), np.array(self._units)[rows]
        largest = {unit: float(sizes[units == unit].max()) for unit in dict.fromkeys(units.tolist())}
        told = {unit: size for unit, size in largest.items() if size > _NOTHING} or largest
        return " and ".join(f"{size:.4g} {unit}" for unit, size in told.items())

    @cached_property
    def extent(self) -> float:
        """The largest sum of lengths around a loop, m (1 where there are none)."""
        return max((loop.extent(self.model) for loop in self.loops), default=0.0) or 1.0

    def row_scale(self) -> Array:
        """What makes each row dimensionless, of shape (m,): 1 of directions and couplings, 1/extent of lengths."""
        turns = [turns for loop in self.loops for turns in loop.rows.direction_rows]
        return np.where([*turns, *(True for _ in self.couplings)], 1.0, 1.0 / self.extent)

    def value(self, q_free: Array) -> ConstraintValue:
        """φ(q′) and φ_q′(q′) (3), (10)."""
        phi, jacobian = np.empty(self.size), np.empty((self.size, self.model.nv))
        placed = self._placed(q_free)
        rows = slice(0, self._rows.size)
        phi[rows], jacobian[rows] = placed.value, self._rows.jacobian(placed)
        for k, coupling in enumerate(self.couplings, start=rows.stop):
            phi[k], jacobian[k] = coupling.value(q_free), 0.0
            for term in coupling.terms:
                jacobian[k, term.idx_v] += term.slope(1, q_free)
        return ConstraintValue(phi, jacobian, q_free, placed)

    def residual(self, q_free: Array) -> Array:
        """φ(q′) alone, of shape (m,)."""
        return self.value(q_free).phi

    def rate(self, at: ConstraintValue, v_free: Array) -> Array:
        """φ̇_q′ = d/dt φ_q′ along q̇′, of shape (m, n′), as (35) needs it."""
        rate = np.zeros((self.size, self.model.nv))
        if self._rows.size:
            spatial_rate = self._spatial_rate(at.q_free, v_free)
            rate[: self._rows.size] = self._rows.jacobian_rate(at.placed, spatial_rate, v_free)
        for k, coupling in enumerate(self.couplings, start=self._rows.size):
            for term in coupling.terms:
                rate[k, term.idx_v] += term.slope(2, at.q_free) * v_free[term.idx_v]
        return rate

    def bias(self, at: ConstraintValue, v_free: Array) -> Array:
        """φ̇_q′ q̇′, of shape (m,): what φ̈ is with q̈′ = 0."""
        bias = np.zeros(self.size)
        if self._rows.size:
            spatial_rate = self._spatial_rate(at.q_free, v_free)
            bias[: self._rows.size] = self._rows.bias(at.placed, spatial_rate, v_free)
        for k, coupling in enumerate(self.couplings, start=self._rows.size):
            bias[k] = sum(term.slope(2, at.q_free) * v_free[term.idx_v] ** 2 for term in coupling.terms)
        return bias

    def second_derivative(self, at: ConstraintValue, w: Array, steps: Array) -> Array:
        """D_k (φ_q′ w_j) for velocities w (n′, j) held and tangent steps of q′ (n′, k), of shape (m, j, k)."""
        derivative, spatial = np.zeros((self.size, w.shape[1], steps.shape[1])), at.placed.spatial
        if self._rows.size:
            rates = column_rates(self._before, spatial, steps)
            derivative[: self._rows.size] = self._rows.second_derivative(at.placed, rates, w, steps)
        for k, coupling in enumerate(self.couplings, start=self._rows.size):
            for term in coupling.terms:
                derivative[k] += term.slope(2, at.q_free) * np.outer(w[term.idx_v], steps[term.idx_v])
        return derivative

    def acceleration_derivative(
        self, at: ConstraintValue, v_free: Array, a_free: Array, directions: Directions
    ) -> Array:
        """D(φ_q′ q̈′ + φ̇_q′ q̇′) in k directions of (q′, q̇′), q̈′ held, of shape (m, k)."""
        derivative, rows = np.zeros((self.size, directions.dq.shape[1])), self._rows
        if rows.size:
            with self.scratch.lent() as data:
                pin.computeForwardKinematicsDerivatives(self.model, data, at.q_free, v_free, a_free)
                derivative[: rows.size] = rows.acceleration_derivative(at.placed, self.model, data, directions)
        for k, coupling in enumerate(self.couplings, start=rows.size):
            for term in coupling.terms:
                i, second, third = term.idx_v, term.slope(2, at.q_free), term.slope(3, at.q_free)
                derivative[k] += (second * a_free[i] + third * v_free[i] ** 2) * directions.dq[i]
                derivative[k] += 2.0 * second * v_free[i] * directions.dv[i]
        return derivative

    def end_points(self, at: ConstraintValue) -> Array:
        """p_A of every closure, then p_B, in the world, metres, of shape (2 L, 3)."""
        return self._rows.end_points(at.placed)

    def wrenches(self, at: ConstraintValue) -> Array:
        """What each loop row's unit multiplier does to its end A: (force, moment about A's closure point), (R, 6).

        World axes. It follows from the rate of the row by equal power: λ_i φ̇_i = λ_i f_A·V_A + λ_i f_B·V_B.
        """
        return self._rows.wrenches_on_a(at.placed)

    def turned(self, q_free: Array) -> tuple[str, ...]:
        """The closures whose axes are turned end for end, by name."""
        with self.scratch.lent() as data:
            pin.forwardKinematics(self.model, data, q_free)
            placed = [(loop, *loop.orientations(data)) for loop in self.loops]
        turned = (
            loop.closure.name
            for loop, a, b in placed
            if any((a @ one) @ (b @ other) <= 0 for one, other in loop.rows.alignment)
        )
        return tuple(turned)

    def aligned(self, q_free: Array) -> bool:
        """Whether every closure with direction rows is closed the right way round (axes not turned end for end)."""
        return not self.turned(q_free)

    def _placed(self, q_free: Array) -> RowValues:
        with self.scratch.lent() as data:
            spatial, frames = six_rows(pin.computeJointJacobians(self.model, data, q_free)), data.oMi
            poses = np.array([frames[joint].homogeneous for joint in self._rows.joints]).reshape(-1, 4, 4)
        return self._rows.place(poses, spatial)

    def _spatial_rate(self, q_free: Array, v_free: Array) -> Array:
        """Ṡ along q̇′, of shape (6, n′)."""
        with self.scratch.lent() as data:
            return six_rows(pin.computeJointJacobiansTimeVariation(self.model, data, q_free, v_free))


def _unit(tree: Tree, coupling: Coupling) -> str:
    """The unit of a coupling's row: that of its joints, whose coefficients are numbers where they share one."""
    units = {"m" if tree.joint(term.joint).kind.sliding else "rad" for term in coupling.terms}
    return units.pop() if len(units) == 1 else "(m or rad, as the coupling counts)"


def _before(tree: Tree) -> Array:
    """1.0 where a velocity component (column) moves the body of another (row), of shape (n′, n′)."""
    rows = [tree.support(joint.number) for joint in tree.joints for _ in joint.kind.steps]
    return np.array(rows).reshape(-1, tree.model.nv)
