"""Singular configurations that are proved to exist: what refutes a claim that σ is nonsingular.

Setting. θ = (q, y) as in `boxes`, a line q = q₀ + s d in the space of the independent coordinates, and l the unit
vector of the smallest singular value of φ_y at the start of the search. In x = (s, y, w) ∈ ℝ²ᵐ⁺¹

    F(x) = (φ(q₀ + s d, y),  φ_y(q₀ + s d, y) w,  lᵀw − 1) = 0        (Moore and Spence 1980)

says that (q₀ + s d, y) is a closed configuration whose φ_y has w in its kernel. It is regular where the line crosses
the image of a fold.

**Theorem S.** Let A be any real matrix, η ≥ |A F(x₀)| and, with Δ ≥ |F′(x) − F′(x₀)| for all ‖x − x₀‖ ≤ r (maximum
norm), κ ≥ ‖ |I − A F′(x₀)| + |A|Δ ‖. If η + κr < r there is exactly one x within r of x₀ with F(x) = 0.

*Proof.* x ↦ x − A F(x) maps that ball into its interior and contracts it by κ < 1; A is nonsingular since
‖I − A F′(x₀)‖ < 1, so its fixed point solves F = 0. ∎

Δ is crude, as r is some 1e-9: with p = (|d|, 1) and P = Σp bounding the moves of θ for ‖x − x₀‖ ≤ 1, τ_i = Σ_c
‖(B_c)_i‖ max_j ρ_cj bounding every third derivative of φ_i on the ball (`bounds_reach.chain_reach`),

    |φ_θθ − φ_θθ(θ₀)| ≤ τPr,    |φ_θ − φ_θ(θ₀)| ≤ (|φ_θθ(θ₀)| + τPr) p r,
    |φ_θθw − φ_θθ(θ₀)w₀| ≤ |φ_θθ(θ₀)|1 r + τPr(|w₀|₁ + mr).

Rounding: γ · magnitude for every entry of φ and its derivatives, times 1 + |w₀|₁ where w enters.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply
from ccpin.domain.bounds_reach import chain_reach
from ccpin.domain.boxes import SLACK, Problem, closure_values, inverses
from ccpin.domain.chain_stack import Derivatives, derivatives, gather

_STEPS = 40
_SETTLED = 1e-13
_LONGEST = 0.5
_RADII = (2.0, 8.0, 64.0)
_UNIT = 2.0**-53


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


class _Point(NamedTuple):
    """x and what F needs there, of B points."""

    theta: Array
    kernel: Array
    values: Derivatives


class _System:
    """F along B lines."""

    def __init__(self, problem: Problem, origin: Array, directions: Array, pairing: Array) -> None:
        self.problem, self.origin, self.directions, self.pairing = problem, origin, directions, pairing

    def take(self, rows: Indices) -> _System:
        return _System(self.problem, self.origin[rows], self.directions[rows], self.pairing[rows])

    def at(self, x: Array) -> _Point:
        system, m = self.problem.system, self.problem.system.m
        theta = np.empty((len(x), system.n_free))
        theta[:, system.independent] = self.origin + x[:, :1] * self.directions
        theta[:, system.dependent] = x[:, 1 : m + 1]
        return _Point(theta, x[:, m + 1 :], derivatives(system, self.problem.stack, theta))

    def value(self, point: _Point) -> Array:
        slope = point.values.jacobian[:, :, self.problem.system.dependent]
        paired = np.sum(self.pairing * point.kernel, axis=1, keepdims=True) - 1.0
        return np.concatenate([point.values.phi, apply(slope, point.kernel), paired], axis=1)

    def columns(self, matrices: Array) -> Array:
        """The derivatives by s and y of what has the derivatives `matrices` (B, m, n′) by θ, of shape (B, m, 1 + m)."""
        system = self.problem.system
        along = apply(matrices[:, :, system.independent], self.directions)
        return np.concatenate([along[..., None], matrices[:, :, system.dependent]], axis=2)

    def slope(self, point: _Point) -> Array:
        system, m = self.problem.system, self.problem.system.m
        bent = (point.values.hessian[..., system.dependent] @ point.kernel[:, None, :, None])[..., 0]
        slope = np.zeros((len(point.theta), 2 * m + 1, 2 * m + 1))
        slope[:, :m, : m + 1] = self.columns(point.values.jacobian)
        slope[:, m:-1, : m + 1] = self.columns(bent)
        slope[:, m:-1, m + 1 :] = point.values.jacobian[:, :, system.dependent]
        slope[:, -1, m + 1 :] = self.pairing
        return slope

    def drift(self, point: _Point, radius: Array) -> tuple[Array, Array]:
        """Δ for radii (B,), and the rounding error of F′'s entries, of shape (B, 2m + 1, 2m + 1) each."""
        system, stack, m = self.problem.system, self.problem.stack, self.problem.system.m
        moves = np.ones((len(radius), system.n_free))
        moves[:, system.independent] = np.abs(self.directions)
        box = radius[:, None] * moves
        margin = system.rounding * system.magnitude(np.abs(point.theta) + box)
        reach = chain_reach(stack, point.values.arms, gather(stack, np.abs(point.theta)), gather(stack, box), margin)
        gains = np.swapaxes(np.linalg.norm(stack.weights, axis=2), 0, 1)
        third = reach.max(axis=2, initial=0.0) @ gains.T * box.sum(axis=1, keepdims=True)
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


def singular_points(problem: Problem, theta: Array, directions: Array) -> SingularPoints:
    """Look for singular configurations along lines from approximate closed configurations, and prove those found.

    Args:
        problem: The closures.
        theta: Where to start, of shape (B, n′).
        directions: d, of shape (B, n).
    """
    system, m = problem.system, problem.system.m
    slope = closure_values(problem, theta)[1][:, :, system.dependent]
    usable = np.isfinite(slope).all(axis=(1, 2))
    weak = np.zeros((len(theta), m))
    weak[usable] = np.linalg.svd(slope[usable])[2][:, -1]
    equations = _System(problem, theta[:, system.independent], directions, weak)
    x = np.concatenate([np.zeros((len(theta), 1)), theta[:, system.dependent], weak], axis=1)
    with np.errstate(all="ignore"):
        x = _solved(equations, x)
        point = equations.at(x)
        error = _proved_within(equations, point)
    return SingularPoints(point.theta, x[:, 0], point.kernel, error, np.isfinite(error))


def fold_directions(problem: Problem, theta: Array) -> Array:
    """Lines to search along from θ (B, n′): across the fold that is near, then along each coordinate, (1 + n, B, n).

    The normal of a fold's image is uᵀφ_q, u the left singular vector of φ_y's smallest singular value.
    """
    system = problem.system
    jacobian = closure_values(problem, theta)[1]
    left = np.linalg.svd(jacobian[:, :, system.dependent])[0][:, :, -1]
    normal = (left[:, None] @ jacobian[:, :, system.independent])[:, 0]
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    return np.stack([normal, *(np.tile(row, (len(theta), 1)) for row in np.eye(system.n))])


def _solved(equations: _System, x: Array) -> Array:
    """Newton's method, its steps shortened to at most 0.5 in any unknown."""
    x, active = x.copy(), np.arange(len(x))
    for _ in range(_STEPS):
        part = equations.take(active)
        point = part.at(x[active])
        step = -apply(inverses(part.slope(point)), part.value(point))
        length = np.max(np.abs(step), axis=1)
        going = np.isfinite(length)
        step, length, active = step[going], length[going], active[going]
        x[active] += step * np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))[:, None]
        active = active[length > _SETTLED * (1.0 + np.abs(x[active]).max(axis=1))]
        if not active.size:
            break
    return x


def _proved_within(equations: _System, point: _Point) -> Array:
    """The r of Theorem S, of shape (B,); NaN where none of those tried will do."""
    slope = equations.slope(point)
    inverse = inverses(slope)
    size = np.abs(inverse)
    drift, rounding = equations.drift(point, np.zeros(len(slope)))
    weight = 1.0 + np.abs(point.kernel).sum(axis=1)
    value, count = equations.value(point), slope.shape[1]
    wrong = np.broadcast_to((weight * (rounding.max(axis=(1, 2)) + 4.0 * _UNIT))[:, None], value.shape)
    wrong = wrong + 8.0 * count * _UNIT * np.abs(value)
    left = np.max(np.abs(apply(inverse, value)) + apply(size, wrong), axis=1)
    defect = np.abs(np.eye(count) - inverse @ slope) + size @ (rounding + 8.0 * count * _UNIT * np.abs(slope))
    found = np.full(len(slope), np.nan)
    for factor in _RADII:
        radius = factor * left
        drift = equations.drift(point, radius)[0]
        kappa = (defect + size @ drift).sum(axis=2).max(axis=1)
        proved = (left * SLACK + kappa * SLACK * radius < radius) & (kappa * SLACK < 1.0)
        found = np.where(np.isnan(found) & proved, radius, found)
    return found
