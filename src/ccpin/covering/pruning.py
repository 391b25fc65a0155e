"""Candidates: boxes of all coordinates, narrowed, halved and dropped, in a runner's chunks and within a budget."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array, Indices, Mask, apply, joined, rows_of
from ccpin.covering.cells import CellTree, place
from ccpin.covering.region import Region
from ccpin.covering.runner import Arrays, Runner
from ccpin.proof.equations import Problem, closure_values
from ccpin.proof.narrowing import Candidates, narrowed
from ccpin.proof.ranges import Ranges
from ccpin.proof.rounding import blur
from ccpin.work import Stopped

_RATIO, _CURVED = 2.0, 0.3
_FLOOR = 1e-3
_CHUNK = 1000
_LEAST = 1e-9


def whole_candidates(problem: Problem, ranges: Ranges, cells: Indices, q: Array, width: Array) -> Candidates:
    """One candidate a cell, with the whole ranges."""
    system = problem.system
    centre, half = np.zeros((2, len(cells), system.n_free))
    centre[:, system.dependent] = 0.5 * (ranges.lower + ranges.upper)
    half[:, system.dependent] = 0.5 * (ranges.upper - ranges.lower) + 1e-3 * ranges.edge
    centre[:, system.independent], half[:, system.independent] = q, width
    return Candidates(cells, centre, half, np.zeros((len(cells), system.m, system.n)))


def narrowed_both(problem: Problem, ranges: Ranges, waiting: Candidates, singular: bool = False) -> Candidates:
    """Candidates narrowed with both choices of Ã, without those beyond the ranges.

    Where singular ones are looked for, those that are nonsingular are dropped, unless they meet the end of a range that
    is a limit: beyond the others no configuration goes on (Lemma R of `ccpin.proof.ranges`).
    """
    parts = [rows_of(waiting, slice(0))]
    for first in range(0, len(waiting.cell), _CHUNK):
        part = narrowed(problem, rows_of(waiting, slice(first, first + _CHUNK)))
        if part.cell.size:
            inner = ~ranges.at_limit(*_extent(problem, part)) if singular else None
            parts.append(narrowed(problem, part, True, inner))
    result = joined(parts)
    return rows_of(result, ~beyond(problem, ranges, result))


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


def halved(boxes: Candidates, cut: Indices) -> Candidates:
    """Both halves of candidates, with some roundings to spare."""
    rows, half = np.arange(len(cut)), boxes.half.copy()
    half[rows, cut] *= 0.5
    parts = []
    for side in (-1.0, 1.0):
        centre, grown = boxes.centre.copy(), half.copy()
        centre[rows, cut] += side * half[rows, cut]
        grown[rows, cut] += blur(centre[rows, cut])
        parts.append(boxes._replace(centre=centre, half=grown))
    return joined(parts)


def handed_down(problem: Problem, tree: CellTree, region: Region, waiting: Candidates) -> Candidates:
    """The candidates over the two halves of their cells, which are split."""
    system, parts = problem.system, []
    for side in (0, 1):
        child = tree.child[waiting.cell] + side
        centre, half = waiting.centre.copy(), waiting.half.copy()
        middle, half[:, system.independent] = place(tree, region, child)
        moved = apply(waiting.slopes, middle - centre[:, system.independent])
        off = blur(np.abs(middle) + np.abs(centre[:, system.independent]))
        half[:, system.dependent] += apply(np.abs(waiting.slopes), off) + blur(moved)
        centre[:, system.independent] = middle
        centre[:, system.dependent] += moved
        half[:, system.dependent] += blur(centre[:, system.dependent])
        parts.append(Candidates(child, centre, half, waiting.slopes))
    return joined(parts)


def prune_task(problem: Problem, arrays: Arrays) -> Arrays:
    """`narrowed_both`, `to_halve` between plain arrays: (*ranges, singular, *candidates) → (*candidates, cut, due)."""
    ranges, singular, waiting = Ranges(*arrays[:4]), bool(arrays[4]), Candidates(*arrays[5:])  # type: ignore[arg-type]
    waiting = narrowed_both(problem, ranges, waiting, singular)
    return (*waiting, *to_halve(problem, waiting))


class Pruning:
    """A search by narrowing and halving, within a budget of candidates and as long as its runner is not stopped.

    Attributes:
        over: Whether the budget or the time is spent: candidates are then given back as they are.
        complete: Whether no interrupt was in the way.
    """

    def __init__(self, runner: Runner, ranges: Ranges, budget: int, singular: bool = False) -> None:
        self.runner, self.ranges, self.singular, self._budget = runner, ranges, singular, budget
        self.over, self.complete = budget <= 0, True

    def settled(self, waiting: Candidates, rounds: int) -> Candidates:
        """Candidates narrowed and halved until only their cells' size is in the way, for so many rounds at most."""
        stuck = [rows_of(waiting, slice(0))]
        for _ in range(rounds):
            self._budget -= len(waiting.cell)
            self.over |= self._budget < 0
            if not waiting.cell.size or self.over:
                break
            try:
                waiting, cut, due = self._narrowed(waiting)
            except Stopped:
                self.over, self.complete = True, False
                break
            stuck.append(rows_of(waiting, ~due))
            waiting = halved(rows_of(waiting, due), cut[due])
        return joined([*stuck, waiting])

    def _narrowed(self, waiting: Candidates) -> tuple[Candidates, Indices, Mask]:
        chosen: Arrays = (*self.ranges, np.array(self.singular))
        parts = [slice(k, k + _CHUNK) for k in range(0, len(waiting.cell), _CHUNK)]
        found = self.runner.map(prune_task, [(*chosen, *rows_of(waiting, part)) for part in parts])
        *columns, cut, due = (np.concatenate(column) for column in zip(*found, strict=True))
        return Candidates(*columns), cut, due  # type: ignore[arg-type]
