"""Newton's method and the certified iteration at fixed q, over batches of configurations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask, apply, rows_of
from ccpin.domain.boxes import Boxes, Problem, certify_points, closure_values, inverses, measured_from, solve_many
from ccpin.domain.in_core import certifier
from ccpin.errors import ConvergenceError
from ccpin.proof.rounding import SLACK, blur, widened

_LARGEST_STEP = 1.5
_SETTLED = 1e-7
_MOST_STEPS = 20000


class Converged(NamedTuple):
    """Configurations θ (B, n′), whether Newton settled (B,), and slopes −φ_y⁻¹φ_q one step before, (B, m, n)."""

    theta: Array
    settled: Mask
    slopes: Array


class EnclosedSolution(NamedTuple):
    """A solution at fixed q of each of B proved boxes: |ζ* − ζ| ≤ error in the box's modes.

    Attributes:
        theta: The configuration at ζ, of shape (B, n′).
        zeta: ζ, of shape (B, m).
        error: Of shape (B, m).
    """

    theta: Array
    zeta: Array
    error: Array


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


def predict(problem: Problem, boxes: Boxes, delta: Array, zeta: Array | None = None) -> Array:
    """θ_c + Dδ + Eζ, of shape (B, n′), for parameters δ (B, p) and modes ζ (B, m; default 0)."""
    theta = boxes.centre + apply(boxes.directions, delta)
    if zeta is not None:
        theta[:, problem.system.dependent] += apply(boxes.modes, zeta)
    return theta


def solve_in_boxes(problem: Problem, boxes: Boxes, delta: Array) -> EnclosedSolution:
    """σ at parameters |δ| ≤ h of B proved boxes; it cannot fail.

    A Newton step is taken where it stays in the tube and lowers ‖f‖ (in the box's norm) at least by κ, the step
    ζ ← K(ζ) where it does not. K keeps the tube and contracts by κ (Theorem K), so ‖f(ζ)‖ = ‖ζ − K(ζ)‖ falls by κ at
    least in every step, until rounding; then ‖ζ − ζ*‖ ≤ ‖f(ζ)‖/(1 − κ).
    """
    active = np.arange(len(delta))
    zeta, size = np.zeros_like(boxes.radius), np.empty(len(delta))
    margin = _rounding(problem, boxes)
    here, at = boxes, zeta
    now = _evaluate(problem, here, delta, at)
    for _ in range(_MOST_STEPS):
        size[active], zeta[active] = now.size, at
        going = now.size > margin[active]
        if not np.any(going):
            error = (SLACK * (size + margin) / (1.0 - boxes.kappa))[:, None] * boxes.weight
            return EnclosedSolution(predict(problem, boxes, delta, zeta), zeta, error)
        active, here, at = active[going], here.take(going), at[going]
        now = rows_of(now, going)
        at, now = _step(problem, here, delta[active], at, now)
    raise ConvergenceError("the certified iteration did not reach rounding: a box was altered since it was proved")


class _Evaluation(NamedTuple):
    """f (B, m), ‖f‖ (B,) and the Newton step in ζ (B, m)."""

    residual: Array
    size: Array
    step: Array


def _evaluate(problem: Problem, boxes: Boxes, delta: Array, zeta: Array) -> _Evaluation:
    phi, jacobian = closure_values(problem, predict(problem, boxes, delta, zeta))
    residual = apply(boxes.preconditioner, phi)
    slope = boxes.preconditioner @ jacobian[:, :, problem.system.dependent] @ boxes.modes
    return _Evaluation(residual, np.max(np.abs(residual) / boxes.weight, axis=1), -solve_many(slope, residual))


def _step(problem: Problem, boxes: Boxes, delta: Array, zeta: Array, now: _Evaluation) -> tuple[Array, _Evaluation]:
    trial = zeta + now.step
    inside = np.all(np.abs(trial) <= boxes.radius, axis=1)
    trial = np.where(inside[:, None], trial, zeta - now.residual)
    after = _evaluate(problem, boxes, delta, trial)
    worse = np.flatnonzero(inside & ~(after.size <= boxes.kappa * now.size))
    if worse.size:
        trial[worse] = zeta[worse] - now.residual[worse]
        again = _evaluate(problem, boxes.take(worse), delta[worse], trial[worse])
        for array, new in zip(after, again, strict=True):
            array[worse] = new
    return trial, after


def _rounding(problem: Problem, boxes: Boxes) -> Array:
    """The rounding error of ‖f‖ in the boxes' norms, of shape (B,)."""
    gain = np.max(np.abs(boxes.preconditioner).sum(axis=2) / boxes.weight, axis=1)
    reach = np.abs(boxes.centre) + apply(np.abs(boxes.directions), boxes.half)
    return np.asarray(gain * problem.system.rounding * problem.system.magnitude(reach))


def without_turns(gap: Array, periodic: Mask) -> Array:
    """Differences (…, k) without the whole turns of those of the k coordinates that are periodic."""
    return np.asarray(gap - np.where(periodic, 2.0 * np.pi * np.round(gap / (2.0 * np.pi)), 0.0))


def within(problem: Problem, boxes: Boxes, delta: Array) -> Mask:
    """Whether parameters δ (B, p) are of the boxes that their theorem is about, of shape (B,)."""
    return np.asarray(np.all(np.abs(delta) <= widened(measured_from(problem.system, boxes), boxes.half), axis=1))


def encloses(
    problem: Problem, boxes: Boxes, delta: Array, theta: Array, error: Array, modes: Array | None = None
) -> Mask:
    """Whether solutions known as θ + modes · [−error, error] (dependent coordinates) lie in the boxes' tubes at δ.

    Periodic coordinates are compared modulo 2π; 1e-13 is allowed for rounding, and what δ may be off by. Near
    singularities an error is large in one direction and must be small in the others, so it may be given (B, m) in modes
    (B, m, m; default I).
    """
    system = problem.system
    gap = (theta - predict(problem, boxes, delta))[:, system.dependent]
    gap = without_turns(gap, system.periodic[system.dependent])
    inverse = inverses(boxes.modes)
    rounding = 1e-13 * (1.0 + np.abs(theta[:, system.dependent]))
    rounding += apply(np.abs(boxes.directions[:, system.dependent]), blur(delta))
    reach = np.abs(apply(inverse, gap)) + apply(np.abs(inverse), rounding)
    spread = inverse if modes is None else inverse @ modes
    reach += apply(np.abs(spread), error)
    return np.asarray(np.all(reach * SLACK <= boxes.radius, axis=1))


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
