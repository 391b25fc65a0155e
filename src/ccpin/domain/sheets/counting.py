"""Branch and prune: what no box of all coordinates can be shown not to hold.

A search starts with one candidate a cell: the cell and the whole range of each dependent coordinate. Candidates are
narrowed (Proposition N of `narrowing`), dropped where that shows them to be empty of what is looked for, and halved.

- `cover_singular` looks for *singular* closed configurations over a region: it also drops candidates on which φ_y is
  shown to be nonsingular, and halves cells where their own size is what makes a candidate wide. Candidates that meet a
  limit are kept even so. What is left over the smallest cells encloses all singular closed configurations over the
  region, and all that lie on a limit.
- `all_solutions` looks for *all* closed configurations over points: it also drops candidates in which one is proved to
  be the only one (Theorem N and Proposition U), and keeps that one if it lies in the ranges.

What is left over counts by Proposition C of `ccpin/proof/theorems/counting.md`.

Branch and prune of the sheets of parallel robots is that of S. Caro, D. Chablat, A. Goldsztejn, D. Ishii and
C. Jermann, "A branch and prune algorithm for the computation of generalized aspects of parallel robots", Artificial
Intelligence 211, 2014.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.covering.cells import CellTree
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import newton
from ccpin.covering.pruning import Pruning
from ccpin.covering.region import Region
from ccpin.covering.runner import Arrays, Report, Runner
from ccpin.proof.candidates import halved, handed_down, narrowed_both, over_all, steepness, to_halve
from ccpin.proof.covers import LEVELS, WHOLE
from ccpin.proof.equations import Problem
from ccpin.proof.narrowing import Candidates, alone_in
from ccpin.proof.newton import Boxes, without_turns
from ccpin.proof.ranges import Ranges
from ccpin.proof.rounding import SLACK

_NEWTON = 12
_WIDEST = 1.5  # rad: wider candidates are halved before Newton's method is tried from their middle
_ROUNDS = 60
_BUDGET = 300_000  # candidates over one q

_NEAR = 1e-6


class Cover(NamedTuple):
    """Cells of a region, and what may be singular.

    Attributes:
        tree: The cells.
        left: Candidates that enclose all singular closed configurations over the region.
        complete: Whether no interrupt ended the search.
    """

    tree: CellTree
    left: Candidates
    complete: bool


class Solutions(NamedTuple):
    """Closed configurations over one q.

    Attributes:
        theta: Those that are proved, of shape (k, n′).
        complete: Whether it is proved that there are no others in the ranges.
    """

    theta: Array
    complete: bool


def cover_singular(
    runner: Runner,
    region: Region,
    ranges: Ranges,
    depth: int,
    budget: int,
    report: Report,
    begun: Cover | None = None,
) -> Cover:
    """Enclose all singular closed configurations over a region, halving each of its edges `depth` times at most.

    Once `budget` candidates were tried, or the runner was stopped, all that wait are left as they are; from what is
    left so, another search may go on.
    """
    problem = runner.problem
    smallest = 1 << (LEVELS - depth)
    if begun is None:
        tree = CellTree.whole(problem.system.n)
        waiting = over_all(problem, ranges, region.lower, region.upper)
    else:
        tree, waiting = begun.tree, begun.left
    left = [rows_of(waiting, slice(0))]
    search = Pruning(runner, ranges, budget, singular=True)
    while waiting.cell.size:
        waiting = search.settled(waiting, _ROUNDS)
        cells = np.unique(waiting.cell)
        small = np.all(tree.size[cells] <= smallest, axis=1) | search.over
        last = np.isin(waiting.cell, cells[small])
        left.append(rows_of(waiting, last))
        waiting = _halve_cells(problem, tree, region, rows_of(waiting, ~last), cells[~small], smallest)
        report(tree, 0, len(np.unique(waiting.cell)))
    return Cover(tree, joined(left), search.complete)


def all_solutions(problem: Problem, ranges: Ranges, q: Array) -> Solutions:
    """All closed configurations over one q (n,), as far as that can be proved."""
    waiting = over_all(problem, ranges, q, q)
    found, budget = list[Boxes](), _BUDGET
    while (budget := budget - len(waiting.cell)) > 0:
        waiting = narrowed_both(problem, ranges, waiting)
        if not waiting.cell.size:
            break
        waiting = rows_of(waiting, ~_solved(problem, ranges, waiting, found))
        cut, due = to_halve(problem, waiting)
        if not np.all(due):
            break
        waiting = halved(problem, waiting, cut)
    theta = np.array([box.centre[0] for box in found]).reshape(-1, problem.system.n_free)
    apart = all(_different(problem, one, other) for one, other in combinations(found, 2))
    return Solutions(theta, apart and not waiting.cell.size)


def solutions_task(problem: Problem, arrays: Arrays) -> Arrays:
    """`all_solutions` between plain arrays: (*ranges, q) → (θ, complete)."""
    found = all_solutions(problem, Ranges(*arrays[:4]), arrays[4])  # type: ignore[arg-type]
    return found.theta, np.array(found.complete)


def _within(problem: Problem, ranges: Ranges, boxes: Boxes) -> tuple[Mask, Mask]:
    """Which boxes' configurations lie within the ranges that are no full turns, and which beyond; some do not say."""
    system = problem.system
    ended = ~ranges.turning
    y, spread = boxes.centre[:, system.dependent][:, ended], (_spread(boxes) + ranges.edge)[:, ended]
    low, high = ranges.lower[ended], ranges.upper[ended]
    inside = np.all((y - spread >= low) & (y + spread <= high), axis=1)
    return inside, np.any((y + spread < low) | (y - spread > high), axis=1)


def _halve_cells(
    problem: Problem, tree: CellTree, region: Region, waiting: Candidates, cells: Indices, smallest: int
) -> Candidates:
    """Halve cells along the edge above the smallest that moves φ most, and pass their candidates on."""
    if not cells.size:
        return waiting
    system, at = problem.system, np.searchsorted(cells, waiting.cell)
    jacobian = steepness(problem, waiting.centre)[:, system.independent]
    stretch = np.zeros((len(cells), system.n))
    np.maximum.at(stretch, at, jacobian)
    moved = np.where(np.isfinite(stretch), stretch, 0.0) * (tree.size[cells] / WHOLE) * region.width
    tree.split(cells, np.argmax(np.where(tree.size[cells] > smallest, moved, -1.0), axis=1))
    return handed_down(problem, tree.cut, tree.child, waiting)


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
