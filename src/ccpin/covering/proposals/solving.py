"""Newton's method over batches: at fixed q, and for prolonged systems; boxes glued by it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask, apply, inverses, solve_many
from ccpin.covering.proposals.krawczyk import certify_points
from ccpin.native.certifier import certifier
from ccpin.proof.equations import Derivatives, Problem, closure_values, derivatives
from ccpin.proof.newton import Boxes, encloses, solve_in_boxes, within
from ccpin.proof.prolongations import Prolongation

_LARGEST_STEP = 1.5  # rad, m: a longer one has lost its way
_SETTLED = 1e-7  # rad, m: after it Newton's method has converged
_LOST = 1e-8  # a step after which Newton's next one is lost in rounding
_LONGEST = 0.5  # step in all unknowns together


class Converged(NamedTuple):
    """Configurations θ (B, n′), whether Newton settled (B,), and slopes −φ_y⁻¹φ_q one step before, (B, m, n)."""

    theta: Array
    settled: Mask
    slopes: Array


def newton(problem: Problem, theta: Array, iterations: int, accuracy: float = _SETTLED) -> Converged:
    """Plain Newton steps in the dependent coordinates; settled where the last is below `accuracy`, none above 1.5.

    Convergence is quadratic: after a step of 1e-7 what is left is rounding, or nearly so.
    """
    system = problem.system
    core = certifier(system, problem.phasors)
    if core is not None:
        return Converged(*core.newton(theta, iterations, accuracy))
    theta = theta.copy()
    alive = np.ones(len(theta), dtype=np.bool_)
    settled = np.zeros(len(theta), dtype=np.bool_)
    slopes = np.zeros((len(theta), system.m, system.n))
    for _ in range(iterations):
        rows = np.flatnonzero(alive & ~settled)
        if not rows.size:
            break
        phi, jacobian = closure_values(problem, theta[rows])
        inverse = inverses(jacobian[:, :, system.dependent])
        step = -apply(inverse, phi)
        length = np.max(np.abs(step), axis=1, initial=0.0)
        alive[rows] = length < _LARGEST_STEP
        settled[rows] = length < accuracy
        moving = rows[alive[rows]]
        theta[np.ix_(moving, system.dependent)] += step[alive[rows]]
        slopes[rows] = -inverse @ jacobian[:, :, system.independent]
    return Converged(theta, settled, slopes)


def glued(problem: Problem, first: Boxes, delta: Array, second: Boxes, delta_second: Array) -> Mask:
    """Whether two proved boxes carry the same solution at a common point, given by each one's parameters (gluing).

    The point must lie in both boxes, as widened: a theorem says nothing of another.
    The ball that the contraction of the first box leaves must lie in the second's tube; where it is too large
    for that (near singularities), a fresh certificate at the point must lie in both.
    """
    core = certifier(problem.system, problem.phasors)
    if core is not None:
        return core.glued(tuple(first), delta, tuple(second), delta_second)
    common = within(problem, first, delta) & within(problem, second, delta_second)
    found = solve_in_boxes(problem, first, delta)
    same = encloses(problem, second, delta_second, found.theta, found.error, first.modes)
    rows = np.flatnonzero(~same)
    if rows.size:
        point = certify_points(problem, found.theta[rows])
        ball = point.boxes.centre, point.boxes.radius, point.boxes.modes
        in_first = encloses(problem, first.take(rows), delta[rows], *ball)
        same[rows] = point.proved & in_first & encloses(problem, second.take(rows), delta_second[rows], *ball)
    return np.asarray(same & common)


def extrapolate(problem: Problem, theta: Array, steps: Array) -> Array:
    """θ (n′,) moved by steps (B, n) of q along the linearized closures, of shape (B, n′)."""
    system = problem.system
    jacobian = closure_values(problem, theta[None])[1]
    slope = -(inverses(jacobian[:, :, system.dependent]) @ jacobian[:, :, system.independent])[0]
    moved = np.tile(theta, (len(steps), 1))
    moved[:, system.independent] += steps
    moved[:, system.dependent] += steps @ slope.T
    return moved


def closure_derivatives(problem: Problem, theta: Array) -> Derivatives:
    """φ, φ_θ and φ_θθ at θ (B, n′), each entry within γ · magnitude."""
    core = certifier(problem.system, problem.phasors)
    if core is not None:
        return Derivatives(*core.derivatives(theta))
    return derivatives(problem, theta)


def solved(problem: Problem, equations: Prolongation, x: Array, steps: int) -> Array:
    """Newton's method for a prolonged system, its steps shortened to at most 0.5 in any unknown."""
    x, active = x.copy(), np.arange(len(x))
    for _ in range(steps):
        part = equations.take(active)
        point = part.at(x[active], lambda theta: closure_derivatives(problem, theta))
        step = -solve_many(part.slope(point), part.value(point))
        length = np.max(np.abs(step), axis=1)
        going = np.isfinite(length)
        step, length, active = step[going], length[going], active[going]
        x[active] += step * np.minimum(1.0, _LONGEST / np.maximum(length, 1e-300))[:, None]
        active = active[length > _LOST * (1.0 + np.abs(x[active]).max(axis=1))]
        if not active.size:
            break
    return x
