"""Boxes of all coordinates that together hold all that is looked for: narrowed, dropped and halved until none is left.

A box is halved along one coordinate of θ = θ_c + Dδ, a cell of q along one of q; both halves hold, with roundings to
spare, all of what they were.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.proof.equations import Problem, closure_values
from ccpin.proof.narrowing import Candidates, directions, narrowed
from ccpin.proof.ranges import Ranges
from ccpin.proof.rounding import blur, widened
from ccpin.work import side_by_side

BEYOND = 1e-12
"""How far a search goes beyond its region each way; what two bounds may be apart by is less (rad, m)."""
_RATIO, _CURVED = 2.0, 0.3  # how much wider a box may be than its cell before it is halved: beside a sheet, a fold
_FLOOR = 1e-3  # of the steepest coordinate: as steep every one counts
_CHUNK = 1000  # boxes at once: bounds memory
_LEAST = 1e-9  # rad, m: narrower boxes are not halved


def over_all(problem: Problem, ranges: Ranges, lower: Array, upper: Array) -> Candidates:
    """The candidate that holds all closed configurations over lower ≤ q ≤ upper (n,) within the ranges; its cell is 0.

    It goes beyond by `BEYOND` and roundings, but where the bounds of a coordinate are the same.
    """
    system = problem.system
    centre, half = np.zeros((2, 1, system.n_free))
    centre[:, system.dependent] = ranges.middle
    half[:, system.dependent] = 0.5 * (ranges.upper - ranges.lower) + 1e-3 * ranges.edge
    centre[:, system.independent] = 0.5 * (lower + upper)
    wide = widened(centre[:, system.independent], 0.5 * (upper - lower)) + BEYOND
    half[:, system.independent] = np.where(upper > lower, wide, 0.0)
    return Candidates(np.zeros(1, dtype=np.intp), centre, half, np.zeros((1, system.m, system.n)))


def narrowed_both(problem: Problem, ranges: Ranges, waiting: Candidates, singular: bool = False) -> Candidates:
    """Candidates narrowed with both choices of Ã, without those beyond the ranges.

    Where singular ones are looked for, those that are nonsingular are dropped, unless they meet the end of a range that
    is a limit: beyond the others no configuration goes on (Lemma R of `ccpin.proof.ranges`).
    """
    parts = [rows_of(waiting, slice(first, first + _CHUNK)) for first in range(0, len(waiting.cell), _CHUNK)]
    found = side_by_side(partial(_narrowed_both, problem, ranges, singular), parts)
    result = joined([rows_of(waiting, slice(0)), *found])
    return rows_of(result, ~beyond(problem, ranges, result))


def _narrowed_both(problem: Problem, ranges: Ranges, singular: bool, part: Candidates) -> Candidates:
    part = narrowed(problem, part)
    if not part.cell.size:
        return part
    inner = ~ranges.at_limit(*_extent(problem, part)) if singular else None
    return narrowed(problem, part, True, inner)


def beyond(problem: Problem, ranges: Ranges, boxes: Candidates) -> Mask:
    """Which boxes lie beyond the ranges, full turns apart."""
    low, high = _extent(problem, boxes)
    return np.asarray(np.any((low > ranges.upper + ranges.edge) | (high < ranges.lower - ranges.edge), axis=1))


def _extent(problem: Problem, boxes: Candidates) -> tuple[Array, Array]:
    """Bounds of the dependent coordinates on boxes, of shape (K, m) each; of those on full turns none."""
    system = problem.system
    y, reach = boxes.centre[:, system.dependent], boxes.half[:, system.dependent]
    reach = reach + apply(np.abs(boxes.slopes), boxes.half[:, system.independent])
    reach = np.where(system.periodic[system.dependent], np.inf, reach)
    return y - reach, y + reach


def to_halve(problem: Problem, waiting: Candidates) -> tuple[Indices, Mask]:
    """Along which coordinate each candidate would be halved, and whether that is due before its cell is halved.

    A candidate about a fold is as wide as the root of its cell, and need not be narrower.
    """
    system = problem.system
    column = steepness(problem, waiting.centre)
    scale = column.max(axis=1, initial=0.0)
    moves = np.maximum(column, _FLOOR * scale[:, None]) * waiting.half
    ours, cells = moves[:, system.dependent], moves[:, system.independent].max(axis=1, initial=0.0)
    cut = system.dependent[np.argmax(ours, axis=1)]
    enough = np.maximum(_RATIO * cells, _CURVED * np.sqrt(scale * cells))
    width = np.take_along_axis(waiting.half, cut[:, None], axis=1)[:, 0]
    return cut, np.asarray((ours.max(axis=1, initial=0.0) > enough) & (width > _LEAST))


def steepness(problem: Problem, theta: Array) -> Array:
    """How far φ moves with each coordinate at θ (K, n′), by the rows to halve boxes for, of shape (K, n′)."""
    return np.asarray(np.abs(closure_values(problem, theta)[1])[:, rows_to_halve_for(problem)].max(axis=1))


def rows_to_halve_for(problem: Problem) -> Indices:
    """The rows of φ that chains enter; those of couplings are linear, and narrowing solves them. If none, all."""
    entered = np.zeros(problem.system.m, dtype=np.bool_)
    for chain in problem.system.chains:
        entered |= np.any(chain.weights != 0.0, axis=1)
    return np.flatnonzero(entered) if np.any(entered) else np.arange(len(entered))


def halved(problem: Problem, boxes: Candidates, cut: Indices) -> Candidates:
    """The lower, then the upper halves of candidates, along one δ each (its place in θ), with some roundings to spare.

    Where a middle of q is rounded, those of y are off by the slopes times that.
    """
    rows, half, system = np.arange(len(cut)), boxes.half.copy(), problem.system
    half[rows, cut] *= 0.5
    step = directions(problem, boxes)[rows, :, cut] * half[rows, cut, None]
    parts = []
    for side in (-1.0, 1.0):
        centre = boxes.centre + side * step
        spare = np.where(step != 0.0, blur(np.abs(centre) + np.abs(step)), 0.0)
        grown = half + spare
        grown[:, system.dependent] += apply(np.abs(boxes.slopes), spare[:, system.independent])
        parts.append(boxes._replace(centre=centre, half=grown))
    return joined(parts)
