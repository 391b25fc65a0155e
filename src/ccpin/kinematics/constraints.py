"""φ(q′) = 0 with its Jacobian and its rate: loop closures and couplings stacked (3)."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.description.model import Coupling, LoopClosure
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.acceleration_derivatives import Directions, loop_acceleration_derivative
from ccpin.kinematics.loop_derivatives import Brackets, loop_second_derivative
from ccpin.kinematics.loops import Loop, is_turned, resolve_loop
from ccpin.kinematics.tree import Tree


class ConstraintValue(NamedTuple):
    """φ, of shape (m,), and φ_q′, of shape (m, n′)."""

    phi: Array
    jacobian: Array


class ConstraintRate(NamedTuple):
    """φ (m,), φ_q′ (m, n′) and φ̇_q′ (m, n′) along q̇′."""

    phi: Array
    jacobian: Array
    jacobian_rate: Array


class _GearTerm(NamedTuple):
    idx_q: int
    idx_v: int
    wrapped: bool
    coefficients: Array
    reference: float

    def angle(self, q_free: Array) -> float:
        """The joint's displacement from the term's reference; on the circle in (−π, π] before the reference."""
        i = self.idx_q
        return float((math.atan2(q_free[i + 1], q_free[i]) if self.wrapped else q_free[i]) - self.reference)

    def slope(self, order: int, q_free: Array) -> float:
        """The polynomial's derivative of an order there."""
        coefficients = self.coefficients
        for _ in range(order):
            coefficients = _derivative(coefficients)
        return _polynomial(coefficients, self.angle(q_free))


class _Gear(NamedTuple):
    coupling: Coupling
    terms: tuple[_GearTerm, ...]
    modulus: float


class Constraints:
    """The constraint functions of a tree with loop closures and couplings.

    φ stacks, closure by closure in the order declared, its point rows (metres, in the nearest common ancestor's
    axes), direction rows (dimensionless), offset rows (m), distance row (m); then one row a coupling (rad or m).
    Every row is exact off the manifold too. Holds scratch memory: one instance a thread.

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
        self.loops = tuple(resolve_loop(tree, closure, reduce_planar) for closure in closures)
        self.gears = tuple(_resolve_gear(tree, coupling) for coupling in couplings)
        self.size = sum(loop.size for loop in self.loops) + len(self.gears)
        self._data = tree.model.createData()
        self._brackets = Brackets(tree.model)

    def row_slices(self) -> dict[str, slice]:
        """Which rows of φ belong to each closure and coupling, by name."""
        slices, start = {}, 0
        for name, size in [(loop.closure.name, loop.size) for loop in self.loops] + [
            (gear.coupling.name, 1) for gear in self.gears
        ]:
            slices[name] = slice(start, start + size)
            start += size
        return slices

    def value(self, q_free: Array) -> ConstraintValue:
        """φ(q′) and φ_q′(q′) (3), (10)."""
        pin.computeJointJacobians(self.model, self._data, q_free)
        phi, jacobian = np.empty(self.size), np.empty((self.size, self.model.nv))
        spatial, row = self._data.J, 0
        for loop in self.loops:
            if loop.size:
                ends = _Ends(loop, self._data, spatial)
                window = slice(row, row + loop.size)
                phi[window] = ends.residual()
                jacobian[window] = ends.jacobian()
                row += loop.size
        self._couple(q_free, phi, jacobian, None, None, row)
        return ConstraintValue(phi, jacobian)

    def rate(self, q_free: Array, v_free: Array) -> ConstraintRate:
        """φ, φ_q′ and φ̇_q′ = d/dt φ_q′ along q̇′, as (35) needs it."""
        pin.computeJointJacobiansTimeVariation(self.model, self._data, q_free, v_free)
        shape = (self.size, self.model.nv)
        phi, jacobian, jacobian_rate = np.empty(self.size), np.empty(shape), np.empty(shape)
        spatial, spatial_rate, row = self._data.J, self._data.dJ, 0
        for loop in self.loops:
            if loop.size:
                ends = _Ends(loop, self._data, spatial)
                window = slice(row, row + loop.size)
                phi[window] = ends.residual()
                jacobian[window] = ends.jacobian()
                jacobian_rate[window] = ends.jacobian_rate(spatial_rate, v_free, self._carried(loop, spatial, v_free))
                row += loop.size
        self._couple(q_free, phi, jacobian, jacobian_rate, v_free, row)
        return ConstraintRate(phi, jacobian, jacobian_rate)

    def second_derivative(self, q_free: Array, w: Array, steps: Array) -> Array:
        """D_k (φ_q′ w_j) for velocities w (n′, j) held and tangent steps of q′ (n′, k), of shape (m, j, k)."""
        pin.computeJointJacobians(self.model, self._data, q_free)
        derivative = np.zeros((self.size, w.shape[1], steps.shape[1]))
        rates = {C: self._brackets.rates(self._data.J, steps, C) for C in {loop.ancestor for loop in self.loops}}
        row = 0
        for loop in self.loops:
            if loop.size:
                window = slice(row, row + loop.size)
                derivative[window] = loop_second_derivative(self._data, loop, rates[loop.ancestor], w, steps)
                row += loop.size
        for k, gear in enumerate(self.gears, start=row):
            for term in gear.terms:
                derivative[k] += term.slope(2, q_free) * np.outer(w[term.idx_v], steps[term.idx_v])
        return derivative

    def acceleration_derivative(self, q_free: Array, v_free: Array, a_free: Array, directions: Directions) -> Array:
        """D(φ_q′ q̈′ + φ̇_q′ q̇′) in k directions of (q′, q̇′), q̈′ held, of shape (m, k)."""
        derivative, row, motion = np.zeros((self.size, directions.dq.shape[1])), 0, (q_free, v_free, a_free)
        for loop in self.loops:
            if loop.size:
                window = slice(row, row + loop.size)
                derivative[window] = loop_acceleration_derivative(self.model, self._data, loop, motion, directions)
                row += loop.size
        for k, gear in enumerate(self.gears, start=row):
            for term in gear.terms:
                i, second, third = term.idx_v, term.slope(2, q_free), term.slope(3, q_free)
                derivative[k] += (second * a_free[i] + third * v_free[i] ** 2) * directions.dq[i]
                derivative[k] += 2.0 * second * v_free[i] * directions.dv[i]
        return derivative

    def residual(self, q_free: Array) -> Array:
        """φ(q′) alone, of shape (m,)."""
        return self.value(q_free).phi

    def aligned(self, q_free: Array) -> bool:
        """Whether every closure with direction rows is closed the right way round (axes not turned end for end)."""
        return not self.turned(q_free)

    def turned(self, q_free: Array) -> tuple[str, ...]:
        """The closures whose axes are turned end for end, by name."""
        pin.forwardKinematics(self.model, self._data, q_free)
        return tuple(loop.closure.name for loop in self.loops if is_turned(loop, self._data))

    def _carried(self, loop: Loop, spatial: Array, v_free: Array) -> Array | None:
        """The spatial velocity of the ancestor C in the world, or ``None`` where C is the world."""
        if loop.ancestor == 0:
            return None
        velocity = np.zeros(6)
        for joint in list(self.model.supports[loop.ancestor])[1:]:
            window = slice(self.model.idx_vs[joint], self.model.idx_vs[joint] + self.model.nvs[joint])
            velocity += spatial[:, window] @ v_free[window]
        return velocity

    def _couple(
        self, q_free: Array, phi: Array, jacobian: Array, jacobian_rate: Array | None, v_free: Array | None, row: int
    ) -> None:
        """Σ terms of each coupling, with derivative and rate; wrapped where joints are angles on the circle."""
        for k, gear in enumerate(self.gears, start=row):
            jacobian[k] = 0.0
            if jacobian_rate is not None:
                jacobian_rate[k] = 0.0
            total = 0.0
            for term in gear.terms:
                total += term.slope(0, q_free)
                jacobian[k, term.idx_v] += term.slope(1, q_free)
                if jacobian_rate is not None and v_free is not None:
                    jacobian_rate[k, term.idx_v] += term.slope(2, q_free) * v_free[term.idx_v]
            phi[k] = math.remainder(total, gear.modulus) if gear.modulus else total


class _Ends:
    """The two ends of one loop at one configuration; velocities are relative to the ancestor C."""

    def __init__(self, loop: Loop, data: pin.Data, spatial: Array) -> None:
        self.loop = loop
        joint_a, joint_b = data.oMi[loop.joint_a], data.oMi[loop.joint_b]
        turn_a, turn_b = joint_a.rotation, joint_b.rotation
        self.p_a = turn_a.dot(loop.frame_a[:3, 3]) + joint_a.translation
        self.p_b = turn_b.dot(loop.frame_b[:3, 3]) + joint_b.translation
        self.oriented = bool(loop.rows.directions or loop.rows.offsets)
        if self.oriented:
            self.turn_a, self.turn_b = turn_a @ loop.frame_a[:3, :3], turn_b @ loop.frame_b[:3, :3]
        self.basis = loop.basis if loop.ancestor == 0 else loop.basis @ data.oMi[loop.ancestor].rotation.T
        self.s_a, self.s_b = spatial * loop.path_a, spatial * loop.path_b
        self.j_a = self.s_a[:3] - _skew(self.p_a).dot(self.s_a[3:])
        self.j_b = self.s_b[:3] - _skew(self.p_b).dot(self.s_b[3:])

    def residual(self) -> Array:
        rows, gap = self.loop.rows, self.p_b - self.p_a
        parts = [-self.basis.dot(gap)]
        if self.oriented:
            parts.append(
                np.array(
                    [
                        sum(w * self.turn_a.dot(a).dot(self.turn_b.dot(b)) for w, a, b in row.products)
                        for row in rows.directions
                    ]
                    + [self.turn_a.dot(a).dot(gap) for a in rows.offsets]
                )
            )
        if rows.distance is not None:
            parts.append(np.array([(gap.dot(gap) - rows.distance**2) / (2 * rows.distance)]))
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def jacobian(self) -> Array:
        rows, gap = self.loop.rows, self.p_b - self.p_a
        parts = [self.basis.dot(self.j_a - self.j_b)]
        if self.oriented:
            turning = self.s_a[3:] - self.s_b[3:]
            for row in rows.directions:
                normal = sum(w * np.cross(self.turn_a @ a, self.turn_b @ b) for w, a, b in row.products)
                parts.append((normal @ turning)[None])
            for a in rows.offsets:
                along = self.turn_a @ a
                parts.append((along @ (self.j_b - self.j_a) + np.cross(along, gap) @ self.s_a[3:])[None])
        if rows.distance is not None:
            parts.append((gap @ (self.j_b - self.j_a) / rows.distance)[None])
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def jacobian_rate(self, spatial_rate: Array, v_free: Array, carried: Array | None) -> Array:
        """d/dt of `jacobian`; `carried` is C's spatial velocity, taken out of the columns' rate."""
        rows, gap = self.loop.rows, self.p_b - self.p_a
        r_a, r_b = spatial_rate * self.loop.path_a, spatial_rate * self.loop.path_b
        if carried is not None:
            r_a, r_b = r_a - _motion_cross(carried, self.s_a), r_b - _motion_cross(carried, self.s_b)
        v_a, v_b = self.j_a.dot(v_free), self.j_b.dot(v_free)
        k_a = r_a[:3] - _skew(v_a).dot(self.s_a[3:]) - _skew(self.p_a).dot(r_a[3:])
        k_b = r_b[:3] - _skew(v_b).dot(self.s_b[3:]) - _skew(self.p_b).dot(r_b[3:])
        parts = [self.basis.dot(k_a - k_b)]
        if self.oriented:
            w_a, w_b = self.s_a[3:] @ v_free, self.s_b[3:] @ v_free
            turning, turning_rate = self.s_a[3:] - self.s_b[3:], r_a[3:] - r_b[3:]
            for row in rows.directions:
                normal, normal_rate = np.zeros(3), np.zeros(3)
                for weight, a_local, b_local in row.products:
                    a, b = self.turn_a @ a_local, self.turn_b @ b_local
                    normal += weight * np.cross(a, b)
                    normal_rate += weight * (np.cross(np.cross(w_a, a), b) + np.cross(a, np.cross(w_b, b)))
                parts.append((normal_rate @ turning + normal @ turning_rate)[None])
            for a_local in rows.offsets:
                a = self.turn_a @ a_local
                a_rate = np.cross(w_a, a)
                arm_rate = np.cross(a_rate, gap) + np.cross(a, v_b - v_a)
                parts.append(
                    (
                        a_rate @ (self.j_b - self.j_a)
                        + a @ (k_b - k_a)
                        + arm_rate @ self.s_a[3:]
                        + np.cross(a, gap) @ r_a[3:]
                    )[None]
                )
        if rows.distance is not None:
            parts.append((((v_b - v_a) @ (self.j_b - self.j_a) + gap @ (k_b - k_a)) / rows.distance)[None])
        return parts[0] if len(parts) == 1 else np.concatenate(parts)


def _skew(p: Array) -> Array:
    x, y, z = p
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _motion_cross(velocity: Array, columns: Array) -> Array:
    """The spatial cross product of a (linear, angular) velocity with the columns of a 6×n′ matrix."""
    turn = _skew(velocity[3:])
    return np.vstack([turn @ columns[:3] + _skew(velocity[:3]) @ columns[3:], turn @ columns[3:]])


def _polynomial(coefficients: Array, x: float) -> float:
    total = 0.0
    for c in coefficients[::-1]:
        total = total * x + float(c)
    return total


def _derivative(coefficients: Array) -> Array:
    return coefficients[1:] * np.arange(1, len(coefficients))


def _common_divisor(ratios: list[Fraction]) -> float:
    """The largest number of which every ratio is a whole multiple (0 without ratios)."""
    denominator = math.lcm(*(r.denominator for r in ratios))
    return math.gcd(*(int(r * denominator) for r in ratios)) / denominator


def _resolve_gear(tree: Tree, coupling: Coupling) -> _Gear:
    """Place a coupling; where a continuous joint takes part the row is read modulo what whole turns add to it.

    Raises:
        UnsupportedMechanismError: A continuous joint enters with a power above one or an irrational ratio: the
            relation then depends on the number of turns, which a configuration on the circle does not hold.
    """
    model, terms, ratios = tree.model, [], []
    for term in coupling.terms:
        joint = model.getJointId(term.joint)
        wrapped = tree.joint(term.joint).kind.unit == 2
        if wrapped:
            slope = term.coefficients[1] if len(term.coefficients) > 1 else 0.0
            ratio = Fraction(slope).limit_denominator(1000)
            if any(term.coefficients[2:]) or abs(float(ratio) - slope) > 1e-12:
                raise UnsupportedMechanismError(
                    f"coupling '{coupling.name}': joint '{term.joint}' is continuous, so its ratio must be a "
                    "fraction of whole numbers up to 1000; make the joint revolute for any other relation"
                )
            ratios.append(ratio)
        terms.append(
            _GearTerm(
                int(model.idx_qs[joint]),
                int(model.idx_vs[joint]),
                wrapped,
                np.array(term.coefficients, dtype=np.float64),
                term.reference,
            )
        )
    return _Gear(coupling, tuple(terms), 2 * math.pi * _common_divisor(ratios))
