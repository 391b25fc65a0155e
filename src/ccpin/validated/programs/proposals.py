"""Where the cells of a branch could be, and how far about them a solution is: proposals, which proofs check."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ccpin.arrays import Array
from ccpin.programs.evaluation import values_of
from ccpin.programs.instructions import Code
from ccpin.programs.program_sources import slopes_of
from ccpin.validated.arithmetic.first_order import preconditioned
from ccpin.validated.programs.branch_claim import BranchOverCells, cells_of, placed, tabled, tubes
from ccpin.validated.programs.program_equations import ProgramEquations

_WALK, _STEPS = 40, 4  # points on the way from a known configuration, Newton steps at each
_WIDER = 6.0  # than what is found at a tube's middle: room for the neighbours' tubes
_FLOOR = 1e-13  # of a tube's radius


def proposed_branch(equations: ProgramEquations, lower: Array, upper: Array, cells: Sequence[int]) -> BranchOverCells:
    """The branch of the configuration that the program was recorded at, walked along straight lines of (q, p)."""
    source, counts = equations.source, np.array(cells, dtype=np.int64)
    grid = cells_of(lower, upper, counts)
    rows, n, m = len(grid.centre), len(lower), equations.n_y
    by_y, by_q = (slopes_of(source.closure, places) for places in (source.dependent, equations.places))
    start, known, _ = map(np.array, equations.apart(source.samples[0]))
    y = np.broadcast_to(known, (rows, m)).copy()

    def at(code: Code, q: Array, y: Array, columns: int) -> Array:
        x = np.zeros((source.closure.inputs, rows))
        x[list(equations.places)], x[list(source.dependent)] = q.T, y.T
        values = values_of(code, list(x), np)
        table = np.stack([np.broadcast_to(values[k], (rows,)) for k in code.outputs], axis=1)
        return np.asarray(table.reshape(rows, m, columns), dtype=np.float64)

    with np.errstate(all="ignore"):
        for t in np.linspace(0.0, 1.0, _WALK + 1)[1:]:
            q = start + t * (grid.centre - start)
            for _ in range(_STEPS):
                y = y - _solved(at(by_y, q, y, m), at(source.closure, q, y, 1))[:, :, 0]
        inverse = _solved(at(by_y, q, y, m), np.broadcast_to(np.eye(m), (rows, m, m)))
        slopes = -inverse @ at(by_q, q, y, n)
    radius = np.full((rows, m), 1.0)
    claim = BranchOverCells(equations, lower, upper, counts, y, slopes, radius, inverse)
    inside = tubes(claim, grid, slice(None), np.zeros_like(radius))
    off = preconditioned(inverse, tabled(equations.closure, placed(equations, *inside), m))[:, :, 0]
    radius = np.nan_to_num(_WIDER * np.maximum(off, off.max(axis=1, keepdims=True) / 50) + _FLOOR, nan=1.0)
    return BranchOverCells(equations, lower, upper, counts, y, slopes, radius, inverse)


def _solved(matrix: Array, right: Array) -> Array:
    """A⁻¹B; no numbers where A is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right), dtype=np.float64)
    except np.linalg.LinAlgError:
        return np.full_like(right, np.nan)
