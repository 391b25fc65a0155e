"""Singular configurations that are proved to exist: what refutes a claim that σ is nonsingular.

A line through q-space is followed to the image of a fold; that one is there is Theorem S of
`ccpin/proof/theorems/folds.md`, of which the kernel makes facts (`ccpin.proof.zeros`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask
from ccpin.covering.claims import proved_zeros
from ccpin.covering.proposals.solving import closure_derivatives
from ccpin.proof.equations import Problem, closure_values, closures_of
from ccpin.proof.facts import Fact
from ccpin.proof.prolongations import Prolongation
from ccpin.proof.zeros import SingularPoints

_STEPS, _STEPS_AHEAD = 40, 8  # of Newton's method: where nothing is known, and from where a fold is expected


class SearchedLines(NamedTuple):
    """B searches for a singular configuration along lines q = q₀ + s d.

    Attributes:
        theta: θ where they ended, of shape (B, n′).
        along: s there, of shape (B,).
        kernel: w, of shape (B, m).
        error: r: where proved, an exact singular configuration of the line has s, y and w within r, of shape (B,).
        proved: Of shape (B,).
        fact: About those that are proved, in their order.
    """

    theta: Array
    along: Array
    kernel: Array
    error: Array
    proved: Mask
    fact: Fact


def singular_points(problem: Problem, theta: Array, directions: Array, ahead: FoldAhead | None = None) -> SearchedLines:
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
    lines = Prolongation(closures_of(problem), theta[:, system.independent], directions[:, :, None], weak)
    x, error, fact = proved_zeros(problem, SingularPoints, lines, np.concatenate([along, y, weak], axis=1), steps)
    return SearchedLines(lines.theta(x), x[:, 0], x[:, 1 + system.m :], error, np.isfinite(error), fact)


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
