"""What a flood hands to the kernel: its members' cells and boxes, the faces at which these meet, and what it gets."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.control.stability.set_point.certified_cells import CellStore
from ccpin.control.stability.set_point.set_point_equations import SetPointEquations
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved
from ccpin.covering.claims import Seams, proved_boxes, proved_glue
from ccpin.proof.facts import Fact, prove, require
from ccpin.proof.rounding import UNIT_ROUNDOFF

_ONE = 16.0 * UNIT_ROUNDOFF  # of 1 + |q|: corners so near are one that was rounded twice


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
    corners = np.array([(store[k].lower, store[k].upper) for k in members])[kept]
    lower, upper = aligned(corners[:, 0], corners[:, 1])
    row = {number: k for k, number in enumerate(numbers)}
    pairs = [(row[i], row[j]) for i in numbers for j in sorted(store[i].neighbours & row.keys()) if i < j]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    middle = 0.5 * (np.maximum(lower[first], lower[second]) + np.minimum(upper[first], upper[second]))
    q = solutions.claim.centre[:, problem.system.independent]
    glue = proved_glue(store.problem, Seams(first, second, middle - q[first], middle - q[second]), (solutions,))
    return prove(SublevelProved(equations, lower, upper), solutions, *glue)


def aligned(lower: Array, upper: Array) -> tuple[Array, Array]:
    """Corners (K, n) of which those that are one but for roundings are one to the last bit."""
    both = np.concatenate([lower, upper])
    for column in both.T:
        order = np.argsort(column)
        values = column[order]
        begins = np.flatnonzero(np.diff(values, prepend=-np.inf) > _ONE * (1.0 + np.abs(values)))
        ends = np.append(begins[1:], len(values)) - 1
        column[order] = np.repeat(0.5 * (values[begins] + values[ends]), ends + 1 - begins)
    return both[: len(lower)], both[len(lower) :]
