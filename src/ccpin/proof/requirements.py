"""What is asked of a box of task space besides Theorem N: limits, motors that determine the motion, dexterity.

Theorem D and what it says of motors, dexterity and limits are in `ccpin/proof/theorems/demands.md`.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ccpin.arrays import Array, Mask, apply, inverses
from ccpin.proof.bounds import Bounds
from ccpin.proof.equations import Problem, Requirements, closure_values
from ccpin.proof.newton import Boxes, bounds_of, weights_for
from ccpin.proof.rounding import SLACK

_ROUNDING = 1e-12  # of sums over the box, relative: far above their roundings


def meets(problem: Problem, boxes: Boxes) -> Mask:
    """Which of B proved boxes are proved to meet the problem's demands as well, of shape (B,)."""
    within, demands = passable(problem, boxes), problem.requirements
    rows = np.flatnonzero(within)
    if demands is not None and rows.size and demands.driven.size:
        within[rows] = dexterous(problem, demands, boxes.take(rows))
    return within


def passable(problem: Problem, boxes: Boxes) -> Mask:
    """Which of B proved boxes keep the limits and are nowhere singular for the motors, of shape (B,)."""
    demands = problem.requirements
    if demands is None:
        return np.ones(len(boxes.kappa), dtype=np.bool_)
    low, high = reach(problem, boxes)
    within = np.asarray(np.all((low >= demands.lower) & (high <= demands.upper), axis=1))
    rows = np.flatnonzero(within)
    if rows.size and demands.driven.size:
        within[rows] = regular(problem, demands, boxes.take(rows))
    return within


def reach(problem: Problem, boxes: Boxes) -> tuple[Array, Array]:
    """Bounds of θ over proved boxes, of shape (B, n′) each."""
    spread = apply(np.abs(boxes.directions), boxes.half)
    spread[:, problem.system.dependent] += apply(np.abs(boxes.modes), boxes.radius)
    spread = spread * SLACK + _ROUNDING * (1.0 + np.abs(boxes.centre))
    return boxes.centre - spread, boxes.centre + spread


def regular(problem: Problem, demands: Requirements, boxes: Boxes) -> Mask:
    """Whether ψ_q′ is proved to be nonsingular on the boxes' tubes, of shape (B,)."""
    system = problem.system
    others = np.setdiff1d(np.arange(system.n_free), demands.driven)
    with np.errstate(all="ignore"):
        slope = closure_values(problem, boxes.centre)[1][:, :, others]
        modes = np.zeros((len(slope), system.n_free, system.m))
        modes[:, others] = np.eye(system.m)
        tube = _whole(problem, boxes)._replace(preconditioner=inverses(slope))
        kappa = weights_for(bounds_of(problem, tube, modes), tube.radius)[1]
    return np.asarray(kappa < 1.0)


def dexterous(problem: Problem, demands: Requirements, boxes: Boxes) -> Mask:
    """Whether 1/κ(J) is proved to be what is asked for, of shape (B,)."""
    if not demands.dexterity:
        return np.ones(len(boxes.kappa), dtype=np.bool_)
    return np.asarray(conditioning(problem, demands, boxes)[0] >= demands.dexterity)


def conditioning(problem: Problem, demands: Requirements, boxes: Boxes) -> tuple[Array, Array]:
    """Bounds of 1/κ(J) over proved boxes, of shape (B,) each; −∞ and ∞ where none are proved."""
    with np.errstate(all="ignore"):
        slope = boxes.directions[:, demands.driven] / demands.units
        error = np.linalg.norm(_drift(problem, boxes)[:, demands.driven] / demands.units, axis=(1, 2))
        sizes = np.linalg.svd(slope, compute_uv=False)
        least, most = sizes[:, -1], sizes[:, 0]
        error = SLACK * error + _ROUNDING * most
        low, high = (least - error) / (most + error), (least + error) / (most - error)
    return np.where(np.isfinite(error), low / SLACK, -np.inf), np.where(error < most, high * SLACK, np.inf)


def _drift(problem: Problem, boxes: Boxes) -> Array:
    """|E|T ≥ |θ_δ − D| of Theorem D, of shape (B, n′, n); not finite where no T is proved."""
    system = problem.system
    first, shrunk = _first(problem, boxes), _contraction(problem, boxes)
    spread = np.linalg.solve(np.eye(system.m) - shrunk, first) * (1.0 + 1e-6) + 1e-300
    proved = np.all(spread > 0.0, axis=(1, 2)) & np.all((first + shrunk @ spread) * SLACK <= spread, axis=(1, 2))
    drift = np.zeros((len(first), system.n_free, system.n))
    drift[:, system.dependent] = np.abs(boxes.modes) @ spread
    drift[~proved] = np.nan
    return drift


def _whole(problem: Problem, boxes: Boxes) -> Boxes:
    """The boxes' tubes as parameters alone: D and E side by side, (h, R), and R′ = 0."""
    system = problem.system
    modes = np.zeros((len(boxes.kappa), system.n_free, system.m))
    modes[:, system.dependent] = boxes.modes
    return boxes._replace(
        directions=np.concatenate([boxes.directions, modes], axis=2),
        half=np.concatenate([boxes.half, boxes.radius * SLACK], axis=1),
        radius=np.zeros_like(boxes.radius),
    )


def _contraction(problem: Problem, boxes: Boxes) -> Array:
    """Z ≥ |I − f_ζ| on the boxes' tubes, of shape (B, m, m)."""
    bounds, count, m = bounds_of(problem, boxes), len(boxes.kappa), problem.system.m
    return np.stack([_column(bounds, boxes.radius, k) for k in range(m)], axis=2).reshape(count, m, m)


def _column(bounds: Bounds, radius: Array, k: int) -> Array:
    """A column of Z, of shape (B, m)."""
    image = bounds.contraction(radius)
    unit = np.broadcast_to(np.eye(radius.shape[1])[k], radius.shape)
    return np.asarray((image.matrix[:, :, k] + image.rest(unit)) * SLACK)


def _first(problem: Problem, boxes: Boxes) -> Array:
    """F ≥ |f_δ| on the boxes' tubes, of shape (B, m, n).

    E′ has m columns, so D's are put into it m at a time, each in a place of its own.
    """
    system, tube = problem.system, _whole(problem, boxes)
    count, n, m = len(boxes.kappa), system.n, system.m
    found = np.full((count, m, n), np.inf)
    for first, shift in product(range(0, n, m), (0, 1)):
        chosen = np.arange(first, min(first + m, n))
        places = (chosen + shift) % m
        columns = np.zeros((count, system.n_free, m))
        columns[:, :, places] = boxes.directions[:, :, chosen]
        bounds = bounds_of(problem, tube, columns)
        for j, place in zip(chosen.tolist(), places.tolist(), strict=True):
            bound = _column(bounds, tube.radius, place)
            bound[:, place] = np.inf
            found[:, :, j] = np.minimum(found[:, :, j], bound)
    return found
