"""A proof that two configurations are joined by the lift of one straight line: what σ promises, without an estimate.

**Theorem.** Let b be a configuration with ψ_q′(b) of full column rank, A = ψ_q′(b)⁺, and a another one. Write
Ψ(v) = ψ(b ⊕ v), v a tangent step, and coordinates that are whole joints as tangent steps from those of b. Let
g = ψ(a) ⊖ ψ(b), p = A g and M = A D²Ψ(0)[p, ·], and let k(E) and t(V) bound |D²Ψ(0)[e, e]| where |e| ≤ E, and
|D³Ψ(v)[v, v, v]| where |v| ≤ V, row by row and as symmetric forms whose coefficients are not negative
(`derivative_bounds`). Put

    P(E) = ½ |M p| + |M| E + |A| (½ k(E) + ⅙ t(|p| + E)).

If for some E > 0 (i) P(E) ≤ E and (ii) P(5E/4) − P(E) < E/4, component by component, then for every τ in [0, 1] there
is exactly one configuration b ⊕ (τp + e), |e| ≤ E, with A(Ψ(v) − Ψ(0) − τg) = 0; ψ_q′ has full column rank on the whole
tube |v − τp| ≤ E; and the configurations found form one smooth curve that begins at b. So if a = b ⊕ (p + e) with
|e| ≤ E, it ends at a.

The same holds in any orthonormal basis Q of tangent steps, e = Q y: with QᵀA, QᵀMQ, boxes |y| ≤ E, and k and t taken
where |e| ≤ |Q|E. Q's first two directions are taken as those in which ψ_q′⁻¹ is largest: boxes along the axes would mix
them with all others.

*Proof.* F_τ(v) = A(Ψ(v) − Ψ(0) − τg) has F_τ(0) = −τp and F_τ′(0) = I. By Taylor's formula, at v = τp + e,

    F_τ(v) − e = ½ τ² M p + τ M e + ½ A D²Ψ(0)[e, e] + R,        |R| ≤ ⅙ |A| t(|p| + E),

at most P(E) in all, so by (i) e ↦ e − F_τ(τp + e) maps the box |e| ≤ E into itself. Its derivative, applied to any
w with |w| ≤ E, is at most |M|E + |A|(k(E) + ½ t̄), t̄ the form of t taken twice at |p| + E and once at E: the derivative
of P along E, which by P's convexity is at most 4(P(5E/4) − P(E)), less than E by (ii). It is a contraction in the norm
max |e_i|/E_i: the zero exists, is unique, and F_τ′ is invertible on the tube, so that ψ_q′ has full column rank there.
By the implicit function theorem the zero depends smoothly on τ. For τ = 0 it is b (e = 0), for τ = 1 it is a. ∎

Where ψ is square, A(Ψ(v) − Ψ(0) − τg) = 0 says ψ = ψ(b) + τg. Where φ holds redundant rows it says so of the closed
configurations near b, which are a manifold of dimension n there, φ having constant rank: the lift exists as long as
it stays in the tube, and it cannot leave it. σ asks with a and b closed: then φ = 0 all along, q runs straight from
α(a) to α(b), and b is what a is continued to. An open a is joined to b likewise, along a straight line of ψ.

**Rounding.** a and b are closed up to rounding, and A, p, M are computed. With ε the tolerance of closed points and
what is left of ψ̄, γ = 32 u per column and J = |ψ_q′| + |D²Ψ(0)[p, ·]|, the sum |A|(ε + γ J (|p| + E)) is added to P: it
covers the residuals, and by the error analysis of Gaussian elimination (Higham, Accuracy and Stability of Numerical
Algorithms, 2002, sec. 9.3, without growth of the pivots) the defect of A. The evaluation of P itself, on numbers that
are not negative, is covered by a factor 1 + 1e-9. These margins are stated, not proved.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from ccpin.arrays import Array
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.derivative_bounds import DerivativeBounds
from ccpin.kinematics.linear import Factor

_ROUNDOFF = 32 * 2.0**-53  # γ a column: 32 units of roundoff (Rounding, above)
_MARGIN = 1.0 + 1e-9  # on P as evaluated (Rounding, above)
_TRIES = 8  # boxes E, each the image of the one before, inflated
_INFLATION = 1.2  # of an image: (i) asks for P(E) ≤ E
_LARGEST = 4.0  # rad or m: longer ways and larger boxes are not tried


class Continuation:
    """The theorem for one ψ; a pure function of two configurations.

    Args:
        constraints, coordinates: φ and α.
        tolerance: Largest |ψ̄| of what counts as closed, metres and radians.

    Attributes:
        reaches: k and t.
        unstructured: B (`_unstructured`).
    """

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates, tolerance: float) -> None:
        self.constraints = constraints
        self.coordinates = coordinates
        self.tolerance = tolerance
        self.reaches = DerivativeBounds(constraints, coordinates)
        self.unstructured = _unstructured(constraints.size, coordinates)

    def proved(self, start: ConstraintValue, end: ConstraintValue, factor: Factor, off: float) -> bool:
        """Whether the lift of the straight line from ψ(start) to ψ(end) through `end` is proved to begin at `start`.

        Args:
            start: φ and φ_q′ at a.
            end: The same at b.
            factor: The factorised ψ_q′(b).
            off: Largest |ψ̄| left at the end, metres and radians.
        """
        coordinates, model = self.coordinates, self.constraints.model
        missing = coordinates.difference(coordinates.alpha(end.q_free), coordinates.alpha(start.q_free))
        way = factor.solve(np.concatenate([start.phi - end.phi, missing]))
        if not np.all(np.abs(way) <= _LARGEST):
            return False
        majorant = _Majorant(self, end, factor, way, off)
        apart = pin.difference(model, end.q_free, start.q_free) - way
        return majorant.holds(np.abs(majorant.basis.T @ apart))

    def bend(self, at: ConstraintValue, step: Array) -> Array:
        """D²Ψ(0)[step, ·], of shape (m + n, n′), the chart centred at a configuration.

        Right increments do not commute: what φ_q′ gains along a step differs from it by ½ φ_q′ [step, ·].
        """
        jacobian, rate = at.jacobian, self.constraints.rate(at, step)
        alpha = self.coordinates.component_jacobian(at.q_free)
        alpha_rate = self.coordinates.jacobian_rate(at.q_free, step)
        own = np.concatenate([rate, np.zeros_like(alpha) if alpha_rate is None else alpha_rate])
        brackets = self._brackets(step)
        return own if brackets is None else own - 0.5 * np.concatenate([jacobian, alpha]) @ brackets

    def _brackets(self, step: Array) -> Array | None:
        """w ↦ [step, w], joint by joint, of shape (n′, n′); ``None`` where all steps commute."""
        balls = [joint for joint in self.coordinates.tree.joints if joint.kind.unit and joint.kind.nv > 1]
        if not balls:
            return None
        brackets = np.zeros((len(step), len(step)))
        for joint in balls:
            entries = joint.kind.entries
            brackets[joint.v, joint.v] = pin.Motion(joint.kind.twist(step[joint.v])).action[np.ix_(entries, entries)]
        return brackets


def _unstructured(rows: int, coordinates: IndependentCoordinates) -> Array:
    """B, two right sides of ψ_q′ without structure, of shape (rows + n, 2); zero in the rows of whole joints.

    Their columns are known, so that ψ_q′⁻¹ B is what solves the others' equations alone. How near to a singular
    configuration σ answers is told by |ψ_q′⁻¹ B|, so whatever computes σ takes this one B.
    """
    whole = np.zeros(rows + coordinates.n, dtype=bool)
    for part in coordinates.parts:
        whole[rows + part.v.start : rows + part.v.stop] = part.component is None
    B, chaotic = np.zeros((len(whole), 2)), 0.5
    for place, row in enumerate(np.flatnonzero(~whole)):
        for column, turned in enumerate((place % 2, place // 2 % 2)):
            chaotic = 3.9 * chaotic * (1.0 - chaotic)
            B[row, column] = chaotic + 0.1 if turned else -chaotic - 0.1
    return B


class _Majorant:
    """P, with its rounding."""

    def __init__(self, theory: Continuation, end: ConstraintValue, factor: Factor, way: Array, off: float) -> None:
        bend, inverse = theory.bend(end, way), factor.solve(np.eye(theory.constraints.size + theory.coordinates.n))
        self.basis = np.linalg.qr(inverse @ theory.unstructured, mode="complete")[0]
        along, turned = self.basis.T @ inverse, bend @ self.basis
        self.change = np.abs(along @ turned)
        self.constant = 0.5 * np.abs(along @ (bend @ way))
        self.inverse = np.abs(along)
        self.spread, self.way = np.abs(self.basis), np.abs(way)
        jacobian = np.concatenate([end.jacobian, theory.coordinates.jacobian(end.q_free)])
        self.rounding = _ROUNDOFF * len(way) * (np.abs(jacobian) + np.abs(bend))
        self.closed = theory.tolerance + off
        self.reaches = theory.reaches
        self.lengths = theory.reaches.lengths(end)

    def __call__(self, radii: Array) -> Array:
        """P of each E, of shape (B, n′)."""
        moves = radii @ self.spread.T
        count, boxes = len(radii), self.way + moves
        bounds = self.reaches.bounds(self.lengths, np.concatenate([moves, boxes]))
        if not np.all(np.isfinite(bounds)):  # a rotation vector may reach π
            return np.full_like(radii, np.inf)
        rest = 0.5 * bounds[0][:count] + bounds[1][count:] / 6.0 + self.closed + boxes @ self.rounding.T
        return np.asarray(_MARGIN * (self.constant + radii @ self.change.T + rest @ self.inverse.T))

    def holds(self, apart: Array) -> bool:
        """Whether (i) and (ii) hold for some E that is nowhere less than `apart`."""
        radius = self._supposed(apart)
        if radius is None:
            return False
        for _ in range(_TRIES):
            image, beyond = self(np.array([radius, 1.25 * radius]))
            if not np.all(beyond <= _LARGEST):
                return False
            if np.all(image <= radius):
                return bool(np.all(beyond - image < 0.25 * radius / _MARGIN**2))
            radius = np.maximum(_INFLATION * image, radius)
        return False

    def _supposed(self, apart: Array) -> Array | None:
        """What E is likely to be: the solution without its quadratic terms, and some; ``None`` where there is none."""
        least = self(np.zeros((1, len(apart))))[0]
        if not np.all(np.isfinite(least)):
            return None
        _, _, radius, info = lapack.dgesv(np.eye(len(least)) - self.change, least)
        return np.maximum(_INFLATION * radius, apart) if info == 0 and np.all(radius >= 0.0) else None
