"""The cells of an atlas that hold no closed configuration, as far as closed forms tell."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array, Indices, rows_of
from ccpin.covering.cells import CellStatus, CellTree, place
from ccpin.covering.claims import cells_of
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.platforms import platform_empty
from ccpin.covering.proposals.solving import newton
from ccpin.covering.pruning import Pruning
from ccpin.covering.region import Region
from ccpin.covering.runner import Runner
from ccpin.domain.closures.searchable import MOST_DEPENDENT, all_values
from ccpin.domain.closures.system import Reading
from ccpin.proof.candidates import over_all
from ccpin.proof.cell_tree import LEVELS
from ccpin.proof.chains import ClosureSystem
from ccpin.proof.emptiness import empty_cells, groups_of, platform_of
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.exhausted import Excluded, Unreachable, handed_down, holding
from ccpin.proof.facts import Fact, prove
from ccpin.proof.narrowing import Candidates

_CHUNK = 20_000  # cells: bounds memory
_BUDGET = 2_000_000  # candidates
_ROUNDS = 12  # of narrowing before a cell is halved
_NEWTON = 12  # steps
_WORTH = 1e-3  # of the region: less that is unreached is not searched


def prove_empty(runner: Runner, tree: CellTree, region: Region, depth: int, thorough: bool = False) -> None:
    """Mark cells that are neither certified nor candidates as empty where that is proved, halving those never tried.

    By the triangle inequality; `thorough`: by Theorem E of `platform` too, where it applies.

    Raises:
        Stopped: An interrupt was asked for; what was proved by then is marked.
    """
    system = runner.problem.system
    groups, platform = groups_of(system), platform_of(system) if thorough else None
    if not groups and platform is None:
        return
    smallest = 1 << (LEVELS - depth)
    cells = tree.leaves(CellStatus.UNREACHED, CellStatus.UNDECIDED)
    while cells.size:
        empty = np.zeros(len(cells), dtype=np.bool_)
        for first in range(0, len(cells), _CHUNK):
            runner.check()
            part = slice(first, first + _CHUNK)
            centre, half = place(tree, region, cells[part])
            empty[part] = empty_cells(system, groups, centre, half)
            if platform is not None:
                rows = np.flatnonzero(~empty[part])
                empty[first + rows] = platform_empty(system, platform, centre[rows], half[rows])[0]
        tree.status[cells[empty]] = CellStatus.EMPTY
        left = cells[tree.status[cells] == CellStatus.UNREACHED]
        left = left[np.max(tree.size[left], axis=1, where=~region.held, initial=0) > smallest]
        cells = tree.split(left, np.argmax(tree.size[left] * (region.width / region.width.max()), axis=1))


def search_empty(runner: Runner, reading: Reading, tree: CellTree, region: Region, depth: int) -> None:
    """Mark unreached cells as empty where an exhaustive search proves it, halving them `depth` times at most.

    It ends early where its budget of two million candidates is spent; what it had no time for stays unreached. Nothing
    is tried where less than a thousandth of the region is unreached, nor for more than eight dependent coordinates.

    Raises:
        Stopped: An interrupt was asked for; what was proved by then is marked.
    """
    problem = runner.problem
    ranges = all_values(reading, region.lower, region.upper)
    if ranges is None or problem.system.m > MOST_DEPENDENT or tree.share(tree.leaves(CellStatus.UNREACHED)) < _WORTH:
        return
    root, smallest = np.zeros(1, dtype=np.intp), 1 << (LEVELS - depth)
    waiting, searched = over_all(problem, ranges, region.lower, region.upper), root
    search = Pruning(runner, ranges, _BUDGET)
    while searched.size and not search.over:
        waiting = search.settled(waiting, _ROUNDS)
        _mark(tree, np.setdiff1d(searched, waiting.cell))
        runner.check()
        waiting = _unsettled(problem, waiting)
        cells = np.unique(waiting.cell)
        leaf = tree.child[cells] < 0
        lengths = np.where(tree.size[cells] > smallest, tree.size[cells] * region.width, 0.0)
        small = np.all(lengths == 0.0, axis=1)  # edges of coordinates that are held are never halved
        tree.split(cells[leaf & ~small], np.argmax(lengths[leaf & ~small], axis=1))
        cells = cells[~(leaf & small)]
        waiting = rows_of(waiting, np.isin(waiting.cell, cells))
        waiting = handed_down(problem, region.corners, tree, tree.child, waiting)
        searched = np.concatenate([tree.child[cells], tree.child[cells] + 1])
        open_cells = holding(np.ones(len(tree.child), np.bool_), tree.child, tree.status == CellStatus.UNREACHED)
        searched = searched[open_cells[searched]]
        waiting = rows_of(waiting, np.isin(waiting.cell, searched))


def empty_facts(reading: Reading, region: Region, tree: CellTree) -> tuple[Fact, ...]:
    """The facts about cells that are called empty; those of which it is not proved are undecided from then on."""
    cells = tree.leaves(CellStatus.EMPTY)
    if not cells.size:
        return ()
    equations = closures_of(reading.problem)
    weights = _weights(reading.problem.system, *place(tree, region, cells))
    facts = [prove(Unreachable(equations, **cells_of(region, tree), cell=cells.astype(np.int64), weights=weights))]
    left = cells[~facts[0].found["empty"][cells]]
    ranges = all_values(reading, region.lower, region.upper) if left.size else None
    if ranges is not None:
        claim = Excluded(
            equations,
            **cells_of(region, tree),
            kept=~np.isin(np.arange(len(tree.child)), left),
            limits=ranges.limits,
            middle=ranges.middle,
            singular=np.zeros(1, dtype=np.bool_),
        )
        facts.append(prove(claim))
        left = left[~facts[1].found["empty"][left]]
    tree.status[left] = CellStatus.UNDECIDED
    return tuple(facts)


def _weights(system: ClosureSystem, centre: Array, half: Array) -> Array:
    """Weights by which Theorem E may prove boxes (B, n) empty of which the triangle inequality says nothing."""
    platform = platform_of(system)
    if platform is None:
        return np.zeros((len(centre), 0))
    rows = np.flatnonzero(~empty_cells(system, groups_of(system), centre, half))
    weights = np.zeros((len(centre), len(platform.lengths)))
    weights[rows] = platform_empty(system, platform, centre[rows], half[rows])[1]
    return weights


def _mark(tree: CellTree, cells: Indices) -> None:
    """Mark the unreached leaves of cells as empty."""
    while cells.size:
        leaf = tree.child[cells] < 0
        done = cells[leaf]
        tree.status[done[tree.status[done] == CellStatus.UNREACHED]] = CellStatus.EMPTY
        cells = np.concatenate([tree.child[cells[~leaf]], tree.child[cells[~leaf]] + 1])


def _unsettled(problem: Problem, waiting: Candidates) -> Candidates:
    """The candidates over cells that σ was not proved on: where it is, no part of the cell is empty."""
    if not waiting.cell.size:
        return waiting
    system = problem.system
    found = newton(problem, waiting.centre, _NEWTON)
    rows = np.flatnonzero(found.settled)
    half = waiting.half[rows][:, system.independent]
    tried = certify_boxes(problem, found.theta[rows], half, np.eye(system.n))
    return rows_of(waiting, ~np.isin(waiting.cell, waiting.cell[rows[tried.proved]]))
