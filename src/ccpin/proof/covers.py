"""Claims about regions of q: which cells of a tree lie in proved boxes, and whether these carry one function.

A tree halves the region again and again; its leaves tile it whatever the numbers in the claim are, as corners are
worked out here. A leaf that names a box lies in it, as real numbers (`rounding`). Where two such leaves share a face,
the boxes' parameters have a connected set in common that holds it, so that by lemma G one common point of theirs glues
them along all of it. So nothing that a search does wrong is believed: a cell left out is no part of the cover, a face
left out is unglued.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ccpin.arrays import Array, Indices, Mask
from ccpin.proof.cell_tree import CellsClaim, Integers, faces_of, lie_within
from ccpin.proof.facts import Examined, Fact, Form, provable, require
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes, boxes_of, glued_by


@provable
@dataclass(frozen=True, eq=False)
class RegionCover(CellsClaim):
    """Cells of a region that lie in boxes, and which of these share faces.

    Premises: facts about boxes (`SolutionsInBoxes`), numbered through, then facts that glue them (`GluedBoxes`, `Met`).

    Attributes:
        box: The number of the box that a leaf lies in, or −1, of shape (T,).
        start: The number of the box that the seed is in, or −1, of shape (1,).

    Found: `faces` (F, 2), pairs of boxes whose cells share a face, and `unglued` (U, 2), those that are not glued
    there; `reached` (B,), whether a way over glued faces joins a box to the seed's; `whole` (1,), whether every leaf
    lies in a box; `seed` (1 or 0, N), a configuration to which the seed is known.
    """

    box: Annotated[Indices, Form("T", "i", -1)]
    start: Annotated[Indices, Form("1", "i", -1)]
    theorem = "gluing"

    def examined(self, *premises: Fact) -> Examined:
        """The tree, its cells in their boxes, and its faces."""
        solutions = tuple(premise for premise in premises if type(premise.claim) is SolutionsInBoxes)
        glue = tuple(premise for premise in premises if type(premise.claim) in (GluedBoxes, Met))
        require(len(solutions) + len(glue) == len(premises), "premises of other kinds")
        boxes = boxes_of(solutions)
        tree = self.cells()
        leaves = np.flatnonzero(tree.reached & (self.child < 0))
        named = leaves[self.box[leaves] >= 0]
        require(self.box[leaves] < len(boxes.kappa), "a leaf names no box")
        require(
            lie_within(self.equations, self.region, tree, named, boxes, self.box[named]), "a cell is not in its box"
        )
        faces = faces_of(tree, self.cut, self.child, self.wrapped)
        one, other = self.box[faces.upper], self.box[faces.lower]
        both = (one >= 0) & (other >= 0)
        one, other, turns = one[both], other[both], faces.turns(len(self.lower))[both]
        links = np.concatenate(
            [np.zeros(0, dtype=np.int64), *(_links(fact, solutions, len(boxes.kappa)) for fact in glue)]
        )
        pairs = np.stack([one, other], axis=1)
        glued = np.isin(_keys(one, other, turns, len(boxes.kappa)), links) | ((one == other) & ~turns.any(axis=1))
        return Examined(
            np.ones(1, dtype=np.bool_),
            {
                "faces": pairs,
                "unglued": pairs[~glued],
                "reached": _joined(pairs[glued], int(self.start[0]), len(boxes.kappa)),
                "whole": np.array([len(named) == len(leaves)]),
                "seed": self._seed(glue, solutions),
            },
        )

    def _seed(self, glue: tuple[Fact, ...], solutions: tuple[Fact, ...]) -> Array:
        """θ of the point that is in the seed's box."""
        start = int(self.start[0])
        for fact in glue:
            if start >= 0 and type(fact.claim) is Met:
                own = _numbers(fact, solutions)
                rows = np.flatnonzero((own[fact.claim.first] == start) & (own[fact.claim.second] == start))
                if len(rows):
                    return np.asarray(fact.premises[0].claim.centre[fact.claim.point[rows[:1]]])
        require(start < 0, "nothing says that the seed is in its box")
        return np.zeros((0, self.equations.sizes["N"]))


def over_region(cover: Fact, demanded: Fact | None, asked: bool) -> bool:
    """Whether σ is proved to be one smooth, nonsingular function on all of a cover's region.

    So it is where every leaf lies in a box, all faces are glued and a way over them joins the seed to all boxes;
    `asked`: and if more was asked of the boxes, a fact about the same boxes says that they meet it.
    """
    require([type(fact) is Fact for fact in (cover, *([] if demanded is None else [demanded]))], "no facts")
    require(type(cover.claim) is RegionCover, "no fact about a region")
    if asked:
        boxes = [id(fact) for fact in cover.premises if type(fact.claim) is SolutionsInBoxes]
        if demanded is None or [id(fact) for fact in demanded.premises] != boxes:
            return False
    found = cover.found
    return bool(found["whole"][0] and not len(found["unglued"]) and len(found["seed"]) and found["reached"].all())


def one_function(faces: Indices, unglued: Indices, start: int, count: int) -> Mask:
    """Which of so many boxes together carry one continuous σ, among them the seed's.

    Of two boxes that are unglued the later one is left out; what no way over glued faces joins to the seed's then, too.
    """
    kept = np.full(count, start >= 0)
    for a, b in np.sort(unglued, axis=1):
        if kept[a]:
            kept[a if b == start else b] = False
    return _joined(faces[kept[faces].all(axis=1)], start, count)


def _numbers(fact: Fact, solutions: tuple[Fact, ...]) -> Indices:
    """The cover's numbers of the boxes that a fact glues; −1 of those that are not the cover's."""
    first = dict(
        zip(map(id, solutions), np.cumsum([0, *(len(s.claim.kappa) for s in solutions)]).tolist(), strict=False)
    )
    parts = [
        np.arange(len(s.claim.kappa)) + first[id(s)] if id(s) in first else np.full(len(s.claim.kappa), -1)
        for s in glued_by(fact)
    ]
    return np.concatenate(parts)


def _links(fact: Fact, solutions: tuple[Fact, ...], count: int) -> Integers:
    """The pairs that a fact glues, as keys."""
    numbers, turn = _numbers(fact, solutions), fact.found["turn"]
    one, other = numbers[fact.claim.first], numbers[fact.claim.second]
    kept = (one >= 0) & (other >= 0) & np.all(np.abs(turn) <= 1, axis=1)
    return _keys(one[kept], other[kept], turn[kept], count)


def _keys(one: Indices, other: Indices, turns: Indices, count: int) -> Integers:
    """Pairs of boxes with the turns of the first against the second (−1, 0, 1) as one number, whatever their order."""
    code = ((turns + 1) * 3 ** np.arange(turns.shape[1])).sum(axis=1)
    whole = 3 ** turns.shape[1]
    require(count**2 < 2**62 // whole, "more boxes than numbers for their pairs")
    ahead, back = (one * count + other) * whole + code, (other * count + one) * whole + (whole - 1 - code)
    return np.asarray(np.minimum(ahead, back), dtype=np.int64)


def _joined(pairs: Indices, start: int, count: int) -> Mask:
    """Which of so many boxes a chain of pairs joins to one; none to none (−1)."""
    if start < 0:
        return np.zeros(count, dtype=np.bool_)
    require(start < count, "the seed is in no box")
    graph = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    part = connected_components(graph, directed=False)[1]
    return np.asarray(part == part[start])
