"""Which Newton step stays on its branch: a proof, not an estimate.

Let x be a configuration with ψ̄(x, q) = g (11), ψ_q′ regular there with (approximate) inverse Y, u = −Y g Newton's
step, and G_s(e) = ψ̄(x ⊕ e, q) − (1 − s) g for s in [0, 1]: from a closed x its zeros lie over the straight line from
α(x) to q, from an open one φ and the way to q vanish together. Bounds of |ψ″| and |ψ‴| over the boxes below are those
of `ccpin.kinematics.curvature`; all inequalities are by component.

*Theorem.* (i) If |u| + ½|Y| sup|ψ″[r, r]| ≤ r and |Y| sup|ψ″[r, r]| < r over the box B = {|e| ≤ r}, or (ii) if with
N = Y ψ″(x)[u, ·], r = |u| + ε and a w > 0

    ½|N u| + |N| ε + ½|Y| sup|ψ″[ε, ε]| + ⅙|Y| sup|ψ‴[r, r, r]| ≤ ε,
    |N| w + |Y| sup|ψ″[ε, w]| + ½|Y| sup|ψ‴[r, r, w]| < w,         B = {s u + e: 0 ≤ s ≤ 1, |e| ≤ ε},

then ψ_q′ is regular in all of B, and there is one continuous path e(s) in B with e(0) = 0 and G_s(e(s)) = 0; for each
s, e(s) is the only zero in B (in its slice at s, under (ii)).

*Proof.* e ↦ e − Y G_s(e) = s u − Y(ψ(x ⊕ e) − ψ(x) − ψ_q′(x) e) maps B (its slice) into itself, by the first
inequality and Taylor's formula, and contracts in the maximum norm weighted by r (by w), by the second: its derivative
1 − Y ψ_q′ has norm below one, so ψ_q′ is regular, Banach's theorem gives the zero, and it is continuous in s. Where ψ
is tall, Y its pseudo-inverse, e(s) is analytic and solves all rows of ψ̄ if the linkage has n freedoms around x.

So the zero at s = 1 is σ(q) on the branch of x. This is the Newton–Kantorovich theorem with (i) Krawczyk's box, (ii)
the second derivative along the step taken as it is, so that Lipschitz constants enter in second order only. It holds up
to rounding, which is not enclosed: Y is an inverse to about eps/rcond (the factor 0.98 below stands for that), and |Y|
times the tolerance of closed points is added to |u| and to ½|N u|.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, skew
from ccpin.kinematics.constraints import Constraints, ConstraintValue
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.curvature import Curvature, Levers
from ccpin.kinematics.linear import Factor
from ccpin.kinematics.tree import TreeJoint

_BELOW_ONE = 0.98
_ROUNDS = 5
_TRIALS = 8
_LIKELY = 0.55


class Proof(NamedTuple):
    """What is proven of a Newton step.

    Attributes:
        part: Which part of the step stays on its branch: 1 all of it, 0 none that is worth while.
        likely: Which part of it a next step of its kind may well have, 2 at most.
        centre, radius: The box that holds the solution at its end and no other, as displacements, of shape (n′,).
    """

    part: float
    likely: float
    centre: Array
    radius: Array

    def holds(self, displacement: Array) -> bool:
        """Whether a solution is the one proven."""
        return bool(np.all(np.abs(displacement - self.centre) <= self.radius))


class Branches:
    """Proves Newton steps of one mechanism.

    Args:
        constraints: φ.
        coordinates: α.
        tolerance: Largest |ψ̄| of a configuration taken for closed.
    """

    def __init__(self, constraints: Constraints, coordinates: IndependentCoordinates, tolerance: float) -> None:
        self._constraints, self._coordinates, self._tolerance = constraints, coordinates, tolerance
        self._curvature = Curvature(constraints, coordinates)
        joints = coordinates.tree.joints
        self._curved = [joint for joint in joints if joint.kind.unit and joint.kind.nv > 1]

    def prove(self, at: ConstraintValue, factor: Factor, step: Array) -> Proof:
        """How much of a Newton step from a configuration stays on its branch."""
        inverse = factor.inverse()
        start = _Start(at, self._curvature, self._curvature.levers(at), np.abs(inverse))
        noise = start.size @ np.full(start.size.shape[1], self._tolerance)
        u = np.abs(step) + noise
        bent = 2.0 * start.second(u)
        radius = u + bent
        if np.all(bent <= 4.0 * u.max()):
            grown = start.second(radius)
            if np.all(grown <= _BELOW_ONE * radius) and np.all(0.5 * grown <= bent):
                return Proof(1.0, 2.0, np.zeros_like(u), radius)
        turning = inverse @ self._rate(at, step)
        bend, sag = self._straightened(turning, step), 0.5 * np.abs(turning @ step)
        size = np.abs(bend)
        likely = _LIKELY / max(_growth(size, u), 0.5 * _LIKELY)
        part = 1.0 if likely > 0.6 else likely
        for _ in range(_TRIALS):
            found = _tube(start, part * u, part * size, part**2 * sag + noise)
            if found is not None:
                return Proof(part, likely, part * step, found)
            part *= 0.6
        return Proof(0.0, 0.0, step, u)

    def _rate(self, at: ConstraintValue, step: Array) -> Array:
        """ψ̇_q′ along a step, of shape (m + n, n′)."""
        alpha = self._coordinates.jacobian_rate(at.q_free, step)
        rows = self._constraints.rate(at, step)
        return np.concatenate([rows, np.zeros((self._coordinates.n, len(step))) if alpha is None else alpha])

    def _straightened(self, turning: Array, step: Array) -> Array:
        """Y ψ″[u, ·] in exponential coordinates, from Y ψ̇_q′(u) in which velocities are those of the moving frame."""
        for joint in self._curved:
            turning[joint.v, joint.v] -= 0.5 * _bracket(joint, step[joint.v])
        return turning


class _Start(NamedTuple):
    """Where a step begins: ψ, its bounds, and |Y|."""

    at: ConstraintValue
    curvature: Curvature
    levers: Levers
    size: Array

    def second(self, box: Array) -> Array:
        """|Y| sup|ψ″[r, r]| over a box |e| ≤ r, of shape (n′,)."""
        return np.asarray(self.size @ self.curvature.bounds(self.at, self.levers, box, box[None], box[None])[0][0])

    def remainder(self, box: Array, radius: Array, w: Array, parts: tuple[float, float], third: Array) -> Array:
        """|Y| (parts[0] sup|ψ″[ε, w]| + parts[1] sup|ψ‴[r, r, third]|) over a box |e| ≤ r, of shape (n′,)."""
        along, across = np.stack([radius, box]), np.stack([w, third])
        found = self.curvature.bounds(self.at, self.levers, box, along, across)
        return np.asarray(self.size @ (parts[0] * found[0][0] + parts[1] * found[1][1]))


def _tube(start: _Start, u: Array, bend: Array, sag: Array) -> Array | None:
    """ε of (ii) in the theorem, or ``None`` where none is found: |u|, |N| and ½|N u| + rounding are given."""
    even = np.maximum(u, 0.05 * u.max())
    solved = np.linalg.solve(np.eye(len(u)) - bend, np.stack([1.1 * sag, even], axis=1)).T
    radius, w = np.maximum(solved, [sag, even])  # guesses, right where |N| is small; what counts is tested
    for _ in range(_ROUNDS):
        box = u + radius
        need = sag + bend @ radius + start.remainder(box, radius, radius, (0.5, 1.0 / 6.0), box)
        if np.all(need <= radius):
            return radius if _contracts(start, box, radius, bend, w) else None
        radius = np.maximum(radius, 1.1 * need)
        if not radius.max() <= 3.0 * u.max():
            return None
    return None


def _contracts(start: _Start, box: Array, radius: Array, bend: Array, w: Array) -> bool:
    """Whether the second inequality of (ii) holds, for a w like that given."""
    for _ in range(_ROUNDS):
        image = bend @ w + start.remainder(box, radius, w, (1.0, 0.5), w)
        if np.all(image <= _BELOW_ONE * w):
            return True
        if np.all(image > _BELOW_ONE * w):
            return False
        w = np.maximum(image, 0.5 * w)
    return False


def _growth(matrix: Array, start: Array) -> float:
    """About the spectral radius of a nonnegative matrix."""
    x = start
    for _ in range(4):
        y = matrix @ x
        growth = float(np.linalg.norm(y) / np.linalg.norm(x))
        if not growth > 0.0:
            return 0.0
        x = y
    return growth


def _bracket(joint: TreeJoint, velocity: Array) -> Array:
    """ad_V of a joint's velocity V in its moving frame, over its own components."""
    linear, angular = joint.kind.twist(velocity).reshape(2, 3)
    whole = np.block([[skew(angular), skew(linear)], [np.zeros((3, 3)), skew(angular)]])
    return np.asarray(whole[np.ix_(joint.kind.entries, joint.kind.entries)])
