"""Branch and prune: what no box of all coordinates can be shown not to hold.

A search starts with one candidate a cell: the cell and the whole range of each dependent coordinate. Candidates are
narrowed (Proposition N of `narrowing`), dropped where that shows them to be empty of what is looked for, and halved.

- `cover_singular` looks for *singular* closed configurations over a region: it also drops candidates on which φ_y is
  shown to be nonsingular, and halves cells where their own size is what makes a candidate wide. Candidates that meet a
  limit are kept even so. What is left over the smallest cells encloses all singular closed configurations over the
  region, and all that lie on a limit.
- `all_solutions` looks for *all* closed configurations over points: it also drops candidates in which one is proved to
  be the only one (Theorem N and Proposition U).

What they find is proved by `ccpin.proof.solution_counts`, which goes through it once more (Proposition C).

Branch and prune of the sheets of parallel robots is that of S. Caro, D. Chablat, A. Goldsztejn, D. Ishii and
C. Jermann, "A branch and prune algorithm for the computation of generalized aspects of parallel robots", Artificial
Intelligence 211, 2014.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, joined, rows_of
from ccpin.covering.cells import CellTree
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import newton
from ccpin.covering.pruning import Pruning
from ccpin.covering.region import Region
from ccpin.covering.runner import Arrays, Report, Runner
from ccpin.proof.candidates import halved, narrowed_both, over_all, steepness, to_halve
from ccpin.proof.cell_tree import LEVELS, WHOLE
from ccpin.proof.equations import Problem
from ccpin.proof.exhausted import ROUNDS, handed_down
from ccpin.proof.narrowing import Candidates
from ccpin.proof.newton import Boxes
from ccpin.proof.ranges import Ranges
from ccpin.proof.rounding import TURN
from ccpin.proof.solution_counts import alone_over, within

_NEWTON = 12  # steps
_WIDEST = 1.5  # rad: wider candidates are halved before Newton's method is tried from their middle
_BUDGET = 300_000  # candidates over one q

_NEAR = 1e-6  # rad, m: the same spelling of one configuration


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
        waiting = search.settled(waiting, ROUNDS)
        cells = np.unique(waiting.cell)
        small = np.all(tree.size[cells] <= smallest, axis=1) | search.over
        last = np.isin(waiting.cell, cells[small])
        left.append(rows_of(waiting, last))
        waiting = _halve_cells(problem, tree, region, rows_of(waiting, ~last), cells[~small], smallest)
        report(tree, 0, len(np.unique(waiting.cell)))
    return Cover(tree, joined(left), search.complete)


def all_solutions(problem: Problem, ranges: Ranges, q: Array) -> Boxes:
    """Boxes over one q (n,) about all its closed configurations that were found; `solution_counts` says if all are."""
    waiting, budget = over_all(problem, ranges, q, q), _BUDGET
    found = certify_boxes(
        problem, waiting.centre[:0], waiting.half[:0, problem.system.independent], np.eye(len(q))
    ).boxes
    while (budget := budget - len(waiting.cell)) > 0:
        waiting = narrowed_both(problem, ranges, waiting)
        if not waiting.cell.size:
            break
        found = joined([found, _others(problem, found, _near(problem, ranges, waiting))])
        waiting = rows_of(waiting, ~alone_over(problem, waiting, found))
        cut, due = to_halve(problem, waiting)
        if not np.all(due):
            break
        waiting = halved(problem, waiting, cut)
    return found


def solutions_task(problem: Problem, arrays: Arrays) -> Arrays:
    """`all_solutions` between plain arrays: (*ranges, q) → boxes."""
    return tuple(all_solutions(problem, Ranges(*arrays[:4]), arrays[4]))  # type: ignore[arg-type]


def _near(problem: Problem, ranges: Ranges, waiting: Candidates) -> Boxes:
    """Boxes near the middles of candidates over one q, each within the ranges or beyond them."""
    system = problem.system
    angles = waiting.half[:, system.dependent][:, system.periodic[system.dependent]]
    held = rows_of(waiting, np.all(angles <= _WIDEST, axis=1))
    ended = newton(problem, held.centre, _NEWTON)
    held, theta = rows_of(held, ended.settled), ended.theta[ended.settled]
    turns = np.round((theta - held.centre) / TURN) * system.periodic
    turns[:, system.independent] = 0.0
    tried = certify_boxes(problem, theta - TURN * turns, held.half[:, system.independent], np.eye(system.n))
    boxes = tried.boxes.take(np.flatnonzero(tried.proved))
    inside, beyond = within(problem, ranges, boxes)
    return boxes.take(np.flatnonzero(inside | beyond))


def _others(problem: Problem, found: Boxes, boxes: Boxes) -> Boxes:
    """The boxes about no configuration that is known, turns counted, each once."""
    before = len(found.kappa)
    theta = np.concatenate([found.centre, boxes.centre])[:, problem.system.dependent]
    close = np.abs(theta[before:, None] - theta[None]).max(axis=2, initial=0.0) <= _NEAR
    new = [k for k, alike in enumerate(close) if not np.any(alike[: before + k])]
    return boxes.take(np.array(new, dtype=np.intp))


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
    return handed_down(problem, region.corners, tree, tree.child, waiting)
