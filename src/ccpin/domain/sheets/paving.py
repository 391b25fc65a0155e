"""Branch and prune: what no box of all coordinates can be shown not to hold.

A search starts with one candidate a cell: the cell and the whole range of each dependent coordinate. Candidates are
narrowed (Proposition N of `narrowing`), dropped where that shows them to be empty of what is looked for, and halved.

- `cover_singular` looks for *singular* closed configurations over a region: it also drops candidates on which φ_y is
  shown to be nonsingular, and halves cells where their own size is what makes a candidate wide. Candidates at the
  end of a range that is no full turn are kept even so. What is left over the smallest cells encloses all singular
  closed configurations over the region, and all that lie on such an end.
- `all_solutions` looks for *all* closed configurations over points: it also drops candidates in which one is proved to
  be the only one (Theorem K and Proposition U), and keeps that one if it lies in the ranges.

**Proposition C.** Over a connected union of cells without candidates of `cover_singular` every q has the same number of
closed configurations in the ranges searched.

*Proof.* Above the union no closed configuration is singular or on the end of a range (a full turn has none), so they
are locally smooth functions of q that stay within the ranges; as the ranges are compact none appears or
vanishes: their number is locally constant. ∎

Branch and prune of the sheets of parallel robots is that of S. Caro, D. Chablat, A. Goldsztejn, D. Ishii and
C. Jermann, "A branch and prune algorithm for the computation of generalized aspects of parallel robots", Artificial
Intelligence 211, 2014.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.domain.atlas.cells import LEVELS, WHOLE, CellTree, Region
from ccpin.domain.boxes import SLACK, Boxes, Problem, certify_boxes, closure_values
from ccpin.domain.newton import newton, without_turns
from ccpin.domain.sheets.narrowing import Candidates, alone_in, narrowed

_NEWTON = 12
_WIDEST = 1.5  # rad: wider candidates are halved before Newton's method is tried from their middle
_RATIO, _CURVED = 2.0, 0.3
_FLOOR = 1e-3
_ROUNDS = 60
_CHUNK = 1000
_LEAST = 1e-9
_BUDGET = 300_000  # candidates over one q

MOST_DEPENDENT = 8
"""Dependent coordinates: the search of all values of more would not end."""
_EDGE, _NEAR = 1e-9, 1e-6


class Ranges(NamedTuple):
    """What is searched of the dependent coordinates: bounds of shape (m,); a full turn of those that are periodic."""

    lower: Array
    upper: Array


class Cover(NamedTuple):
    """Cells of a region, and what may be singular.

    Attributes:
        tree: The cells.
        left: Candidates that enclose all singular closed configurations over the region.
    """

    tree: CellTree
    left: Candidates


class Solutions(NamedTuple):
    """Closed configurations over one q.

    Attributes:
        theta: Those that are proved, of shape (k, n′).
        complete: Whether it is proved that there are no others in the ranges.
    """

    theta: Array
    complete: bool


def cover_singular(problem: Problem, region: Region, ranges: Ranges, depth: int, budget: int) -> Cover:
    """Enclose all singular closed configurations over a region, halving each of its edges `depth` times at most.

    Once `budget` candidates were tried, all that wait are left as they are.
    """
    tree, smallest = CellTree.whole(problem.system.n), 1 << (LEVELS - depth)
    waiting = whole_candidates(
        problem, ranges, np.zeros(1, dtype=np.intp), *place(tree, region, np.zeros(1, dtype=np.intp))
    )
    left = [rows_of(waiting, slice(0))]
    while waiting.cell.size:
        stuck = [left[0]]
        for _ in range(_ROUNDS):
            budget -= len(waiting.cell)
            if not waiting.cell.size or budget < 0:
                break
            waiting = narrowed_both(problem, ranges, waiting, True)
            cut, due = to_halve(problem, waiting)
            stuck.append(rows_of(waiting, ~due))
            waiting = halved(rows_of(waiting, due), cut[due])
        waiting = joined([*stuck, waiting])
        cells = np.unique(waiting.cell)
        small = np.all(tree.size[cells] <= smallest, axis=1) | (budget < 0)
        last = np.isin(waiting.cell, cells[small])
        left.append(rows_of(waiting, last))
        waiting = _halve_cells(problem, tree, region, rows_of(waiting, ~last), cells[~small])
    return Cover(tree, joined(left))


def all_solutions(problem: Problem, ranges: Ranges, q: Array) -> Solutions:
    """All closed configurations over one q (n,), as far as that can be proved."""
    n = problem.system.n
    waiting = whole_candidates(problem, ranges, np.zeros(1, dtype=np.intp), q[None], np.zeros((1, n)))
    found, budget = list[Boxes](), _BUDGET
    while (budget := budget - len(waiting.cell)) > 0:
        waiting = narrowed_both(problem, ranges, waiting)
        if not waiting.cell.size:
            break
        waiting = rows_of(waiting, ~_solved(problem, ranges, waiting, found))
        cut, due = to_halve(problem, waiting)
        if not np.all(due):
            break
        waiting = halved(waiting, cut)
    theta = np.array([box.centre[0] for box in found]).reshape(-1, problem.system.n_free)
    apart = all(_different(problem, one, other) for one, other in combinations(found, 2))
    return Solutions(theta, apart and not waiting.cell.size)


def _within(problem: Problem, ranges: Ranges, boxes: Boxes) -> tuple[Mask, Mask]:
    """Which boxes' configurations lie within the ranges that are no full turns, and which beyond; some do not say."""
    system = problem.system
    slides = ~system.periodic[system.dependent]
    y, spread = boxes.centre[:, system.dependent][:, slides], (_spread(boxes) + _EDGE)[:, slides]
    low, high = ranges.lower[slides], ranges.upper[slides]
    inside = np.all((y - spread >= low) & (y + spread <= high), axis=1)
    return inside, np.any((y + spread < low) | (y - spread > high), axis=1)


def place(tree: CellTree, region: Region, cells: Indices) -> tuple[Array, Array]:
    """Centres and half widths of cells in q-space, (K, n) each."""
    size = tree.size[cells]
    return region.position(tree.lower[cells] + 0.5 * size), 0.5 * region.width * (size / WHOLE)


def whole_candidates(problem: Problem, ranges: Ranges, cells: Indices, q: Array, width: Array) -> Candidates:
    """One candidate a cell, with the whole ranges."""
    system = problem.system
    centre, half = np.zeros((2, len(cells), system.n_free))
    centre[:, system.dependent] = 0.5 * (ranges.lower + ranges.upper)
    half[:, system.dependent] = 0.5 * (ranges.upper - ranges.lower) + 1e-12
    centre[:, system.independent], half[:, system.independent] = q, width
    return Candidates(cells, centre, half, np.zeros((len(cells), system.m, system.n)))


def narrowed_both(problem: Problem, ranges: Ranges, waiting: Candidates, singular: bool = False) -> Candidates:
    """Candidates narrowed with both choices of Ã, without those beyond the ranges.

    Where singular ones are looked for, those that are nonsingular are dropped, unless they meet the end of a range that
    is no full turn.
    """
    parts = [rows_of(waiting, slice(0))]
    for first in range(0, len(waiting.cell), _CHUNK):
        part = narrowed(problem, rows_of(waiting, slice(first, first + _CHUNK)))
        if part.cell.size:
            inner = ~_at_end(problem, ranges, part) if singular else None
            parts.append(narrowed(problem, part, True, inner))
    result = joined(parts)
    low, high = _extent(problem, result)
    return rows_of(result, ~np.any((low > ranges.upper + _EDGE) | (high < ranges.lower - _EDGE), axis=1))


def _at_end(problem: Problem, ranges: Ranges, boxes: Candidates) -> Mask:
    """Which boxes meet the end of a range that is no full turn."""
    slides = ~problem.system.periodic[problem.system.dependent]
    low, high = _extent(problem, boxes)
    meets = (low <= ranges.lower + _EDGE) | (high >= ranges.upper - _EDGE)
    return np.asarray(np.any(meets[:, slides], axis=1))


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
    column = np.abs(closure_values(problem, waiting.centre)[1]).max(axis=1)
    scale = column.max(axis=1, initial=0.0)
    moves = np.maximum(column, _FLOOR * scale[:, None]) * waiting.half
    ours, cells = moves[:, system.dependent], moves[:, system.independent].max(axis=1, initial=0.0)
    cut = system.dependent[np.argmax(ours, axis=1)]
    enough = np.maximum(_RATIO * cells, _CURVED * np.sqrt(scale * cells))
    width = np.take_along_axis(waiting.half, cut[:, None], axis=1)[:, 0]
    return cut, np.asarray((ours.max(axis=1, initial=0.0) > enough) & (width > _LEAST))


def halved(boxes: Candidates, cut: Indices) -> Candidates:
    """Both halves of candidates, with some roundings to spare."""
    rows, half = np.arange(len(cut)), boxes.half.copy()
    half[rows, cut] *= 0.5
    parts = []
    for side in (-1.0, 1.0):
        centre, grown = boxes.centre.copy(), half.copy()
        centre[rows, cut] += side * half[rows, cut]
        grown[rows, cut] += 4e-16 * (1.0 + np.abs(centre[rows, cut]))
        parts.append(boxes._replace(centre=centre, half=grown))
    return joined(parts)


def _halve_cells(problem: Problem, tree: CellTree, region: Region, waiting: Candidates, cells: Indices) -> Candidates:
    """Halve cells along the edge that moves φ most, and pass their candidates on."""
    if not cells.size:
        return waiting
    system, at = problem.system, np.searchsorted(cells, waiting.cell)
    jacobian = np.abs(closure_values(problem, waiting.centre)[1][:, :, system.independent]).max(axis=1)
    stretch = np.zeros((len(cells), system.n))
    np.maximum.at(stretch, at, jacobian)
    tree.split(cells, np.argmax(stretch * (tree.size[cells] / WHOLE) * region.width, axis=1))
    return handed_down(problem, tree, region, waiting)


def handed_down(problem: Problem, tree: CellTree, region: Region, waiting: Candidates) -> Candidates:
    """The candidates over the two halves of their cells, which are split."""
    system, parts = problem.system, []
    for side in (0, 1):
        child = tree.child[waiting.cell] + side
        centre, half = waiting.centre.copy(), waiting.half.copy()
        middle, half[:, system.independent] = place(tree, region, child)
        moved = apply(waiting.slopes, middle - centre[:, system.independent])
        centre[:, system.independent] = middle
        centre[:, system.dependent] += moved
        half[:, system.dependent] += 1e-15 * (1.0 + np.abs(centre[:, system.dependent]) + np.abs(moved))
        parts.append(Candidates(child, centre, half, waiting.slopes))
    return joined(parts)


def _solved(problem: Problem, ranges: Ranges, waiting: Candidates, found: list[Boxes]) -> Mask:
    """Which candidates over one q hold a single configuration; new ones within the ranges join those found."""
    system = problem.system
    done = np.zeros(len(waiting.cell), dtype=np.bool_)
    angles = waiting.half[:, system.dependent][:, system.periodic[system.dependent]]
    rows = np.flatnonzero(np.all(angles <= _WIDEST, axis=1))
    ended = newton(problem, waiting.centre[rows], _NEWTON)
    rows, theta = rows[ended.settled], ended.theta[ended.settled]
    held = rows_of(waiting, rows)
    turns = np.round((theta - held.centre) / (2.0 * np.pi)) * system.periodic
    turns[:, system.independent] = 0.0
    tried = certify_boxes(problem, theta - 2.0 * np.pi * turns, held.half[:, system.independent], np.eye(system.n))
    good = np.flatnonzero(tried.proved)
    if not good.size:
        return done
    boxes = tried.boxes.take(good)
    inside, beyond = _within(problem, ranges, boxes)
    alone = alone_in(problem, boxes, rows_of(held, good)) & (inside | beyond)
    for k in np.flatnonzero(alone):
        one = boxes.take(np.array([k]))
        if inside[k] and not any(_same(problem, one, other) for other in found):
            found.append(one)
        done[rows[good[k]]] = True
    return done


def _same(problem: Problem, one: Boxes, other: Boxes) -> bool:
    """Whether two boxes over one q are proved to carry the same configuration (Proposition U)."""
    system = problem.system
    centre = other.centre + _gap(problem, one, other)
    if np.abs(centre - other.centre).max() > _NEAR:
        return False
    half = np.zeros_like(centre)
    half[:, system.dependent] = _spread(one)
    ball = Candidates(np.zeros(1, dtype=np.intp), centre, half, one.directions[:, system.dependent])
    return bool(alone_in(problem, other, ball)[0])


def _different(problem: Problem, one: Boxes, other: Boxes) -> bool:
    """Whether two boxes over one q are proved to carry different configurations."""
    gap = np.abs(_gap(problem, one, other)[:, problem.system.dependent])
    return bool(np.any(gap > (_spread(one) + _spread(other)) * SLACK + 1e-13))


def _gap(problem: Problem, one: Boxes, other: Boxes) -> Array:
    return without_turns(one.centre - other.centre, problem.system.periodic)


def _spread(box: Boxes) -> Array:
    """How far a configuration may be from its box's centre, of shape (1, m)."""
    return apply(np.abs(box.modes), box.radius)
