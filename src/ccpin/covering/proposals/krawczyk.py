"""Boxes of Theorem N, proposed: directions, modes, preconditioner and radii; `ccpin.proof.newton` checks them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Mask, inverses, solve_many
from ccpin.native.certifier import certifier
from ccpin.proof.bounds import Bounds
from ccpin.proof.chains import ClosureSystem
from ccpin.proof.equations import Problem, closure_values
from ccpin.proof.newton import Boxes, bounds_of, holds, weights_for

_INFLATION = 1e-4  # of Y, to begin with
_SETTLED = 1.0 + 1e-6  # room for the roundings of a check elsewhere
_ROUNDS = 30  # of R ← Y + Z̄(R)R
_LEAST, _ROOM = 1e-11, 16.0  # R of boxes to be glued: rad or m, and roundings of f
_LARGEST = 1e6  # R, beside Y: beyond it nothing contracts


class Tried(NamedTuple):
    """Boxes tried, and which of them satisfy Theorem N (the others' numbers mean nothing)."""

    boxes: Boxes
    proved: Mask


def certify_boxes(problem: Problem, centre: Array, half: Array, across: Array) -> Tried:
    """Try to prove boxes about approximate solutions, with V = I and, where that fails, singular vectors.

    Singular vectors help where one direction alone is weak, so they are tried there only (`_one_weak`).

    Args:
        problem: The closures.
        centre: θ_c with φ(θ_c) ≈ 0, of shape (B, n′).
        half: h, of shape (B, p).
        across: The independent rows of D, of shape (n, p) or (B, n, p): I for boxes of q-space.
    """
    core = certifier(problem.system, problem.phasors)
    if core is not None:
        columns, proved = core.certify_boxes(centre, half, across)
        return Tried(Boxes(*columns), proved)
    with np.errstate(all="ignore"):
        jacobian = closure_values(problem, centre)[1]
        first = _attempt(problem, _parametrize(problem.system, centre, half, across, jacobian, False), True)
        failed = np.flatnonzero(~first.proved)
        retry = failed[_one_weak(first.boxes.preconditioner[failed])]
        if not retry.size or problem.system.m == 1:
            return first
        rows = across if across.ndim == 2 else across[retry]
        frames = _parametrize(problem.system, centre[retry], half[retry], rows, jacobian[retry], True)
        second = _attempt(problem, frames, True)
    better = retry[second.proved]
    for array, new in zip(first.boxes, second.boxes, strict=True):
        array[better] = new[second.proved]
    first.proved[better] = True
    return first


def certify_points(problem: Problem, theta: Array) -> Tried:
    """Enclose a solution at fixed q near each θ (B, n′): boxes with p = 0 and V the right singular vectors of φ_y."""
    core = certifier(problem.system, problem.phasors)
    if core is not None:
        columns, proved = core.certify_points(theta)
        return Tried(Boxes(*columns), proved)
    count, system = len(theta), problem.system
    with np.errstate(all="ignore"):
        jacobian = closure_values(problem, theta)[1]
        empty = np.zeros((count, 0))
        boxes = _parametrize(system, theta, empty, np.zeros((system.n, 0)), jacobian, True)
        return _attempt(problem, boxes, False)


def _parametrize(
    system: ClosureSystem, centre: Array, half: Array, across: Array, jacobian: Array, singular: bool
) -> Boxes:
    """D, V and Ã from the Jacobian at the centre; R and w still to be found.

    Right singular vectors of φ_y are eigenvectors of φ_y⁻¹φ_y⁻ᵀ, the weakest direction the most accurate.
    """
    count, m = len(centre), system.m
    dependent = jacobian[:, :, system.dependent]
    inverse = inverses(dependent)
    directions = np.zeros((count, system.n_free, half.shape[1]))
    directions[:, system.independent] = across
    directions[:, system.dependent] = -inverse @ (jacobian[:, :, system.independent] @ across)
    modes = np.broadcast_to(np.eye(m), (count, m, m)).copy()
    if singular:
        usable = np.asarray(np.isfinite(inverse).all(axis=(1, 2)))
        modes[usable] = np.linalg.eigh(_gram(inverse[usable]))[1]
    return Boxes(
        centre=centre.copy(),
        half=half.copy(),
        directions=directions,
        modes=modes,
        preconditioner=np.swapaxes(modes, 1, 2) @ inverse,
        radius=np.zeros((count, m)),
        weight=np.ones((count, m)),
        kappa=np.ones(count),
    )


def _gram(inverse: Array) -> Array:
    """φ_y⁻¹φ_y⁻ᵀ, of shape (B, m, m): its eigenvalues are 1/σ² for the singular values σ of φ_y."""
    return np.asarray(inverse @ np.swapaxes(inverse, 1, 2))


def _one_weak(inverse: Array) -> Mask:
    """Whether one singular value of φ_y is well below all others: Σ 1/σ⁴ ≥ 0.6 (Σ 1/σ²)², of shape (B,)."""
    gram = _gram(inverse)
    return np.asarray(np.sum(gram**2, axis=(1, 2)) >= 0.6 * np.trace(gram, axis1=1, axis2=2) ** 2)


def _attempt(problem: Problem, boxes: Boxes, roomy: bool) -> Tried:
    """Find R and w, then check strictly; a `roomy` R is well above rounding, so that boxes can be glued."""
    bounds = bounds_of(problem, boxes)
    radius = _radius(bounds)
    if roomy:
        rounding = problem.system.rounding * problem.system.magnitude(boxes.centre)
        noise = rounding[:, None] * np.abs(boxes.preconditioner).sum(axis=2)
        radius = np.maximum(radius + noise, np.maximum(_LEAST, _ROOM * noise))
    candidates = np.flatnonzero(np.isfinite(radius).all(axis=1))
    proved = np.zeros(len(radius), dtype=np.bool_)
    boxes.radius[:] = radius
    if candidates.size:
        bounds = bounds.take(candidates)
        boxes.weight[candidates], boxes.kappa[candidates] = weights_for(bounds, radius[candidates])
        proved[candidates] = holds(bounds, boxes.take(candidates)).proved
    return Tried(boxes, proved)


def _radius(bounds: Bounds) -> Array:
    """An R with Y + Z̄(R)R < R, near the least; NaN where none is found.

    With Z̄(R)R ≤ M(R)R + t(R) the iteration R ← R′ = (I − M(R))⁻¹(Y + t(R)) from R = Y grows towards the least solution
    and never passes it, as M and t grow with R; a negative entry or one beyond any joint's range says that there
    is none. So does a step that has grown in every entry: the iteration's slope, which grows with R, has reached 1.
    Every other round tries the limit that two steps extrapolate to, a little enlarged. Where
    Y + M(R)R + t(R) < R, the same holds all the way down to R′.
    """
    found = np.full(bounds.y.shape, np.nan)
    active = np.flatnonzero(np.isfinite(bounds.y).all(axis=1))
    here = bounds.take(active)
    base, trial, step = here.y, here.y * (1.0 + _INFLATION), here.y
    for round_number in range(_ROUNDS):
        if not active.size:
            break
        mean = here.mean(trial)
        solved = solve_many(np.eye(base.shape[1]) - mean.matrix, here.y + mean.rest)
        alive: Mask = np.asarray(np.all((solved >= 0.0) & (solved < _LARGEST), axis=1))
        inside: Mask = np.asarray(alive & np.all((here.y + mean.of(trial)) * _SETTLED < trial, axis=1))
        found[active[inside]] = (solved + 0.1 * (trial - solved))[inside]
        if round_number % 2:
            going, trial = np.flatnonzero(~inside), base
        else:
            last, base, step = step, solved, np.maximum(solved - trial, 0.0)
            growing = (round_number > 0) & np.all(step >= last, axis=1)
            going = np.flatnonzero(alive & ~inside & ~growing)
            rate = np.clip(np.max(step / np.maximum(last, 1e-300), axis=1, keepdims=True), 0.0, 0.98)
            trial = base + step * (rate / (1.0 - rate)) * 1.05 + _INFLATION * base
        active, here = active[going], here.take(going)
        base, trial, step = base[going], trial[going], step[going]
    return found
