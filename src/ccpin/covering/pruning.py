"""Candidates: boxes of all coordinates, narrowed, halved and dropped, in a runner's chunks and within a budget."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Indices, Mask, joined, rows_of
from ccpin.covering.runner import Arrays, Runner
from ccpin.proof.candidates import halved, narrowed_both, to_halve
from ccpin.proof.equations import Problem
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Ranges
from ccpin.work import Stopped

_CHUNK = 1000  # boxes a task: what is narrowed in one pass over arrays, and sent to a worker at once


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
            waiting = halved(self.runner.problem, rows_of(waiting, due), cut[due])
        return joined([*stuck, waiting])

    def _narrowed(self, waiting: Candidates) -> tuple[Candidates, Indices, Mask]:
        chosen: Arrays = (*self.ranges, np.array(self.singular))
        parts = [slice(k, k + _CHUNK) for k in range(0, len(waiting.cell), _CHUNK)]
        found = self.runner.map(prune_task, [(*chosen, *rows_of(waiting, part)) for part in parts])
        *columns, cut, due = (np.concatenate(column) for column in zip(*found, strict=True))
        return Candidates(*columns), cut, due  # type: ignore[arg-type]
