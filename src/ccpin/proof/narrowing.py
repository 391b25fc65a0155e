"""Boxes of all coordinates: where no closed configuration is, and to where those that are can be narrowed.

A box is θ = θ_c + Dδ, |δ| ≤ h, with slopes S. Propositions N and U are stated and proved in
`ccpin/proof/theorems/narrowing.md`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, inverses, rows_of
from ccpin.proof.equations import Problem, closure_values
from ccpin.proof.newton import Boxes, bounds_of, weights_for
from ccpin.proof.rounding import SLACK, blur

_SHARE = 1e-12  # of Y: more than the rounding of E as a difference
_WIDER = 2.0  # how much wider a box may get by a change of slope
_SMALLER = 0.9  # what a change of slope is worth after; of choice


class Candidates(NamedTuple):
    """K boxes that may hold closed configurations.

    Attributes:
        cell: The cell of q-space over which each lies, of shape (K,).
        centre: θ_c, of shape (K, n′).
        half: h, of shape (K, n′), in the order of θ.
        slopes: S, of shape (K, m, n).
    """

    cell: Indices
    centre: Array
    half: Array
    slopes: Array


def narrowed(problem: Problem, boxes: Candidates, inverse: bool = False, regular: Mask | None = None) -> Candidates:
    """The boxes that may hold closed configurations, their dependent coordinates narrowed (Proposition N).

    Args:
        problem: The closures.
        boxes: The boxes.
        inverse: Whether Ã ≈ φ_y⁻¹ at the centre, and S ≈ −φ_y⁻¹φ_q where that is of use; or Ã = I.
        regular: Which boxes are to be dropped if φ_y is nonsingular on them too (`inverse` only): that is if
            |I − Ãφ_y|w < w on all of the box for some w > 0. Of shape (K,); default none.
    """
    system, count, given = problem.system, len(boxes.cell), boxes
    with np.errstate(all="ignore"):
        phi, jacobian = closure_values(problem, boxes.centre)
        gain = np.broadcast_to(np.eye(system.m), (count, system.m, system.m))
        if inverse:
            gain = inverses(jacobian[:, :, system.dependent])
            boxes = _leaning(problem, boxes, -gain @ jacobian[:, :, system.independent])
        across = directions(problem, boxes)
        constant, slope = apply(gain, phi), gain @ jacobian @ across
        moves = np.abs(slope) * boxes.half[:, None]
        bounds = bounds_of(problem, _whole(problem, boxes, gain, across))
        y = bounds.y
        rest = np.maximum(y - np.abs(constant) - moves.sum(axis=2), 0.0) + _SHARE * y
        reach = moves.sum(axis=2) + rest
        gone = np.any(np.abs(constant) > reach * SLACK, axis=1)
        others = (reach[..., None] - moves + _SHARE * y[..., None]) * SLACK
        middle, width = -constant[..., None] / slope, others / np.abs(slope)
        known = np.isfinite(width)
        low = np.where(known, middle - width, -np.inf).max(axis=1, initial=-np.inf)
        high = np.where(known, middle + width, np.inf).min(axis=1, initial=np.inf)
    low, high = np.maximum(low, -boxes.half), np.minimum(high, boxes.half)
    gone |= np.any(low > high, axis=1)
    smaller = _within(problem, boxes, low, high)
    if inverse:
        with np.errstate(all="ignore"):
            if regular is not None:
                rows = np.flatnonzero(regular & ~gone)
                gone[rows] = weights_for(bounds.take(rows), np.zeros((len(rows), system.m)))[1] < 1.0
        better = _size(problem, smaller, jacobian) < _SMALLER * _size(problem, given, jacobian)
        smaller = _chosen(better, smaller, given)
    return rows_of(smaller, np.flatnonzero(~gone))


def _size(problem: Problem, boxes: Candidates, jacobian: Array) -> Array:
    """How far the rows of φ move with the dependent coordinates, all together, of shape (K,)."""
    dependent = problem.system.dependent
    return np.asarray((np.abs(jacobian[:, :, dependent]).sum(axis=1) * boxes.half[:, dependent]).sum(axis=1))


def _chosen(first: Mask, one: Candidates, other: Candidates) -> Candidates:
    """Rows of one where told, of the other elsewhere."""
    centre, half = (np.where(first[:, None], a, b) for a, b in ((one.centre, other.centre), (one.half, other.half)))
    return Candidates(one.cell, centre, half, np.where(first[:, None, None], one.slopes, other.slopes))


def _leaning(problem: Problem, boxes: Candidates, slopes: Array) -> Candidates:
    """The boxes with other slopes, widened to hold what they held; as they are where that is much wider."""
    system = problem.system
    ours, cells = boxes.half[:, system.dependent], boxes.half[:, system.independent]
    wider = ours + apply(np.abs(slopes - boxes.slopes), cells) * SLACK
    useful = np.flatnonzero(np.all(wider <= _WIDER * ours + _SHARE, axis=1))
    half, leaning = boxes.half.copy(), boxes.slopes.copy()
    half[np.ix_(useful, system.dependent)] = wider[useful]
    leaning[useful] = slopes[useful]
    return boxes._replace(half=half, slopes=leaning)


def directions(problem: Problem, boxes: Candidates) -> Array:
    """D, of shape (K, n′, n′), in the order of θ."""
    system = problem.system
    directions = np.tile(np.eye(system.n_free), (len(boxes.cell), 1, 1))
    directions[np.ix_(np.arange(len(boxes.cell)), system.dependent, system.independent)] = boxes.slopes
    return directions


def _whole(problem: Problem, boxes: Candidates, gain: Array, directions: Array) -> Boxes:
    """The boxes as `bounds_of` takes them: all coordinates are parameters."""
    m = problem.system.m
    one = np.ones((len(boxes.cell), m))
    modes = np.broadcast_to(np.eye(m), gain.shape)
    return Boxes(boxes.centre, boxes.half, directions, modes, gain, radius=one, weight=one, kappa=one[:, 0])


def _within(problem: Problem, boxes: Candidates, low: Array, high: Array) -> Candidates:
    """The boxes with δ_y between low and high, outward by some roundings."""
    dependent = problem.system.dependent
    centre, half = boxes.centre.copy(), boxes.half.copy()
    middle = centre[:, dependent] + 0.5 * (low + high)[:, dependent]
    width = 0.5 * (high - low)[:, dependent] + blur(middle)
    smaller = width < half[:, dependent]
    centre[:, dependent] = np.where(smaller, middle, centre[:, dependent])
    half[:, dependent] = np.where(smaller, width, half[:, dependent])
    return boxes._replace(centre=centre, half=half)


def alone_in(problem: Problem, boxes: Boxes, held: Candidates) -> Mask:
    """Whether each proved box's σ is the only closed configuration in the candidate beside it (Proposition U), (K,).

    The candidate lies over the box's own cell; its dependent coordinates are not turned by 2π here.
    """
    system = problem.system
    inverse = inverses(boxes.modes)
    gap = (held.centre - boxes.centre)[:, system.dependent]
    reach = np.abs(apply(inverse, gap)) + apply(np.abs(inverse), held.half[:, system.dependent])
    reach += apply(np.abs(inverse @ (held.slopes - boxes.directions[:, system.dependent])), boxes.half)
    reach = np.maximum(reach * SLACK + 1e-13, boxes.radius)
    with np.errstate(all="ignore"):
        bounds = bounds_of(problem, boxes)
        inside = bounds.y + bounds.mean(reach).of(reach)
        reach = np.maximum(np.fmin(reach, inside * SLACK), boxes.radius)
        weight = boxes.weight
        image = bounds.contraction(reach)
        for _ in range(4):
            shrunk = image.of(weight)
            weight = 0.5 * (weight + shrunk / np.max(shrunk, axis=1, keepdims=True))
        shrunk = image.of(weight)
        alone = np.all(shrunk * SLACK < weight, axis=1)
    return np.asarray(alone & np.isfinite(shrunk).all(axis=1))
