"""One interval Newton: existence and uniqueness of σ over boxes, and of points (a parametric Krawczyk operator).

Theorem K and the corollary of gluing are stated and proved in `ccpin/proof/theorems/boxes.md`, the contraction lemma in
`extended.md`. Boxes are proposed elsewhere; their inequalities are checked here: Y, Z and Z̄ from `bounds`, (K1) and
(K2) in `verify`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, inverses, rows_of, solve_many
from ccpin.errors import ConvergenceError
from ccpin.proof.bounds import Bounds, Frame, reach_bounds
from ccpin.proof.chains import ClosureSystem, derivatives
from ccpin.proof.equations import Problem, closure_values
from ccpin.proof.phasors import phasor_values, planar_bounds
from ccpin.proof.rounding import SLACK, blur, widened

_POWERS = 8
_ROUNDED = 1e-9  # room in κ for bounds computed in another order (the compiled core's)


class Boxes(NamedTuple):
    """B certified boxes, exactly the data of Theorem K.

    Attributes:
        centre: θ_c, of shape (B, n′).
        half: h, of shape (B, p).
        directions: D, of shape (B, n′, p).
        modes: V, of shape (B, m, m).
        preconditioner: Ã, of shape (B, m, m).
        radius: R, of shape (B, m).
        weight: w, of shape (B, m).
        kappa: κ, of shape (B,).
    """

    centre: Array
    half: Array
    directions: Array
    modes: Array
    preconditioner: Array
    radius: Array
    weight: Array
    kappa: Array

    def take(self, index: Indices | Mask) -> Boxes:
        """The boxes chosen by an index or a mask; these themselves where a mask has all."""
        return self if index.dtype == np.bool_ and index.all() else rows_of(self, index)

    def without_rows(self, p: int) -> Boxes:
        """No boxes (B = 0), with p parameters."""
        none = rows_of(self, slice(0))
        return none._replace(half=np.zeros((0, p)), directions=np.zeros((0, self.centre.shape[1], p)))


def bounds_of(problem: Problem, boxes: Boxes, modes: Array | None = None) -> Bounds:
    """The bounds that Theorem K needs, for boxes as given (h is widened here), or with another E (B, n′, m)."""
    system, theta = problem.system, boxes.centre
    if modes is None:
        modes = np.zeros((*theta.shape, system.m))
        modes[:, system.dependent] = boxes.modes
    half = widened(measured_from(system, boxes), boxes.half)
    frame = Frame(boxes.preconditioner, boxes.directions, modes, half, system.rounding * system.magnitude(theta))
    if problem.phasors is not None:
        return planar_bounds(problem.phasors, phasor_values(problem.phasors, theta), frame)
    return reach_bounds(problem.stack, theta, derivatives(system, problem.stack, theta), frame)


def measured_from(system: ClosureSystem, boxes: Boxes) -> Array:
    """What the parameters δ are measured from, for `widened`: q_c, of shape (B, n), where they are those of q-space.

    Else |θ_c| at most, of shape (B, 1).
    """
    if boxes.half.shape[1] == system.n:
        return np.asarray(boxes.centre[:, system.independent])
    return np.asarray(np.abs(boxes.centre).max(axis=1, keepdims=True))


def verify(problem: Problem, boxes: Boxes) -> Mask:
    """Check (K1) and (K2) for boxes as they are, from scratch; of shape (B,)."""
    with np.errstate(all="ignore"):
        return inequalities_hold(bounds_of(problem, boxes), boxes)


def inequalities_hold(bounds: Bounds, boxes: Boxes) -> Mask:
    """(K1) and (K2) with these bounds, of shape (B,)."""
    radius, weight = boxes.radius, boxes.weight
    image = bounds.y + bounds.mean(radius).of(radius)
    shrunk = bounds.contraction(radius, weight).of(weight)
    inside = np.all(image * SLACK < radius, axis=1)
    contracts = np.all(shrunk * SLACK <= boxes.kappa[:, None] * weight, axis=1)
    finite = np.isfinite(image + shrunk).all(axis=1) & (boxes.kappa < 1.0)
    return np.asarray(inside & contracts & finite & np.all(weight > 0.0, axis=1))


def weights_for(bounds: Bounds, radius: Array) -> tuple[Array, Array]:
    """A w > 0 with Zw ≤ κw, κ < 1 where the spectral radius allows it, from w = (I − M)⁻¹(1 + t(1)) by power steps.

    The inequality is checked with the factors that (K2) is, so where κ < 1 the spectral radius of Z is proved to be.

    Returns:
        w, of shape (B, m), and κ, of shape (B,).
    """
    image = bounds.contraction(radius, np.ones_like(radius))
    weight = np.abs(solve_many(np.eye(radius.shape[1]) - image.matrix, 1.0 + image.rest))
    best, kappa = np.ones_like(radius), np.full(len(radius), np.inf)
    active = np.arange(len(radius))
    for _ in range(_POWERS):
        weight = weight / weight.max(axis=1, keepdims=True)
        shrunk = bounds.contraction(radius[active], weight).of(weight)
        best[active], kappa[active] = weight, (shrunk / weight).max(axis=1) * SLACK * SLACK + _ROUNDED
        going = np.flatnonzero(~(kappa[active] < 1.0))
        if not going.size:
            break
        weight, active, bounds = 0.5 * (weight + shrunk)[going], active[going], bounds.take(going)
    return best, kappa


_MOST_STEPS = 20000


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


UNIT = 2.0**-53
_RADII = (2.0, 8.0, 64.0)


def proved_within(
    value: Array, slope: Array, weight: Array, rounding: Array, drift: Callable[[Indices, Array], Array]
) -> Array:
    """The r of the lemma at B points, of shape (B,); NaN where none of those tried will do.

    Args:
        value: F(x₀), of shape (B, unknowns).
        slope: F′(x₀), of shape (B, unknowns, unknowns).
        weight: By how much the rounding of φ counts in F, of shape (B,).
        rounding: The rounding error of the entries of F′, of the shape of `slope`.
        drift: Δ of some of the points for radii, (K, unknowns, unknowns) for (K,) and (K,).
    """
    inverse, count = inverses(slope), slope.shape[1]
    size = np.abs(inverse)
    wrong = np.broadcast_to((weight * (rounding.max(axis=(1, 2)) + 4.0 * UNIT))[:, None], value.shape)
    wrong = wrong + 8.0 * count * UNIT * np.abs(value)
    left = np.max(np.abs(apply(inverse, value)) + apply(size, wrong), axis=1)
    defect = np.abs(np.eye(count) - inverse @ slope) + size @ (rounding + 8.0 * count * UNIT * np.abs(slope))
    found, rows = np.full(len(slope), np.nan), np.flatnonzero(np.isfinite(left))
    for factor in _RADII:
        radius = factor * left[rows]
        kappa = (defect[rows] + size[rows] @ drift(rows, radius)).sum(axis=2).max(axis=1)
        proved = (left[rows] * SLACK + kappa * SLACK * radius < radius) & (kappa * SLACK < 1.0)
        found[rows[proved]] = radius[proved]
        rows = rows[~proved]
        if not rows.size:
            break
    return found
