"""Claims about regions of q: which cells of a tree lie in proved boxes, and whether these carry one function.

A tree halves the region again and again; its leaves tile it whatever the numbers in the claim are, as corners are
worked out here. A leaf that names a box lies in it, as real numbers (`rounding`). Where two such leaves share a face,
the boxes' parameters have a connected set in common that holds it, so that by lemma G one common point of theirs glues
them along all of it. So nothing that a search does wrong is believed: a cell left out is no part of the cover, a face
left out is unglued.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from ccpin.arrays import Array, Indices, Mask, joined, rows_of
from ccpin.proof.facts import Examined, Fact, Form, ProvableClaim, provable, require
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import LEAST, ROUNDINGS, UNIT_ROUNDOFF, product_of, sum_of
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes, boxes_of

LEVELS = 32  # halvings of an edge of the region: its units are 2⁻³²
WHOLE = 1 << LEVELS
_NEARLY = 0.99  # of what boxes are widened by: the rest is for u² and the roundings here
Integers = NDArray[np.int64]


@provable
@dataclass(frozen=True, eq=False)
class RegionCover(ProvableClaim):
    """Cells of a region that lie in boxes, and which of these share faces.

    Premises: facts about boxes (`SolutionsInBoxes`), numbered through, then facts that glue them (`GluedBoxes`, `Met`).

    Attributes:
        lower, upper: The region's corners, of shape (n,); bounds that are the same: a coordinate that is held.
        wrapped: Whether a coordinate is a full turn that closes on itself, of shape (n,).
        cut: The coordinate that a cell is halved along, of shape (T,); cell 0 is the region.
        child: The number of its lower half (the upper one's is one more), −1 of leaves, of shape (T,).
        box: The number of the box that a leaf lies in, or −1, of shape (T,).
        start: The number of the box that the seed is in, or −1, of shape (1,).

    Found: `faces` (F, 2), pairs of boxes whose cells share a face, and `unglued` (U, 2), those that are not glued
    there; `reached` (B,), whether a way over glued faces joins a box to the seed's; `whole` (1,), whether every leaf
    lies in a box; `seed` (1 or 0, N), a configuration to which the seed is known.
    """

    lower: Array
    upper: Array
    wrapped: Mask
    cut: Indices
    child: Indices
    box: Indices
    start: Indices
    theorem = "gluing"
    forms = MappingProxyType(
        {
            "lower": Form("P"),
            "upper": Form("P"),
            "wrapped": Form("P", "b"),
            "cut": Form("T", "i", 0),
            "child": Form("T", "i", -1),
            "box": Form("T", "i", -1),
            "start": Form("1", "i", -1),
        }
    )

    def examined(self, *premises: Fact) -> Examined:
        """The tree, its cells in their boxes, and its faces."""
        solutions = tuple(premise for premise in premises if type(premise.claim) is SolutionsInBoxes)
        glue = tuple(premise for premise in premises if type(premise.claim) in (GluedBoxes, Met))
        require(len(solutions) + len(glue) == len(premises), "premises of other kinds")
        boxes = boxes_of(solutions)
        require(self.lower <= self.upper, "a region with its corners exchanged")
        periodic = self.equations.system.periodic[self.equations.system.independent]
        gap = np.abs(self.upper - self.lower - 2.0 * np.pi)
        near = ROUNDINGS * UNIT_ROUNDOFF * (2.0 * np.pi + np.abs(self.lower) + np.abs(self.upper))
        require(~self.wrapped | (periodic & (gap <= near)), "no full turn of a period")
        tree = halved(self.cut, self.child, len(self.lower))
        leaves = np.flatnonzero(tree.reached & (self.child < 0))
        named = leaves[self.box[leaves] >= 0]
        require(self.box[leaves] < len(boxes.kappa), "a leaf names no box")
        self._require_within(tree, named, boxes)
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

    def _require_within(self, tree: HalvedTree, leaves: Indices, boxes: Boxes) -> None:
        """That the leaves' cells lie in their boxes as widened, q being the boxes' parameters."""
        number, independent = self.box[leaves], self.equations.system.independent
        n = len(independent)
        require(boxes.half.shape[1] == n or not len(leaves), "boxes whose parameters are not q")
        if not len(leaves):
            return
        across = boxes.directions[number][:, independent]
        require(np.array_equal(across, np.broadcast_to(np.eye(n), across.shape)), "boxes whose parameters are not q")
        centre, half = boxes.centre[number][:, independent], boxes.half[number]
        allowed = half + _NEARLY * (LEAST + ROUNDINGS * UNIT_ROUNDOFF * (np.abs(centre) + half))
        for corner in (tree.lower[leaves], tree.lower[leaves] + tree.size[leaves]):
            at, rest = self._position(corner)
            gap, of_gap = sum_of(at, -centre)
            require(np.abs(gap + (of_gap + rest)) <= allowed, "a cell is not in its box")

    def _position(self, corner: Integers) -> tuple[Array, Array]:
        """Whole-number coordinates as points of q-space, sums of two doubles."""
        share = corner / WHOLE
        width, of_width = sum_of(self.upper, -self.lower)
        moved, of_moved = product_of(width, share)
        at, of_at = sum_of(np.broadcast_to(self.lower, moved.shape), moved)
        return at, of_at + (of_moved + of_width * share)

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


class HalvedTree(NamedTuple):
    """Cells as their numbers say: corners and edges in units of 2⁻³² of the region, (T, n); those there are, (T,)."""

    lower: Integers
    size: Integers
    reached: Mask


def halved(cut: Indices, child: Indices, n: int) -> HalvedTree:
    """The cells of a tree, from the root down.

    Raises:
        NotProvedError: It is none: a cell has two parents or none of the cells there are, or an edge of one unit is
        halved.
    """
    count = len(cut)
    require(count > 0, "a tree without cells")
    require((child < count - 1) & (cut < n), "a tree that leaves its arrays")
    lower, size = np.zeros((count, n), dtype=np.int64), np.zeros((count, n), dtype=np.int64)
    reached = np.zeros(count, dtype=np.bool_)
    size[0], reached[0], cells = WHOLE, True, np.zeros(1, dtype=np.int64)
    while (cells := cells[child[cells] >= 0]).size:
        below, axis = child[cells], cut[cells]
        both = np.concatenate([below, below + 1])
        require(not np.any(reached[both]) and len(np.unique(both)) == len(both), "a cell with two parents")
        half = size[cells, axis] // 2
        require(half > 0, "an edge too short to be halved")
        for side in (below, below + 1):
            lower[side], size[side] = lower[cells], size[cells]
        size[below, axis], size[below + 1, axis] = half, half
        lower[below + 1, axis] += half
        reached[both], cells = True, both
    return HalvedTree(lower, size, reached)


class LeafFaces(NamedTuple):
    """Faces that leaves share: the cells whose upper and whose lower face it is, the axis across, (K,) each.

    `seam`: whether the lower face is one whole turn further, (K,).
    """

    upper: Indices
    lower: Indices
    axis: Indices
    seam: Mask

    def turns(self, n: int) -> Indices:
        """By how many turns q of the one cell is ahead of that of the other at the face, of shape (K, n)."""
        turns = np.zeros((len(self.axis), n), dtype=np.int64)
        turns[np.arange(len(turns)), self.axis] = self.seam
        return turns


def faces_of(tree: HalvedTree, cut: Indices, child: Indices, wrapped: Mask) -> LeafFaces:
    """All faces that leaves share, each once: from the halves of every cell, and the region's two ends, downwards."""
    inner, axes = np.flatnonzero(tree.reached & (child >= 0)), np.flatnonzero(wrapped)
    none = np.zeros(len(axes), dtype=np.int64)
    pairs = LeafFaces(
        np.concatenate([child[inner], none]),
        np.concatenate([child[inner] + 1, none]),
        np.concatenate([cut[inner], axes]),
        np.concatenate([np.zeros(len(inner), dtype=np.bool_), np.ones(len(axes), dtype=np.bool_)]),
    )
    found = []
    while len(pairs.axis):
        ended = (child[pairs.upper] < 0) & (child[pairs.lower] < 0)
        found.append(rows_of(pairs, ended))
        pairs = _parted(tree, cut, child, rows_of(pairs, ~ended))
    return joined([*found, pairs])


def _parted(tree: HalvedTree, cut: Indices, child: Indices, pairs: LeafFaces) -> LeafFaces:
    """Pairs of cells with a common face, one of each halved: what of its halves still has a part of the face."""
    first = child[pairs.upper] >= 0  # which of the two is halved
    cell, still = np.where(first, pairs.upper, pairs.lower), np.where(first, pairs.lower, pairs.upper)
    along, halves = cut[cell] == pairs.axis, []
    for side in (0, 1):
        half, axis = child[cell] + side, cut[cell]
        low, high = tree.lower[half, axis], tree.lower[half, axis] + tree.size[half, axis]
        other = tree.lower[still, axis]
        meets = (low < other + tree.size[still, axis]) & (other < high)
        kept = np.where(along, first == bool(side), meets)
        upper, lower = np.where(first, half, pairs.upper), np.where(first, pairs.lower, half)
        halves.append(LeafFaces(upper[kept], lower[kept], pairs.axis[kept], pairs.seam[kept]))
    return joined(halves)


def _numbers(fact: Fact, solutions: tuple[Fact, ...]) -> Indices:
    """The cover's numbers of the boxes that a fact glues; −1 of those that are not the cover's."""
    first = dict(
        zip(map(id, solutions), np.cumsum([0, *(len(s.claim.kappa) for s in solutions)]).tolist(), strict=False)
    )
    own = fact.premises if type(fact.claim) is GluedBoxes else fact.premises[1:]
    parts = [
        np.arange(len(s.claim.kappa)) + first[id(s)] if id(s) in first else np.full(len(s.claim.kappa), -1) for s in own
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
