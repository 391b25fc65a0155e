"""Cells without any closed configuration, by exhaustive search where the triangle inequality says nothing.

All values of the dependent coordinates are searched over the cells of an atlas (`paving`), from its first cell down to
those that no box certifies; a cell whose last candidate is dropped is empty. Angles are searched all the way round. A
slide has no such range, but closed loops bound it:

**Proposition L.** Let the chains of a closure's point rows read Σ_c W_c x_c + d = 0, let one of them begin with slides
along a₁, …, a_k with W a_i orthonormal, and let no chain hold another dependent slide. Then in every closed
configuration each of these slides is at most Σ_c ‖W_c‖(length of c without them) + |d|.

*Proof.* |s_i| ≤ |Σ s_i W a_i|, which is minus the sum of the rest. ∎

Where a dependent slide is not of this kind, nothing is searched.
"""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array, Indices, rows_of
from ccpin.domain.atlas.cells import LEVELS, CellStatus, CellTree, Region, place
from ccpin.domain.atlas.run import Runner
from ccpin.domain.boxes import Problem, certify_boxes
from ccpin.domain.chains import Chain, ClosureSystem
from ccpin.domain.newton import newton
from ccpin.domain.sheets.candidates import Pruning, Ranges, handed_down, whole_candidates
from ccpin.domain.sheets.narrowing import Candidates
from ccpin.domain.sheets.paving import MOST_DEPENDENT

_BUDGET = 2_000_000
_ROUNDS = 12
_NEWTON = 12
_WORTH = 1e-3
_ORTHONORMAL = 1e-9


def search_empty(runner: Runner, tree: CellTree, region: Region, depth: int) -> None:
    """Mark unreached cells as empty where an exhaustive search proves it, halving them `depth` times at most.

    It ends early where its budget of two million candidates is spent; what it had no time for stays unreached. Nothing
    is tried where less than a thousandth of the region is unreached, nor for more than eight dependent coordinates.

    Raises:
        Stopped: An interrupt was asked for; what was proved by then is marked.
    """
    problem = runner.problem
    ranges = all_values(problem.system, np.maximum(np.abs(region.lower), np.abs(region.upper)))
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


def all_values(system: ClosureSystem, reach: Array) -> Ranges | None:
    """Ranges that hold every closed configuration over |q| ≤ reach (n,); ``None`` where there are none known."""
    if system.rods or np.any(system.moduli) or any(joint.kind.unit == 4 for joint in system.chart.joints):
        return None
    bounds = np.full(system.n_free, np.pi)
    travel = np.zeros(system.n_free)
    travel[system.independent] = reach
    for j in system.dependent[~system.periodic[system.dependent]]:
        most = min((_slide_bound(system, chain, int(j), travel) for chain in system.chains), default=np.inf)
        if not np.isfinite(most):
            return None
        bounds[j] = most
    return Ranges(-bounds[system.dependent], bounds[system.dependent])


def _slide_bound(system: ClosureSystem, chain: Chain, j: int, travel: Array) -> float:
    """Proposition L for the slide θ_j from the rows that a chain enters; ∞ where it does not apply."""
    rows = np.any(chain.weights != 0.0, axis=1)
    others = [other for other in system.chains if np.any(other.weights[rows] != 0.0)]
    sliding = system.dependent[~system.periodic[system.dependent]]
    first = int(np.argmin(chain.prismatic)) if not np.all(chain.prismatic) else len(chain.joints)
    leading = [k for k in range(first) if chain.joints[k] in sliding]
    known = {int(chain.joints[k]) for k in leading}
    foreign = any(
        int(i) in sliding and not (other is chain and int(i) in known) for other in others for i in other.joints
    )
    plain = not (np.any(system.couplings[rows]) or any(other.direction for other in others))
    if j not in known or foreign or not plain:
        return np.inf
    axes, turn = [], np.eye(3)
    for k in range(first):
        turn = turn @ chain.rotations[k]
        axes.append(chain.weights[rows] @ turn @ chain.axes[k])
    slides = np.array([axes[k] for k in leading])
    if np.abs(slides @ slides.T - np.eye(len(leading))).max() > _ORTHONORMAL:
        return np.inf
    total = float(np.linalg.norm(system.offset[rows]))
    for other in others:
        length = np.linalg.norm(other.translations, axis=1).sum() + np.linalg.norm(other.tip)
        length += travel[other.joints[other.prismatic]].sum()
        total += float(np.linalg.norm(other.weights[rows], 2) * length)
    return total * (1.0 + 1e-6) + 1e-9
