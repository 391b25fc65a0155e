"""Cusps: closed configurations proved to exist about which three solutions y over one q come together.

Setting. θ = (q, y) as in `boxes`, n = 2, and l a fixed row vector. In x = (q, y, v, w) ∈ ℝ³ᵐ⁺²

    F(x) = (φ(q, y),  φ_y v,  lv − 1,  φ_yy v v + φ_y w,  lw) = 0

says that y(t) = y + vt + ½wt² fulfils φ(q, y(t)) = O(t³): the solutions over q touch to second order, and
φ_y is singular.

**Theorem C.** Where the lemma of `extended` holds for F at x₀ with r, exactly one x within r of x₀ has F(x) = 0, and
there the projection (q, y) ↦ q of the closed configurations is a cusp in Whitney's sense: after smooth changes of q and
of the configurations near it, it reads (a, t) ↦ (a, t³ + at). So

1. the image of the singular configurations near it is a cuspidal curve; the q within its point have three solutions
   near the cusp's configuration, the q outside of it one;
2. the nonsingular ones among the configurations near it with outside it and on the two outer sheets within are
   connected: a path in q about the cusp's point, from a q within to that q again, leads from one outer solution to the
   other and meets no singular configuration.

*Proof.* The lemma says that there is one solution, and that F′ is nonsingular there. Then ker φ_y is spanned by v: a
k ≠ 0 with φ_y k = 0, lk = 0 would make w ↦ k a kernel of F′. By Lyapunov and Schmidt's reduction (y = vt + y⊥(q, t),
l y⊥ = 0) the closed configurations near it are the zeros of
one smooth g(q, t), and F = 0 reads g = g_t = g_tt = 0. F′ is nonsingular exactly if the derivative of (g, g_t, g_tt)
by (q, t) is, that is if g_ttt ≠ 0 and g_q, g_tq are independent: a versal unfolding of t³ (Whitney 1955; Golubitsky
and Schaeffer, "Singularities and groups in bifurcation theory I", 1985). 2 is read off t³ + at = b: for a path
about (0, 0) in the plane of (a, b) that begins and ends at a < 0, b = 0, the root followed is the largest at one
end and the least at the other and is simple all along. ∎

Δ. With τ_i bounding every third and fourth derivative of φ_i on the ball (`ccpin.proof.reach_bounds.chain_reach`; a
derivative of a chain's tip of any order is at most ρ of its deepest joint), P = n′ and V = |v₀|₁ + mr,

    |φ_θθ − φ_θθ(θ₀)| ≤ τPr,     |φ_θ − φ_θ(θ₀)| ≤ (|φ_θθ(θ₀)|1 + τP²r) r,
    |φ_θθv − φ_θθ(θ₀)v₀| ≤ |φ_θθ(θ₀)|1 r + τPrV,     likewise for w,
    |φ_θθθvv − φ_θθθ(θ₀)v₀v₀| ≤ τ(PV² + 2mV) r.

Rounding: γ · magnitude for every entry of φ and its first two derivatives and twice that for the third, times 1 +
|v₀|₁, 1 + |w₀|₁ and |v₀|₁² where they enter.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, apply, records, rows_of
from ccpin.covering.proposals.solving import closure_derivatives, solved
from ccpin.covering.region import Corners, corners_of
from ccpin.domain.closures.system import Reading, reading_of
from ccpin.domain.singular.sampled import SingularCurve, singularities
from ccpin.mechanism.mechanism import HasMechanism, Mechanism, mechanism_of
from ccpin.proof.equations import Derivatives, Problem, third_bound
from ccpin.proof.newton import proved_within, without_turns
from ccpin.proof.tips import third_along

_STEPS = 40
_SAME = 1e-6


class Cusp(NamedTuple):
    """A cusp that is proved (Theorem C of `ccpin.domain.cusps`).

    Attributes:
        q: The independent coordinates, of shape (2,), in the scalar coordinates of certificates.
        q_free: The configuration, of shape (nq,).
        kernel: v: how the dependent coordinates move where q stands still, of shape (m,).
        error: The exact one is this near in every coordinate (rad, m).
    """

    q: Array
    q_free: Array
    kernel: Array
    error: float


class _CuspPoint(NamedTuple):
    """x and what F needs there, of B points."""

    theta: Array
    v: Array
    w: Array
    values: Derivatives

    def take(self, rows: Indices) -> _CuspPoint:
        return _CuspPoint(self.theta[rows], self.v[rows], self.w[rows], rows_of(self.values, rows))


class _CuspEquations:
    """F about B singular configurations, with l of each (B, m)."""

    def __init__(self, problem: Problem, pairing: Array) -> None:
        self.problem, self.pairing = problem, pairing
        system = problem.system
        self.n, self.m = system.n, system.m
        self.order = np.concatenate([system.independent, system.dependent])

    def take(self, rows: Indices) -> _CuspEquations:
        return _CuspEquations(self.problem, self.pairing[rows])

    def start(self, theta: Array) -> Array:
        """x with v the weakest direction and the w that fits best."""
        system, values = self.problem.system, closure_derivatives(self.problem, theta)
        slope = values.jacobian[:, :, system.dependent]
        bent = _along(values.hessian, self._whole(self.pairing))[:, :, system.dependent]
        tall = np.concatenate([slope, self.pairing[:, None]], axis=1)
        right = np.concatenate([-apply(bent, self.pairing), np.zeros((len(theta), 1))], axis=1)
        return np.concatenate([theta[:, self.order], self.pairing, apply(np.linalg.pinv(tall), right)], axis=1)

    def at(self, x: Array) -> _CuspPoint:
        size = self.n + self.m
        theta = np.empty((len(x), size))
        theta[:, self.order] = x[:, :size]
        values = closure_derivatives(self.problem, theta)
        return _CuspPoint(theta, x[:, size : size + self.m], x[:, size + self.m :], values)

    def value(self, point: _CuspPoint) -> Array:
        dependent = self.problem.system.dependent
        slope = point.values.jacobian[:, :, dependent]
        bent = _along(point.values.hessian, self._whole(point.v))[:, :, dependent]
        paired = [
            np.sum(self.pairing * point.v, axis=1, keepdims=True) - 1.0,
            np.sum(self.pairing * point.w, 1)[:, None],
        ]
        third = apply(bent, point.v) + apply(slope, point.w)
        return np.concatenate([point.values.phi, apply(slope, point.v), paired[0], third, paired[1]], axis=1)

    def slope(self, point: _CuspPoint) -> Array:
        system, stack = self.problem.system, self.problem.stack
        v, w = self._whole(point.v), self._whole(point.w)
        jacobian, bent = point.values.jacobian, _along(point.values.hessian, v)
        curled = apply(third_along(system, stack, point.theta, v), v[:, None]) + _along(point.values.hessian, w)
        result = self._assembled(jacobian, bent, curled)
        first = self.n + self.m
        result[:, 2 * self.m, first : first + self.m] = self.pairing
        result[:, -1, first + self.m :] = self.pairing
        return result

    def _assembled(self, jacobian: Array, bent: Array, curled: Array) -> Array:
        """The blocks of F′ from φ_θ, φ_θθv and φ_θθθvv + φ_θθw, without the rows of l."""
        m, size = self.m, self.n + self.m
        slope = jacobian[:, :, self.problem.system.dependent]
        result = np.zeros((len(jacobian), 3 * m + 2, 3 * m + 2))
        result[:, :m, :size] = jacobian[:, :, self.order]
        result[:, m : 2 * m, :size] = bent[:, :, self.order]
        result[:, m : 2 * m, size : size + m] = slope
        result[:, 2 * m + 1 : -1, :size] = curled[:, :, self.order]
        result[:, 2 * m + 1 : -1, size : size + m] = 2.0 * bent[:, :, self.problem.system.dependent]
        result[:, 2 * m + 1 : -1, size + m :] = slope
        return result

    def drift(self, point: _CuspPoint, radius: Array) -> Array:
        """Δ for radii (B,)."""
        size, m, r = self.n + self.m, self.m, radius[:, None, None]
        third = self._third(point, radius)[:, :, None]
        hessian = np.abs(point.values.hessian)
        total, partial = hessian.sum(axis=3), hessian[..., self.problem.system.dependent].sum(axis=3)
        v, w = (np.abs(u).sum(axis=1)[:, None, None] + m * r for u in (point.v, point.w))
        turned = (total + third * size**2 * r) * r
        bent = partial * r + third * size * r * v
        curled = third * (size * v**2 + 2.0 * m * v) * r + partial * r + third * size * r * w
        return self._assembled(turned, bent, curled)

    def rounding(self, point: _CuspPoint) -> Array:
        """The rounding error of the entries of F′, of shape (B, 3m + 2, 3m + 2)."""
        unit = np.broadcast_to(self._margin(np.abs(point.theta))[:, None, None], point.values.jacobian.shape)
        v, w = (1.0 + np.abs(u).sum(axis=1)[:, None, None] for u in (point.v, point.w))
        return self._assembled(unit, unit * v, unit * (2.0 * v**2 + w))

    def _margin(self, reach: Array) -> Array:
        return self.problem.system.rounding * self.problem.system.magnitude(reach)

    def _third(self, point: _CuspPoint, radius: Array) -> Array:
        """τ, of shape (B, m)."""
        box = np.tile(radius[:, None], point.theta.shape[1])
        return third_bound(self.problem, point.theta, point.values.arms, box)

    def _whole(self, y: Array) -> Array:
        """Dependent coordinates (B, m) among all of them, (B, n′)."""
        whole = np.zeros((len(y), self.n + self.m))
        whole[:, self.problem.system.dependent] = y
        return whole


def _along(hessian: Array, v: Array) -> Array:
    """φ_θθ v, of shape (B, m, n′)."""
    return np.asarray((hessian @ v[:, None, :, None])[..., 0])


def cusps(
    mechanism: Mechanism | HasMechanism,
    region: Corners | None = None,
    *,
    curves: Sequence[SingularCurve] | None = None,
) -> tuple[Cusp, ...]:
    """The cusps on curves of folds, each proved to exist.

    That there are no others is not claimed: a curve that is not given has cusps of its own.

    Args:
        mechanism: With n = 2, plain scalar joints and no redundant rows; hold joints still with ``load(locked=…)`` for
            a slice of a mechanism with more.
        region: (lower, upper), bounds of the coordinates within which they are wanted, each of shape (2,).
        curves: From `singularities`; by default all that it finds.

    Raises:
        UnsupportedMechanismError: As for `singularities`.
        InvalidInputError: The region is malformed.
    """
    mechanism = mechanism_of(mechanism)
    given = singularities(mechanism) if curves is None else records(curves, "curves", SingularCurve)
    folds = [curve for curve in given if curve.kind == "fold"]
    reading = reading_of(mechanism, mechanism.q_reference).bounded("reach")
    found: list[Cusp] = []
    for curve in folds:
        theta = np.array([reading.theta(q_free) for q_free in curve.q_free])
        found += proved_cusps(reading, theta[_turning(reading.problem, theta, curve.closed)])
    low, high = (
        (np.full(2, -np.inf), np.full(2, np.inf)) if region is None else corners_of(region, mechanism.independent)
    )
    return distinct(reading, [cusp for cusp in found if np.all((cusp.q >= low) & (cusp.q <= high))])


def distinct(reading: Reading, found: Sequence[Cusp]) -> tuple[Cusp, ...]:
    """Each cusp once: those that agree modulo 2π, or may by what they are off by, are the same."""
    kept: list[Cusp] = []
    for cusp in found:
        if not any(_same(reading, cusp, other) for other in kept):
            kept.append(cusp)
    return tuple(kept)


def _same(reading: Reading, one: Cusp, other: Cusp) -> bool:
    gap = reading.theta(one.q_free) - reading.theta(other.q_free)
    gap = without_turns(gap, reading.system.periodic)
    return bool(np.abs(gap).max() < max(_SAME, one.error + other.error))


def _turning(problem: Problem, theta: Array, closed: bool) -> Array:
    """Where along a curve of folds the second-order term uᵀφ_yy v v changes its sign, beside both points."""
    values = closure_derivatives(problem, theta)
    dependent = problem.system.dependent
    left, _, right = np.linalg.svd(values.jacobian[:, :, dependent])
    u, v = left[:, :, -1], right[:, -1]
    bent = np.einsum("bm,bmij,bi,bj->b", u, values.hessian[:, :, dependent][..., dependent], v, v)
    following = np.roll(np.arange(len(theta)), -1)
    # u and v are known up to their signs: turn each pair along the one before; bent changes with u only
    kept = np.sign(np.sum(u * u[following], axis=1))
    changes = bent * bent[following] * kept < 0.0
    if not closed:
        changes[-1] = False
    at = np.flatnonzero(changes)
    return np.unique(np.concatenate([at, following[at]]))


def proved_cusps(reading: Reading, theta: Array) -> list[Cusp]:
    """The cusps that Newton's method finds from singular configurations θ (B, n′) and Theorem C proves."""
    if not len(theta):
        return []
    problem, independent = reading.problem, reading.system.independent
    slope = closure_derivatives(problem, theta).jacobian[:, :, problem.system.dependent]
    equations = _CuspEquations(problem, np.linalg.svd(slope)[2][:, -1])
    with np.errstate(all="ignore"):
        point = equations.at(solved(equations, equations.start(theta), _STEPS))
        error = _proved_within(equations, point)
    return [
        Cusp(point.theta[k, independent], reading.configuration(point.theta[k]), point.v[k], float(error[k]))
        for k in np.flatnonzero(np.isfinite(error))
    ]


def _proved_within(equations: _CuspEquations, point: _CuspPoint) -> Array:
    """The r of Theorem C, of shape (B,); NaN where none of those tried will do."""
    weight = 1.0 + np.abs(point.v).sum(axis=1) + np.abs(point.w).sum(axis=1)

    def drift(rows: Indices, radius: Array) -> Array:
        return equations.take(rows).drift(point.take(rows), radius)

    return proved_within(equations.value(point), equations.slope(point), weight, equations.rounding(point), drift)
