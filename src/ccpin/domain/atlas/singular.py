"""Cells over which a closed configuration is proved to be singular, and what refutes that σ reaches all of a region.

An undecided cell beside a certified one is searched along lines from σ there, across the fold that is near and along
each coordinate, where `ccpin.domain.folds.Folds` expects the line to meet the fold in the cell or beside it. Where
Theorem S of `ccpin.domain.folds` proves a singular configuration, the cell that holds its q is a neighbourhood of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PPoly

from ccpin.arrays import Array, Indices, rows_of
from ccpin.domain.atlas.cells import CellStatus, CellTree, Contacts, Region, contacts_of, leaves_holding, place
from ccpin.domain.atlas.run import Runner
from ccpin.domain.closures.system import Reading
from ccpin.domain.folds import Folds, SingularPoints, singular_points
from ccpin.domain.newton import newton
from ccpin.domain.refutation import singular_witness
from ccpin.domain.walker import Walker
from ccpin.errors import SingularConfigurationError
from ccpin.proof.equations import Problem
from ccpin.proof.newton import Boxes, encloses, predict
from ccpin.proof.verdict import Witness

_CHUNK = 4_000_000
_REACH = 2.0  # of a cell: how far beside it a fold is looked for
_NEWTON = 12
_SOUGHT = 500
_TRIED = 8


class SingularCells(NamedTuple):
    """Cells that hold the q of a singular configuration.

    Attributes:
        cell: Their numbers, of shape (K,).
        theta: One such configuration over each, to rounding, of shape (K, n′).
    """

    cell: Indices
    theta: Array

    @classmethod
    def none(cls, n_free: int) -> SingularCells:
        """None yet."""
        return cls(np.zeros(0, dtype=np.intp), np.zeros((0, n_free)))


def mark_singular(runner: Runner, tree: CellTree, region: Region, boxes: Boxes) -> Iterator[SingularCells]:
    """Tell undecided cells that hold the q of a singular configuration from those of which nothing is known.

    Yields:
        Cells that were marked.

    Raises:
        Stopped: An interrupt was asked for.
    """
    problem = runner.problem
    contacts = _beside_certified(tree, region, CellStatus.UNDECIDED)
    size = max(1, _CHUNK // (problem.system.m * problem.system.n_free**2 * 8))
    for first in range(0, len(contacts.cell), size):
        runner.check()
        part = rows_of(contacts, slice(first, first + size))
        start = _sigma_at(problem, tree, region, boxes, part)
        reach = _REACH * (
            region.position(tree.lower[part.cell] + tree.size[part.cell]) - region.position(tree.lower[part.cell])
        )
        folds = Folds.near(problem, start)
        bending = folds.bending(problem, start)
        for directions in folds.directions():
            ahead = folds.along(bending, directions)
            with np.errstate(invalid="ignore"):
                near = np.all(np.abs(ahead.along[:, None] * directions) <= reach, axis=1)
            rows = np.flatnonzero(near & (tree.status[part.cell] == CellStatus.UNDECIDED))
            if rows.size:
                found = singular_points(problem, start[rows], directions[rows], rows_of(ahead, rows))
                yield _marked(tree, region, found, problem.system.independent, np.abs(directions[rows]).max(axis=1))


def refuting(reading: Reading, tree: CellTree, region: Region, boxes: Boxes) -> Witness | None:
    """A place of the region at which σ is proved not to exist or to be singular, or ``None``."""
    empty = tree.leaves(CellStatus.EMPTY)
    if empty.size:
        largest = empty[[int(np.argmax(np.prod(tree.size[empty].astype(np.float64), axis=1)))]]
        return Witness("empty", place(tree, region, largest)[0][0], None, 0.0)
    problem = reading.problem
    contacts = _beside_certified(tree, region, CellStatus.SINGULAR)
    for k in range(min(_TRIED, len(contacts.cell))):
        one = rows_of(contacts, slice(k, k + 1))
        theta = _sigma_at(problem, tree, region, boxes, one)[0]
        known = boxes.take(tree.box[one.leaf])
        delta = region.position(one.at_leaf) - known.centre[:, problem.system.independent]
        found = _witness_from(reading, tree, region, theta, int(one.cell[0]), (known, delta))
        if found is not None:
            return found
    return None


def _witness_from(
    reading: Reading, tree: CellTree, region: Region, theta: Array, cell: int, known: tuple[Boxes, Array]
) -> Witness | None:
    """A singular configuration between θ, σ in a certified box at parameters δ, and the far corners of a cell."""
    lower = region.position(tree.lower[cell])
    upper = region.position(tree.lower[cell] + tree.size[cell])
    problem, q = reading.problem, theta[reading.system.independent]
    targets = [np.where(side, upper, lower) for side in _corners(len(q))]
    still = PPoly(np.stack([np.zeros((1, len(q))), q[None]]), np.array([0.0, 1.0]))
    try:
        walker = Walker(problem, still, np.zeros(len(q)), theta)
    except SingularConfigurationError:
        return None
    same = encloses(problem, *known, walker.point.centre, walker.point.radius, walker.point.modes)
    return singular_witness(walker, reading, targets) if same[0] else None


def _corners(n: int) -> list[Array]:
    return [np.array([(k >> i) & 1 for i in range(n)], dtype=np.bool_) for k in range(2**n)]


def _beside_certified(tree: CellTree, region: Region, status: CellStatus) -> Contacts:
    """For each leaf of a status that touches a certified one, the largest face they share."""
    contacts = contacts_of(tree, region, tree.leaves(status))
    rows = np.flatnonzero(tree.status[contacts.leaf] == CellStatus.CERTIFIED)
    order = rows[np.lexsort((contacts.leaf[rows], -contacts.area[rows], contacts.cell[rows]))]
    first = order[np.flatnonzero(np.diff(contacts.cell[order], prepend=-1))]
    return rows_of(contacts, first)


def _sigma_at(problem: Problem, tree: CellTree, region: Region, boxes: Boxes, contacts: Contacts) -> Array:
    """σ at the faces' middles as the certified sides have it, to rounding, q in the uncertified sides' coordinates."""
    known = boxes.take(tree.box[contacts.leaf])
    delta = region.position(contacts.at_leaf) - known.centre[:, problem.system.independent]
    theta = newton(problem, predict(problem, known, delta), _NEWTON).theta
    theta[:, problem.system.independent] = region.position(contacts.at_cell)
    return theta


def _marked(
    tree: CellTree, region: Region, found: SingularPoints, independent: Indices, stretch: Array
) -> SingularCells:
    """Mark the undecided leaves that hold a singular q with its error."""
    theta = found.theta.copy()
    theta[:, independent] = region.reduce(theta[:, independent])
    error = (found.error * np.maximum(1.0, stretch))[:, None]
    inside = found.proved & np.all(np.isfinite(theta), axis=1)
    theta, error = theta[inside], error[inside]
    leaf = leaves_holding(tree, region, theta[:, independent], error)
    rows = np.flatnonzero((leaf >= 0) & (tree.status[leaf] == CellStatus.UNDECIDED))
    cells, first = np.unique(leaf[rows], return_index=True)
    tree.status[cells] = CellStatus.SINGULAR
    return SingularCells(cells, theta[rows[first]])


def mark_in_cells(
    runner: Runner, tree: CellTree, region: Region, cells: Indices, theta: Array
) -> Iterator[SingularCells]:
    """Tell undecided cells that hold the q of a singular configuration, looked for from θ (B, n′), from others.

    Yields:
        Cells that were marked.

    Raises:
        Stopped: An interrupt was asked for.
    """
    problem = runner.problem
    for directions in Folds.near(problem, theta).directions():
        for first in range(0, len(cells), _SOUGHT):
            runner.check()
            part = slice(first, first + _SOUGHT)
            rows = first + np.flatnonzero(tree.status[cells[part]] == CellStatus.UNDECIDED)
            if rows.size:
                found = singular_points(problem, theta[rows], directions[rows])
                yield _marked(tree, region, found, problem.system.independent, np.abs(directions[rows]).max(axis=1))
