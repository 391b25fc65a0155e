"""What the search for an atlas hands to the kernel besides boxes: the tree of cells; and what it gets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, rows_of
from ccpin.covering.cells import CellStatus, CellTree
from ccpin.covering.claims import Seams, cells_of, proved_points
from ccpin.covering.faces import CellFaces, contacts_of
from ccpin.covering.region import Region
from ccpin.proof.covers import RegionCover
from ccpin.proof.demanded import Demanded
from ccpin.proof.equations import Problem, closures_of
from ccpin.proof.facts import Fact, prove, prove_some
from ccpin.proof.newton import Boxes
from ccpin.proof.solutions import Met, boxes_of


class ProvedCover(NamedTuple):
    """The facts about a region, about what a workspace was asked for (`Demanded`), and about empty cells."""

    cover: Fact
    demanded: Fact | None
    empty: tuple[Fact, ...] = ()


def proved_cover(
    problem: Problem, region: Region, tree: CellTree, seed: Array, solutions: tuple[Fact, ...], glue: tuple[Fact, ...]
) -> ProvedCover:
    """The fact about a region's cells, those that are certified lying in boxes of facts, numbered through."""
    equations, demanded = closures_of(problem), None
    if problem.requirements is not None:
        demanded = prove(Demanded.of(equations, problem.requirements), *solutions)
    start, met = _started(problem, region, tree, seed, boxes_of(solutions), solutions)
    claim = RegionCover(
        equations,
        **cells_of(region, tree),
        box=np.where(tree.status == CellStatus.CERTIFIED, tree.box, -1).astype(np.int64),
        start=np.array([start], dtype=np.int64),
    )
    return ProvedCover(prove(claim, *solutions, *glue, *met), demanded)


def seams_of(
    problem: Problem, region: Region, tree: CellTree, boxes: Boxes, contacts: CellFaces | None = None
) -> Seams:
    """Common points of boxes: the middles of faces that certified cells share (default: all)."""
    if contacts is None:
        contacts = contacts_of(tree, region, tree.leaves(CellStatus.CERTIFIED))
        contacts = rows_of(contacts, contacts.upper & (tree.status[contacts.leaf] == CellStatus.CERTIFIED))
    first, second = tree.box[contacts.cell], tree.box[contacts.leaf]
    q = boxes.centre[:, problem.system.independent]
    return Seams(
        first, second, region.position(contacts.at_cell) - q[first], region.position(contacts.at_leaf) - q[second]
    )


def _started(
    problem: Problem, region: Region, tree: CellTree, seed: Array, boxes: Boxes, solutions: tuple[Fact, ...]
) -> tuple[int, tuple[Fact, ...]]:
    """The number of the box that carries the seed (−1: none is proved to), and the fact that it does."""
    independent = problem.system.independent
    q = region.reduce(seed[None, independent])
    leaf = int(tree.locate(region.cell_coordinates(q))[0])
    if leaf < 0 or tree.status[leaf] != CellStatus.CERTIFIED or tree.box[leaf] < 0:
        return -1, ()
    number = tree.box[[leaf]]
    delta = q - boxes.centre[number][:, independent]
    (points, near), numbers = proved_points(problem, seed[None]), np.asarray(number, dtype=np.int64)
    if not near.size:
        return -1, ()
    claim = Met(closures_of(problem), numbers, numbers, delta, delta, point=np.zeros(1, dtype=np.int64))
    met, held = prove_some(claim, points, *solutions)
    return (int(number[0]), (met,)) if held[0] else (-1, ())
