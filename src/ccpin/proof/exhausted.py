"""Claims about all closed configurations over a region: over which cells there is none, or none that is singular.

Branch and prune: one candidate holds everything over the region within the ranges of the dependent coordinates, which
are derived here (Lemma R). It is narrowed (Proposition N) and halved, in all coordinates; where no candidate is left
over a cell, nothing is, nor as much as `BEYOND` beside it. So a search that finds a tree of cells may do as it likes:
it is gone through again.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.proof.candidates import BEYOND, halved, narrowed_both, over_all, steepness, to_halve
from ccpin.proof.cell_tree import WHOLE, CellRegion, CellsClaim, Integers
from ccpin.proof.emptiness import empty_by, empty_cells, ends_over, groups_of, platform_of
from ccpin.proof.equations import Problem
from ccpin.proof.facts import Examined, Fact, Form, provable, require
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Ranges, proved_ranges
from ccpin.proof.rounding import blur, widened
from ccpin.work import check

_AT_ONCE = 20_000  # cells: bounds memory
ROUNDS = 60
"""How often candidates over a cell are narrowed and halved before the cell is."""
_MOST = 50_000_000  # candidates: a forged tree costs time, not for ever
_DEEPER = 1  # halvings of each edge of a cell that the claim does not keep and the search needed not


@provable
@dataclass(frozen=True, eq=False)
class Excluded(CellsClaim):
    """Over no q of some leaves is there a closed configuration that keeps the limits.

    `singular`: or none that is singular or at a limit.

    Attributes:
        kept: Leaves of which nothing is to be said, of shape (T,).
        limits: Of the dependent coordinates, ±`NO_LIMIT` where there is none, of shape (m, 2).
        middle: Of full turns, of shape (m,): half a turn from it they are cut open.
        singular: Of shape (1,).

    Found: `empty` (T,), the leaves of which this is proved.
    """

    kept: Mask
    limits: Array
    middle: Array
    singular: Mask
    theorem = "counting"
    forms = MappingProxyType(
        {
            **CellsClaim.forms,
            "kept": Form("T", "b"),
            "limits": Form("M2"),
            "middle": Form("M"),
            "singular": Form("1", "b"),
        }
    )

    def examined(self, *premises: Fact) -> Examined:
        """Branch and prune down the tree, as far as a leaf below is not kept."""
        require(not premises, "what is excluded rests on nothing else")
        require(self.equations.system.moduli == 0.0, "rows modulo something hold elsewhere too")
        tree = self.cells()
        asked, problem, ranges = holding(tree.reached, self.child, ~self.kept), self.equations.problem, self.ranges()
        root, tried, held = over_all(problem, ranges, self.lower, self.upper), 0, [np.zeros(0, dtype=np.intp)]
        with np.errstate(all="ignore"):
            waiting = over_cells(problem, self.region, tree, root)
            while (waiting := rows_of(waiting, asked[waiting.cell])).cell.size:
                tried += len(waiting.cell)
                require(tried < _MOST, "more candidates than are looked at")
                waiting = _settled(problem, ranges, waiting, bool(self.singular[0]))
                leaves = self.child[waiting.cell] < 0
                held.append(self._held(problem, ranges, rows_of(waiting, leaves)))
                waiting = handed_down(problem, self.region, tree, self.child, rows_of(waiting, ~leaves))
        empty = tree.reached & (self.child < 0) & ~self.kept
        empty[np.concatenate(held)] = False
        return Examined(np.ones(1, dtype=np.bool_), {"empty": empty})

    def ranges(self) -> Ranges:
        """The ranges of the dependent coordinates over the region (Lemma R).

        Raises:
            NotProvedError: One is not bounded.
        """
        return proved_ranges(self.equations.system, self.middle, (self.lower, self.upper), self.limits)

    def _held(self, problem: Problem, ranges: Ranges, waiting: Candidates) -> Indices:
        """The leaves over which something is left of candidates, if these are halved a few times more."""
        independent = problem.system.independent
        for _ in range(_DEEPER * len(independent)):
            if not waiting.cell.size:
                break
            moved = steepness(problem, waiting.centre)[:, independent] * waiting.half[:, independent]
            waiting = halved(problem, waiting, independent[np.argmax(moved, axis=1)])
            waiting = _settled(problem, ranges, waiting, bool(self.singular[0]))
        return np.asarray(waiting.cell)


@provable
@dataclass(frozen=True, eq=False)
class Unreachable(CellsClaim):
    """Over some leaves no closed configuration is, by the triangle inequality or by Theorem E with weights λ.

    Attributes:
        cell: The leaves, of shape (K,).
        weights: λ of the legs of the platform (`emptiness.platform_of`), of shape (K, legs); without any: (K, 0).

    Found: `empty` (T,), the leaves of which this is proved.
    """

    cell: Indices
    weights: Array
    theorem = "platform"
    forms = MappingProxyType(
        {
            **CellsClaim.forms,
            "cell": Form("K", "i", 0),
            "weights": Form("Kl"),
        }
    )

    def examined(self, *premises: Fact) -> Examined:
        """Both theorems, for all leaves."""
        require(not premises, "what is out of reach rests on nothing else")
        system, tree = self.equations.system, self.cells()
        require((self.cell < len(self.child)) & (self.child[self.cell % len(self.child)] < 0), "no leaves")
        groups, platform = groups_of(system), platform_of(system)
        empty = np.zeros(len(self.child), dtype=np.bool_)
        for first in range(0, len(self.cell), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            cells, weights = self.cell[part], self.weights[part]
            centre = self.region.position(tree.lower[cells] + 0.5 * tree.size[cells])[0]
            half = 0.5 * (self.upper - self.lower) * (tree.size[cells] / WHOLE)
            proved = empty_cells(system, groups, centre, half)
            if platform is not None and weights.shape[1] == len(platform.lengths):
                with np.errstate(all="ignore"):
                    proved |= empty_by(platform, ends_over(system, platform, centre, half), weights)[0]
            empty[cells[proved]] = True
        return Examined(np.ones(1, dtype=np.bool_), {"empty": empty & tree.reached})


class HasCorners(Protocol):
    """Cells, in units of 2⁻³² of their region."""

    @property
    def lower(self) -> Integers:
        """Lower corners, of shape (T, n)."""

    @property
    def size(self) -> Integers:
        """Edge lengths, of shape (T, n)."""


def handed_down(
    problem: Problem, region: CellRegion, tree: HasCorners, child: Indices, waiting: Candidates
) -> Candidates:
    """The candidates over both halves of their cells."""
    halves = [waiting._replace(cell=child[waiting.cell] + side) for side in (0, 1)]
    return over_cells(problem, region, tree, joined(halves))


def over_cells(problem: Problem, region: CellRegion, tree: HasCorners, waiting: Candidates) -> Candidates:
    """What candidates hold over their cells, and `BEYOND` more each way, but where the region has no width.

    |y − y_c − S(q − q_c)| ≤ h_y is the same from whatever q_c it is measured, y_c moved with it: here from the cell's
    middle.
    """
    system, slopes, centre, half = problem.system, waiting.slopes, waiting.centre.copy(), waiting.half.copy()
    middle = region.position(tree.lower[waiting.cell] + 0.5 * tree.size[waiting.cell])[0]
    edge = 0.5 * (region.upper - region.lower) * (tree.size[waiting.cell] / WHOLE)
    moved = middle - centre[:, system.independent]
    centre[:, system.independent] = middle
    centre[:, system.dependent] += apply(slopes, moved)
    half[:, system.independent] = np.where(region.upper > region.lower, widened(middle, edge) + BEYOND, 0.0)
    spare = blur(centre[:, system.dependent]) + apply(np.abs(slopes), blur(moved)) * (1 + system.n)
    half[:, system.dependent] += spare
    return waiting._replace(centre=centre, half=half)


def holding(reached: Mask, child: Indices, leaves: Mask) -> Mask:
    """Whether a cell holds one of some leaves, of shape (T,)."""
    inner, parent = np.flatnonzero(reached & (child >= 0)), np.full(len(child), -1, dtype=np.int64)
    for side in (0, 1):
        parent[child[inner] + side] = inner
    asked, cells = np.zeros(len(child), dtype=np.bool_), np.flatnonzero(reached & (child < 0) & leaves)
    while cells.size:
        asked[cells] = True
        above = np.unique(parent[cells])
        cells = above[(above >= 0) & ~asked[above]]
    return asked


def _settled(problem: Problem, ranges: Ranges, waiting: Candidates, singular: bool) -> Candidates:
    """Candidates narrowed and halved until only their cells' size is in the way."""
    stuck = [rows_of(waiting, slice(0))]
    for _ in range(ROUNDS):
        if not waiting.cell.size:
            break
        check()
        waiting = narrowed_both(problem, ranges, waiting, singular)
        cut, due = to_halve(problem, waiting)
        stuck.append(rows_of(waiting, ~due))
        waiting = halved(problem, rows_of(waiting, due), cut[due])
    return joined([*stuck, waiting])
