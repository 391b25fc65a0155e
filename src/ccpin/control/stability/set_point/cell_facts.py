"""What searches about a set point hand to the kernel: cells and their boxes, the faces at which they meet."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.set_point.certified_cells import CellStore
from ccpin.control.stability.set_point.set_point_cells import SetPointCells
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.covering.claims import Seams, proved_boxes, proved_glue
from ccpin.proof.facts import Fact, prove, require


def proved_of_cells(
    kind: type[SetPointCells], equations: SetPointEquations, store: CellStore, members: Iterable[int], *more: Array
) -> Fact:
    """The fact about members, as far as these are proved and glued; `more`: what its kind says besides of cells.

    Raises:
        NotProvedError: What is claimed is not proved of them.
    """
    members = tuple(members)
    require(len(members) > 0, "no cells")
    problem = equations.closures.problem
    solutions, kept = proved_boxes(store.problem, store.boxes(members))
    require(kept.any(), "no cell is proved")
    numbers = [members[k] for k in np.flatnonzero(kept)]
    lower, upper = (np.array([getattr(store[k], side) for k in numbers]) for side in ("lower", "upper"))
    row = {number: k for k, number in enumerate(numbers)}
    found = {(min(i, j), max(i, j)) for i in numbers for j in store[i].neighbours & row.keys()}
    first, second = np.array([(row[i], row[j]) for i, j in sorted(found)], dtype=np.int64).reshape(-1, 2).T
    middle = 0.5 * (np.maximum(lower[first], lower[second]) + np.minimum(upper[first], upper[second]))
    q = solutions.claim.centre[:, problem.system.independent]
    glue = proved_glue(store.problem, Seams(first, second, middle - q[first], middle - q[second]), (solutions,))
    return prove(kind(equations, lower, upper, *more), solutions, *glue)
