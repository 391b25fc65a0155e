"""Cells without any closed configuration, by exhaustive search where the triangle inequality says nothing.

All values of the dependent coordinates are searched over the cells of an atlas (`paving`), from its first cell down to
those that no box certifies; a cell whose last candidate is dropped is empty. Angles are searched all the way round,
slides and coupled joints as far as Lemma R of `ccpin.proof.ranges` bounds them, whatever their limits. Where it does
not, nothing is searched.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array, Indices, rows_of
from ccpin.domain.atlas.cells import LEVELS, CellStatus, CellTree, Region, place
from ccpin.domain.atlas.run import Runner
from ccpin.domain.boxes import certify_boxes
from ccpin.domain.closures.system import Reading
from ccpin.domain.newton import newton
from ccpin.domain.sheets.candidates import Pruning, handed_down, whole_candidates
from ccpin.domain.sheets.paving import MOST_DEPENDENT
from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.equations import Problem
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import NO_LIMIT, Ranges, ranges_of

_BUDGET = 2_000_000
_ROUNDS = 12
_NEWTON = 12
_WORTH = 1e-3


def search_empty(runner: Runner, reading: Reading, tree: CellTree, region: Region, depth: int) -> None:
    """Mark unreached cells as empty where an exhaustive search proves it, halving them `depth` times at most.

    It ends early where its budget of two million candidates is spent; what it had no time for stays unreached. Nothing
    is tried where less than a thousandth of the region is unreached, nor for more than eight dependent coordinates.

    Raises:
        Stopped: An interrupt was asked for; what was proved by then is marked.
    """
    problem = runner.problem
    ranges = all_values(reading, region.lower, region.upper)
    if ranges is None or problem.system.m > MOST_DEPENDENT or _share(tree) < _WORTH:
        return
    root = np.zeros(1, dtype=np.intp)
    waiting, searched = whole_candidates(problem, ranges, root, *place(tree, region, root)), root
    search = Pruning(runner, ranges, _BUDGET)
    while searched.size and not search.over:
        waiting = search.settled(waiting, _ROUNDS)
        _mark(tree, np.setdiff1d(searched, waiting.cell))
        runner.check()
        waiting = _unsettled(problem, tree, waiting)
        cells = np.unique(waiting.cell)
        leaf = tree.child[cells] < 0
        small = np.all(tree.size[cells] <= 1 << (LEVELS - depth), axis=1)
        tree.split(cells[leaf & ~small], np.argmax(tree.size[cells[leaf & ~small]] * region.width, axis=1))
        cells = cells[~(leaf & small)]
        waiting = rows_of(waiting, np.isin(waiting.cell, cells))
        waiting = handed_down(problem, tree, region, waiting)
        searched = np.concatenate([tree.child[cells], tree.child[cells] + 1])
        searched = searched[_open(tree)[searched]]
        waiting = rows_of(waiting, np.isin(waiting.cell, searched))


def _share(tree: CellTree) -> float:
    """The unreached share of the region."""
    return tree.share(tree.leaves(CellStatus.UNREACHED))


def _open(tree: CellTree) -> Array:
    """Which cells hold an unreached leaf, of shape (cells,)."""
    found = (tree.child < 0) & (tree.status == CellStatus.UNREACHED)
    for cell in np.flatnonzero(tree.child >= 0)[::-1]:  # children come behind their parents
        found[cell] = found[tree.child[cell]] or found[tree.child[cell] + 1]
    return np.asarray(found)


def _mark(tree: CellTree, cells: Indices) -> None:
    """Mark the unreached leaves of cells as empty."""
    while cells.size:
        leaf = tree.child[cells] < 0
        done = cells[leaf]
        tree.status[done[tree.status[done] == CellStatus.UNREACHED]] = CellStatus.EMPTY
        cells = np.concatenate([tree.child[cells[~leaf]], tree.child[cells[~leaf]] + 1])


def _unsettled(problem: Problem, tree: CellTree, waiting: Candidates) -> Candidates:
    """The candidates over cells that σ was not proved on: where it is, no part of the cell is empty."""
    if not waiting.cell.size:
        return waiting
    system = problem.system
    found = newton(problem, waiting.centre, _NEWTON)
    rows = np.flatnonzero(found.settled)
    half = waiting.half[rows][:, system.independent]
    tried = certify_boxes(problem, found.theta[rows], half, np.eye(system.n))
    return rows_of(waiting, ~np.isin(waiting.cell, waiting.cell[rows[tried.proved]]))


def all_values(reading: Reading, lower: Array, upper: Array) -> Ranges | None:
    """Ranges that hold every closed configuration over lower ≤ q ≤ upper (n,); ``None`` where there are none known."""
    system = reading.system
    if reading.rods or np.any(system.moduli) or any(joint.kind.unit == 4 for joint in reading.chart.joints):
        return None
    limits = np.tile([-NO_LIMIT, NO_LIMIT], (system.m, 1))
    names = [str(j) for j in range(system.n_free)]
    try:
        return ranges_of(system, np.zeros(system.n_free), (lower, upper), limits, names)
    except UnsupportedMechanismError:
        return None
