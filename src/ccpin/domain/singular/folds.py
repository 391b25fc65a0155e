"""Singular configurations that are proved to exist: what refutes a claim that σ is nonsingular.

A line through q-space is followed to the image of a fold; that one is there is Theorem S of
`ccpin/proof/theorems/folds.md`, whose F and bounds are computed here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, rows_of
from ccpin.covering.proposals.solving import closure_derivatives, solved
from ccpin.proof.equations import Derivatives, Problem, closure_values, third_bound
from ccpin.proof.newton import proved_within

_STEPS, _STEPS_AHEAD = 40, 8


class SingularPoints(NamedTuple):
    """B searches for a singular configuration along lines q = q₀ + s d.

    Attributes:
        theta: θ where they ended, of shape (B, n′).
        along: s there, of shape (B,).
        kernel: w, of shape (B, m).
        error: r: where proved, an exact singular configuration of the line has s, y and w within r, of shape (B,).
        proved: Of shape (B,).
    """

    theta: Array
    along: Array
    kernel: Array
    error: Array
    proved: Mask


class _FoldPoint(NamedTuple):
    """x and what F needs there, of B points."""

    theta: Array
    kernel: Array
    values: Derivatives

    def take(self, rows: Indices) -> _FoldPoint:
        return _FoldPoint(self.theta[rows], self.kernel[rows], rows_of(self.values, rows))


class _System:
    """F along B lines."""

    def __init__(self, problem: Problem, origin: Array, directions: Array, pairing: Array) -> None:
        self.problem, self.origin, self.directions, self.pairing = problem, origin, directions, pairing

    def take(self, rows: Indices) -> _System:
        return _System(self.problem, self.origin[rows], self.directions[rows], self.pairing[rows])

    def at(self, x: Array) -> _FoldPoint:
        system, m = self.problem.system, self.problem.system.m
        theta = np.empty((len(x), system.n_free))
        theta[:, system.independent] = self.origin + x[:, :1] * self.directions
        theta[:, system.dependent] = x[:, 1 : m + 1]
        return _FoldPoint(theta, x[:, m + 1 :], closure_derivatives(self.problem, theta))

    def value(self, point: _FoldPoint) -> Array:
        slope = point.values.jacobian[:, :, self.problem.system.dependent]
        paired = np.sum(self.pairing * point.kernel, axis=1, keepdims=True) - 1.0
        return np.concatenate([point.values.phi, apply(slope, point.kernel), paired], axis=1)

    def columns(self, matrices: Array) -> Array:
        """The derivatives by s and y of what has the derivatives `matrices` (B, m, n′) by θ, of shape (B, m, 1 + m)."""
        system = self.problem.system
        along = apply(matrices[:, :, system.independent], self.directions)
        return np.concatenate([along[..., None], matrices[:, :, system.dependent]], axis=2)

    def slope(self, point: _FoldPoint) -> Array:
        system, m = self.problem.system, self.problem.system.m
        bent = (point.values.hessian[..., system.dependent] @ point.kernel[:, None, :, None])[..., 0]
        slope = np.zeros((len(point.theta), 2 * m + 1, 2 * m + 1))
        slope[:, :m, : m + 1] = self.columns(point.values.jacobian)
        slope[:, m:-1, : m + 1] = self.columns(bent)
        slope[:, m:-1, m + 1 :] = point.values.jacobian[:, :, system.dependent]
        slope[:, -1, m + 1 :] = self.pairing
        return slope

    def drift(self, point: _FoldPoint, radius: Array) -> tuple[Array, Array]:
        """Δ for radii (B,), and the rounding error of F′'s entries, of shape (B, 2m + 1, 2m + 1) each."""
        system, m = self.problem.system, self.problem.system.m
        moves = np.ones((len(radius), system.n_free))
        moves[:, system.independent] = np.abs(self.directions)
        box = radius[:, None] * moves
        margin = system.rounding * system.magnitude(np.abs(point.theta) + box)
        third = third_bound(self.problem, point.theta, point.values.arms, box) * box.sum(axis=1, keepdims=True)
        bent = np.abs(point.values.hessian)
        weight = np.abs(point.kernel).sum(axis=1)
        turned = apply(bent + third[:, :, None, None], box[:, None])
        curled = bent[..., system.dependent].sum(axis=3) * radius[:, None, None]
        curled += third[:, :, None] * (weight + m * radius)[:, None, None]
        drift, rounding = np.zeros((2, len(radius), 2 * m + 1, 2 * m + 1))
        sized = _System(self.problem, self.origin, np.abs(self.directions), self.pairing)
        unit = np.broadcast_to(margin[:, None, None], turned.shape)
        for target, plain, crossed in ((drift, turned, curled), (rounding, unit, unit * (1.0 + weight)[:, None, None])):
            target[:, :m, : m + 1], target[:, m:-1, : m + 1] = sized.columns(plain), sized.columns(crossed)
            target[:, m:-1, m + 1 :] = plain[:, :, system.dependent]
        return drift, rounding


def singular_points(
    problem: Problem, theta: Array, directions: Array, ahead: FoldAhead | None = None
) -> SingularPoints:
    """Look for singular configurations along lines from approximate closed configurations, and prove those found.

    Args:
        problem: The closures.
        theta: Where to start, of shape (B, n′).
        directions: d, of shape (B, n).
        ahead: Where they are expected (`Folds.along`): fewer steps are spent. Default: nothing is known.
    """
    system = problem.system
    y = theta[:, system.dependent]
    if ahead is None:
        weak, along, steps = Folds.near(problem, theta).weak, np.zeros((len(theta), 1)), _STEPS
    else:
        weak, along, y, steps = ahead.weak, ahead.along[:, None], y + ahead.aside, _STEPS_AHEAD
    equations = _System(problem, theta[:, system.independent], directions, weak)
    x = np.concatenate([along, y, weak], axis=1)
    with np.errstate(all="ignore"):
        x = solved(equations, x, steps)
        point = equations.at(x)
        error = _proved_within(equations, point)
    return SingularPoints(point.theta, x[:, 0], point.kernel, error, np.isfinite(error))


class FoldAhead(NamedTuple):
    """Where B lines are expected to cross the fold: s (B,), the move of y (B, m) and w (B, m)."""

    along: Array
    aside: Array
    weak: Array


class Folds(NamedTuple):
    """The fold that is near each of B closed configurations θ, from one singular value decomposition of φ_y.

    With φ_y w = σ u, σ the smallest singular value: φ(q + s d, y + α w) along u is σα + ½ b α² + a s to second order,
    b = uᵀφ_yy w w and a = uᵀφ_q d. Its double root is the fold: α = −σ/b, s = σ²/(2ab).

    Attributes:
        left, weak: u and w, of shape (B, m); zero where φ is not finite.
        value: σ, of shape (B,).
        slope: uᵀφ_q, the normal of the fold's image, of shape (B, n).
    """

    left: Array
    weak: Array
    value: Array
    slope: Array

    @classmethod
    def near(cls, problem: Problem, theta: Array) -> Folds:
        """Of θ (B, n′)."""
        system = problem.system
        jacobian = closure_values(problem, theta)[1]
        inner = jacobian[:, :, system.dependent]
        usable = np.isfinite(inner).all(axis=(1, 2))
        left, weak, value = np.zeros((len(theta), system.m)), np.zeros((len(theta), system.m)), np.zeros(len(theta))
        u, values, w = np.linalg.svd(inner[usable])
        left[usable], weak[usable], value[usable] = u[:, :, -1], w[:, -1], values[:, -1]
        slope = np.zeros((len(theta), system.n))
        slope[usable] = (u[:, None, :, -1] @ jacobian[usable][:, :, system.independent])[:, 0]
        return cls(left, weak, value, slope)

    def directions(self) -> Array:
        """Lines to search along: across the fold, then along each coordinate, of shape (1 + n, B, n)."""
        normal = self.slope / np.maximum(np.linalg.norm(self.slope, axis=1, keepdims=True), 1e-300)
        return np.stack([normal, *(np.tile(row, (len(normal), 1)) for row in np.eye(normal.shape[1]))])

    def bending(self, problem: Problem, theta: Array) -> Array:
        """b, of shape (B,)."""
        system = problem.system
        with np.errstate(all="ignore"):
            bent = closure_derivatives(problem, theta).hessian[:, :, system.dependent][..., system.dependent]
            curved = (bent @ self.weak[:, None, :, None])[..., 0] @ self.weak[:, :, None]
            bending: Array = np.sum(self.left * curved[..., 0], axis=1)
        return bending

    def along(self, bending: Array, directions: Array) -> FoldAhead:
        """Where lines along directions (B, n) meet the fold, by b (B,); infinite where they run beside it."""
        with np.errstate(all="ignore"):
            across = np.sum(self.slope * directions, axis=1)
            return FoldAhead(
                self.value**2 / (2.0 * across * bending), -(self.value / bending)[:, None] * self.weak, self.weak
            )


def _proved_within(equations: _System, point: _FoldPoint) -> Array:
    """The r of Theorem S, of shape (B,); NaN where none of those tried will do."""
    slope = equations.slope(point)
    rounding = equations.drift(point, np.zeros(len(slope)))[1]
    weight = 1.0 + np.abs(point.kernel).sum(axis=1)

    def drift(rows: Indices, radius: Array) -> Array:
        return equations.take(rows).drift(point.take(rows), radius)[0]

    return proved_within(equations.value(point), slope, weight, rounding, drift)
