"""Cells over which a closed configuration is proved to be singular.

An undecided cell beside a certified one is searched along lines from σ there, across the fold that is near and along
each coordinate, where `folds.Folds` expects the line to meet the fold in the cell or beside it. Where Theorem S of
`folds` proves a singular configuration, the cell that holds its q is a neighbourhood of it.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ccpin.arrays import Array, Indices, rows_of
from ccpin.covering.cells import CellStatus, CellTree, SingularCells, leaves_holding
from ccpin.covering.faces import CellFaces, contacts_of
from ccpin.covering.proposals.solving import newton
from ccpin.covering.region import Region
from ccpin.covering.runner import Runner
from ccpin.domain.singular.folds import Folds, SearchedLines, singular_points
from ccpin.proof.equations import Problem
from ccpin.proof.newton import Boxes, predict
from ccpin.proof.rounding import blur

_CHUNK = 4_000_000  # bytes of second derivatives of φ at a time
_REACH = 2.0  # of a cell: how far beside it a fold is looked for
_NEWTON = 12  # steps from a box's prediction of σ, which is within its radius
_SOUGHT = 500  # cells at a time: between two looks for an interrupt


def mark_singular(runner: Runner, tree: CellTree, region: Region, boxes: Boxes) -> Iterator[SingularCells]:
    """Tell undecided cells that hold the q of a singular configuration from those of which nothing is known.

    Yields:
        Cells that were marked.

    Raises:
        Stopped: An interrupt was asked for.
    """
    problem = runner.problem
    contacts = beside_certified(tree, region, CellStatus.UNDECIDED)
    size = max(1, _CHUNK // (problem.system.m * problem.system.n_free**2 * 8))
    for first in range(0, len(contacts.cell), size):
        runner.check()
        part = rows_of(contacts, slice(first, first + size))
        start = sigma_at(problem, tree, region, boxes, part)
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


def beside_certified(tree: CellTree, region: Region, status: CellStatus) -> CellFaces:
    """For each leaf of a status that touches a certified one, the largest face they share."""
    contacts = contacts_of(tree, region, tree.leaves(status))
    rows = np.flatnonzero(tree.status[contacts.leaf] == CellStatus.CERTIFIED)
    order = rows[np.lexsort((contacts.leaf[rows], -contacts.area[rows], contacts.cell[rows]))]
    first = order[np.flatnonzero(np.diff(contacts.cell[order], prepend=-1))]
    return rows_of(contacts, first)


def sigma_at(problem: Problem, tree: CellTree, region: Region, boxes: Boxes, contacts: CellFaces) -> Array:
    """σ at the faces' middles as the certified sides have it, to rounding, q in the uncertified sides' coordinates."""
    known = boxes.take(tree.box[contacts.leaf])
    delta = region.position(contacts.at_leaf) - known.centre[:, problem.system.independent]
    theta = newton(problem, predict(problem, known, delta), _NEWTON).theta
    theta[:, problem.system.independent] = region.position(contacts.at_cell)
    return theta


def _marked(
    tree: CellTree, region: Region, found: SearchedLines, independent: Indices, stretch: Array
) -> SingularCells:
    """Mark the undecided leaves that hold a singular q with its error, and with what rounds q₀ + s d and its turns."""
    theta = found.theta.copy()
    theta[:, independent] = region.reduce(theta[:, independent])
    error = (found.error * np.maximum(1.0, stretch))[:, None] + blur(found.theta[:, independent])
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
