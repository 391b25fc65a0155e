"""Where the inputs of a certified program are: a box about the tubes of its branch, and states to test it at."""

from __future__ import annotations

import numpy as np

from ccpin.arrays import Array
from ccpin.proof.facts import Fact
from ccpin.validated.programs.branch_claim import cells_of

_OUT = 1.0 + 2.0**-40  # on sums and products of doubles
_LOSS = 2.0**-50  # of a difference's size


def tube_hull(branch: Fact, start: Array) -> tuple[Array, Array]:
    """Lower and upper numbers of all y within `start` of the branch, over all of its box."""
    claim = branch.claim
    cells = cells_of(claim.lower, claim.upper, claim.counts)
    far = (np.abs(claim.slopes) * cells.half[:, None, :]).sum(axis=2) + branch.found["image"] + start
    far = far * _OUT + _LOSS * np.abs(claim.centre)
    return (claim.centre - far).min(axis=0), (claim.centre + far).max(axis=0)


def example_rows(branch: Fact, bounds: Array) -> list[tuple[float, ...]]:
    """Inputs on the branch: the middle cell's middle, then the ends of each axis; else at bounds or between."""
    claim = branch.claim
    cells = cells_of(claim.lower, claim.upper, claim.counts)
    middle = np.ravel_multi_index(tuple(claim.counts // 2), tuple(claim.counts))
    places = [(int(middle), cells.centre[middle])]
    for axis, count in enumerate(claim.counts.tolist()):
        for number, end in ((0, claim.lower), (count - 1, claim.upper)):
            cell = claim.counts // 2
            cell[axis] = number
            at = int(np.ravel_multi_index(tuple(cell), tuple(claim.counts)))
            q = cells.centre[at].copy()
            q[axis] = end[axis]
            places.append((at, q))
    rng, rows = np.random.default_rng(0), list[tuple[float, ...]]()
    for number, (at, q) in enumerate(places):
        y = claim.centre[at] + claim.slopes[at] @ (q - cells.centre[at])
        rest = bounds * (rng.choice((-1.0, 1.0), len(bounds)) if number % 2 else rng.uniform(-1.0, 1.0, len(bounds)))
        rows.append(tuple(claim.equations.arranged(q.tolist(), y.tolist(), rest.tolist())))
    return rows
