"""What a flood hands to the kernel: its members' cells and boxes, the faces at which these meet, and what it gets."""

from __future__ import annotations

import numpy as np

from ccpin.control.stability.set_point.certified_cells import CellStore
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved
from ccpin.covering.claims import Seams, proved_boxes, proved_glue
from ccpin.proof.facts import Fact, prove, require


def proved_sublevel(equations: SetPointEquations, store: CellStore, members: tuple[int, ...]) -> Fact:
    """The fact about a level on the boundary of members, as far as these are proved and glued.

    Raises:
        NotProvedError: No level above 0 is proved.
    """
    require(len(members) > 0, "no cells")
    problem = equations.closures.problem
    solutions, kept = proved_boxes(store.problem, store.boxes(members))
    require(kept.any(), "no cell is proved")
    numbers = [members[k] for k in np.flatnonzero(kept)]
    lower, upper = (np.array([getattr(store[k], side) for k in numbers]) for side in ("lower", "upper"))
    row = {number: k for k, number in enumerate(numbers)}
    pairs = [(row[i], row[j]) for i in numbers for j in sorted(store[i].neighbours & row.keys()) if i < j]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    middle = 0.5 * (np.maximum(lower[first], lower[second]) + np.minimum(upper[first], upper[second]))
    q = solutions.claim.centre[:, problem.system.independent]
    glue = proved_glue(store.problem, Seams(first, second, middle - q[first], middle - q[second]), (solutions,))
    return prove(SublevelProved(equations, lower, upper), solutions, *glue)
