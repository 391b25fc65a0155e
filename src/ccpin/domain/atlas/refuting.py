"""What refutes that σ reaches all of a region: an empty cell, or a singular configuration beside a certified one."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array, rows_of
from ccpin.covering.cells import CellStatus, CellTree, place
from ccpin.covering.region import Region
from ccpin.domain.closures.system import Reading
from ccpin.domain.paths.refutation import singular_witness
from ccpin.domain.paths.walker import Walker
from ccpin.domain.singular.marking import beside_certified, sigma_at
from ccpin.errors import SingularConfigurationError
from ccpin.proof.equations import closures_of
from ccpin.proof.facts import Fact, prove_some
from ccpin.proof.solutions import Met, boxes_of
from ccpin.proof.verdict import Witness

_TRIED = 8  # faces


def refutation_of(reading: Reading, tree: CellTree, region: Region, solutions: tuple[Fact, ...]) -> Witness | None:
    """A place of the region at which σ is proved not to exist or to be singular, or ``None``."""
    empty = tree.leaves(CellStatus.EMPTY)
    if empty.size:
        largest = empty[[int(np.argmax(np.prod(tree.size[empty].astype(np.float64), axis=1)))]]
        return Witness("empty", place(tree, region, largest)[0][0], None, 0.0)
    problem, boxes = reading.problem, boxes_of(solutions)
    contacts = beside_certified(tree, region, CellStatus.SINGULAR)
    for k in range(min(_TRIED, len(contacts.cell))):
        one = rows_of(contacts, slice(k, k + 1))
        theta = sigma_at(problem, tree, region, boxes, one)[0]
        number = tree.box[one.leaf]
        delta = region.position(one.at_leaf) - boxes.centre[number][:, problem.system.independent]
        met = Met(closures_of(problem), number, number, delta, delta, np.zeros(1, dtype=np.int64))
        found = _witness_from(reading, tree, region, theta, int(one.cell[0]), met, solutions)
        if found is not None:
            return found
    return None


def _witness_from(
    reading: Reading, tree: CellTree, region: Region, theta: Array, cell: int, met: Met, solutions: tuple[Fact, ...]
) -> Witness | None:
    """A singular configuration between θ, if that is met in a certified box, and the far corners of a cell."""
    lower = region.position(tree.lower[cell])
    upper = region.position(tree.lower[cell] + tree.size[cell])
    problem, q = reading.problem, theta[reading.system.independent]
    targets = [np.where(side, upper, lower) for side in _corners(len(q))]
    still = PPoly(np.stack([np.zeros((1, len(q))), q[None]]), np.array([0.0, 1.0]))
    try:
        walker = Walker(problem, still, np.zeros(len(q)), theta)
    except SingularConfigurationError:
        return None
    same = prove_some(met, walker.start, *solutions)[1]
    return singular_witness(walker, reading, targets) if same[0] else None


def _corners(n: int) -> list[Array]:
    return [np.array([(k >> i) & 1 for i in range(n)], dtype=np.bool_) for k in range(2**n)]
