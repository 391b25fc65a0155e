"""Bounds of the second and third derivatives of ψ over a box of tangent steps, from link lengths alone.

A box is all q′ = b ⊕ v with |v_i| ≤ V_i, b one configuration; derivatives are those of v ↦ ψ(b ⊕ v). A point fixed in
the last body of a chain is x = e₁ c₁ e₂ c₂ … x₀, e_j = exp of joint j's own twist and c_j constant placements. Let
joint j turn by ω_j and slide by s_j at most. By Duhamel's formula, D^k exp(A)[B, …, B] is k! times the integral over
t₀ + … + t_k = 1 (a simplex of volume 1/k!) of e^{t₀A} B e^{t₁A} B … e^{t_kA}, so that, e^{tA} being an isometry and B x
of length ω|x| + s at most, the k-th derivative of e_j at a point moves it by at most ω^{k−1}(ωX + s), X bounding the
distance of what e_j carries from its axis (from its centre, for a ball). That holds for a revolute joint, a slide
(ω = 0), a ball, a planar joint and a free one alike, and of directions with X = 1, s = 0. With Leibniz's rule, from the
tip to the root,

    f_j = ω_j X_j + s_j,                        X_j = |distance at b| + Y′ of the joints below + s_j,
    Y′ ← Y′ + f_j,     Y″ ← Y″ + 2 ω_j Y′ + ω_j f_j,     Y‴ ← Y‴ + 3 ω_j Y″ + 3 ω_j² Y′ + ω_j² f_j:

|D^k x[v, …, v]| ≤ Y^(k) wherever |v| ≤ V. Rows of φ are sums of products of such vectors, couplings polynomials of
joints, and bounds of both follow by Leibniz's rule and Taylor's. Coordinates q that are whole joints are linear in v.
Those that are components of a rotation vector r = log(R_refᵀ R) obey, while |r| + ω < π, |D²r| ≤ 3.1 ω² and
|D³r| ≤ 9.1 ω³: with J = J_r(r)⁻¹ = I + ½[r]× + c(θ)[r]×², θ = |r|, c(θ) = 2 Σ ζ(2k) θ^{2k−2}/(2π)^{2k} ≤ (1/12)/(1 − z)
coefficient by coefficient, z = θ²/4π² ≤ ¼, so |DJ| ≤ ½ + 2cθ + c′θ² ≤ 1.43, |D²J| ≤ 2c + 5c′θ + c″θ² ≤ 0.77, |J| ≤ π/2,
and the angular velocity along a straight line of the chart has derivatives of at most ω²/2 and ω³/3.

All bounds are polynomials in V with coefficients that are not negative: they grow with V, and are convex.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices
from ccpin.description.closure_kinds import Fixed, Gap, Vector
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.coordinates import IndependentCoordinates

_LOG_SECOND, _LOG_THIRD = 3.1, 9.1  # of |D²r|/ω² and |D³r|/ω³ (above)


class Lengths(NamedTuple):
    """Distances at the configuration that boxes are about.

    Attributes:
        arms: Of each end's point from the axes of the joints on its path, of shape (2 L, depth).
        gaps: |p_B − p_A|, of shape (L,).
        turned: |r| of the joint of each component coordinate, of shape (n,); 0 for all others.
        slopes: Derivatives of each coupling's terms, second, third, …, one array (orders,) a term.
    """

    arms: Array
    gaps: Array
    turned: Array
    slopes: list[Array]


class DerivativeBounds:
    """Bounds of ψ's derivatives for one mechanism; what does not depend on the configuration is laid out once."""

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates) -> None:
        self.constraints = constraints
        self.coordinates = coordinates
        tree, loops = coordinates.tree, constraints.loops
        size = len(tree.joints) + 1
        self._turning, self._sliding = np.zeros((size, tree.model.nv)), np.zeros((size, tree.model.nv))
        for joint in tree.joints:
            self._sliding[joint.number, joint.v] = joint.kind.slides
            self._turning[joint.number, joint.v] = ~np.array(joint.kind.slides)
        self._ball = np.array([False, *(joint.kind.unit == 4 for joint in tree.joints)])
        paths = [*(loop.path_a for loop in loops), *(loop.path_b for loop in loops)]
        self._chains = np.zeros((len(paths), max(map(len, paths), default=0)), dtype=np.intp)
        for chain, path in zip(self._chains, paths, strict=True):
            chain[: len(path)] = path
        products = [(k, product) for k, loop in enumerate(loops) for row in loop.rows.rows for product in row]
        self._weights = np.array([abs(product.weight) for _, product in products])
        self._left = self._place([(k, product.left) for k, product in products])
        self._right = self._place([(k, product.right) for k, product in products])
        # where each row's products begin in the list of all
        self._starts = np.cumsum([0, *(len(row) for loop in loops for row in loop.rows.rows)], dtype=np.intp)[:-1]
        self._components = [
            (part, joint.number)
            for part in coordinates.parts
            for joint in tree.joints
            if part.component is not None and not part.wraps and joint.v.start == part.v_free.start
        ]

    def _place(self, vectors: list[tuple[int, Vector]]) -> tuple[Indices, Array]:
        """Where each vector stands among: L gaps, L frames A, L frames B, L frames C; and its length (of a gap: 1)."""
        size = len(self.constraints.loops)
        places = [k if isinstance(x, Gap) else k + size * (1 + "ABC".index(x.frame)) for k, x in vectors]
        lengths = [float(np.linalg.norm(x.local)) if isinstance(x, Fixed) else 1.0 for _, x in vectors]
        return np.array(places, dtype=np.intp), np.array(lengths)

    def lengths(self, point: ConstraintValue) -> Lengths:
        """The distances at a configuration."""
        tips, spatial = self.constraints.end_points(point), point.placed.spatial
        moves = spatial[:3].T + np.cross(spatial[3:].T, tips[:, None])
        squares = np.sum(moves**2, axis=2) @ self._turning.T
        arms = np.sqrt(squares / np.where(self._ball, 2.0, 1.0))
        turned = np.zeros(self.coordinates.n)
        for part, _ in self._components:
            if not part.slides[0]:
                turned[part.v] = np.linalg.norm(self.coordinates.rotation_vector(part, point.q_free))
        half = len(self.constraints.loops)
        slopes = [
            np.array([abs(term.slope(k, point.q_free)) for k in range(2, max(4, len(term.coefficients)))])
            for coupling in self.constraints.couplings
            for term in coupling.terms
        ]
        gaps = np.linalg.norm(tips[half:] - tips[:half], axis=1)
        return Lengths(np.take_along_axis(arms, self._chains, axis=1), gaps, turned, slopes)

    def bounds(self, lengths: Lengths, moves: Array) -> tuple[Array, Array]:
        """|D²ψ[v, v]| and |D³ψ[v, v, v]| row by row, wherever |v| ≤ `moves` (B, n′); both of shape (B, m + n).

        The first of a coupling's row is that at the configuration itself.
        """
        turns, slides = moves @ self._turning.T, moves @ self._sliding.T
        if self._ball.any():
            turns = np.where(self._ball, np.sqrt(moves**2 @ self._turning.T), turns)
        found = np.zeros((2, len(moves), self.constraints.size + self.coordinates.n))
        rows = len(self._starts)
        if rows:
            found[:, :, :rows] = self._closures(lengths, turns, slides)
        self._add_couplings(lengths, moves, found[:, :, rows:])
        for part, joint in self._components:
            turn, slide, k = turns[:, joint], slides[:, joint], self.constraints.size + part.v.start
            if part.slides[0]:
                found[:, :, k] = np.array([turn, turn**2]) * (turn * slide + slide)
            else:
                beyond = ~(lengths.turned[part.v.start] + turn < np.pi)
                found[:, :, k] = np.where(beyond, np.inf, np.array([_LOG_SECOND * turn**2, _LOG_THIRD * turn**3]))
        return found[0], found[1]

    def _closures(self, lengths: Lengths, turns: Array, slides: Array) -> Array:
        """Bounds of the closures' rows, of shape (2, B, R)."""
        half = len(lengths.gaps)
        points, turned = self._points(lengths.arms, turns[:, self._chains], slides[:, self._chains])
        opening = points[..., :half] + points[..., half:]
        table = np.zeros((4, len(turns), 4 * half))
        table[0], table[0, :, :half], table[1:, :, :half] = 1.0, lengths.gaps + opening[0], opening
        table[1:, :, half:-half] = [turned, turned**2, turned**3]
        (x, x_1, x_2, x_3), (y, y_1, y_2, y_3) = (table[:, :, at] * length for at, length in (self._left, self._right))
        second = x_2 * y + 2.0 * x_1 * y_1 + x * y_2
        third = x_3 * y + 3.0 * (x_2 * y_1 + x_1 * y_2) + x * y_3
        return np.asarray(np.add.reduceat(self._weights * np.array([second, third]), self._starts, axis=2))

    def _points(self, arms: Array, turns: Array, slides: Array) -> tuple[Array, Array]:
        """Y′, Y″ and Y‴ of the ends' points, of shape (3, B, 2 L), and Σ ω along their paths, of shape (B, 2 L)."""
        points = np.zeros((3, *turns.shape[:2]))
        first, second, third = points
        for j in reversed(range(arms.shape[1])):
            turn, slide = turns[..., j], slides[..., j]
            own = turn * (arms[:, j] + first + slide) + slide
            third += turn * (3.0 * second + turn * (3.0 * first + own))
            second += turn * (2.0 * first + own)
            first += own
        return points, turns.sum(axis=2)

    def _add_couplings(self, lengths: Lengths, moves: Array, rows: Array) -> None:
        """Second derivatives at the configuration; third ones over the box, by Taylor's formula."""
        slopes = iter(lengths.slopes)
        for k, coupling in enumerate(self.constraints.couplings):
            for term in coupling.terms:
                order, move, factor = next(slopes), moves[:, term.idx_v], 1.0
                rows[0, :, k] += order[0] * move**2
                for power, slope in enumerate(order[1:].tolist()):
                    factor *= max(power, 1)
                    rows[1, :, k] += slope * move ** (3 + power) / factor
