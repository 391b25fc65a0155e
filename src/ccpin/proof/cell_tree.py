"""Cells of a region: a tree that halves it again and again, the faces its leaves share, and the boxes they lie in.

The leaves tile the region whatever the numbers of the tree are, as corners are worked out here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, Indices, Mask, joined, rows_of
from ccpin.proof.equations import Closures
from ccpin.proof.facts import Form, ProvableClaim, require
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import LEAST, ROUNDINGS, TURN, UNIT_ROUNDOFF, product_of, sum_of

LEVELS = 32  # halvings of an edge of the region: its units are 2⁻³²
WHOLE = 1 << LEVELS
_NEARLY = 0.99  # of what boxes are widened by: the rest is for u² and the roundings here
Integers = NDArray[np.int64]


class CellRegion(NamedTuple):
    """A region: its corners and whether a coordinate is a full turn that closes on itself, of shape (n,) each."""

    lower: Array
    upper: Array
    wrapped: Mask

    def position(self, corner: Integers | Array) -> tuple[Array, Array]:
        """Whole-number coordinates as points of q-space, sums of two doubles."""
        share = corner / WHOLE
        width, of_width = sum_of(self.upper, -self.lower)
        moved, of_moved = product_of(width, share)
        at, of_at = sum_of(np.broadcast_to(self.lower, moved.shape), moved)
        return at, of_at + (of_moved + of_width * share)


def require_region(equations: Closures, region: CellRegion) -> None:
    """That it is one.

    Raises:
        NotProvedError: Its corners are exchanged, or what closes on itself is no full turn of a period.
    """
    lower, upper, wrapped = region
    require(lower <= upper, "a region with its corners exchanged")
    periodic = equations.system.periodic[equations.system.independent]
    gap = np.abs(upper - lower - TURN)
    near = ROUNDINGS * UNIT_ROUNDOFF * (TURN + np.abs(lower) + np.abs(upper))
    require(~wrapped | (periodic & (gap <= near)), "no full turn of a period")


@dataclass(frozen=True, eq=False)
class CellsClaim(ProvableClaim):
    """What is claimed of the cells of a region; kinds of claims add to it.

    Attributes:
        lower, upper: The region's corners, of shape (n,); bounds that are the same: a coordinate that is held.
        wrapped: Whether a coordinate is a full turn that closes on itself, of shape (n,).
        cut: The coordinate that a cell is halved along, of shape (T,); cell 0 is the region.
        child: The number of its lower half (the upper one's is one more), −1 of leaves, of shape (T,).
    """

    lower: Annotated[Array, Form("P")]
    upper: Annotated[Array, Form("P")]
    wrapped: Annotated[Mask, Form("P", "b")]
    cut: Annotated[Indices, Form("T", "i", 0)]
    child: Annotated[Indices, Form("T", "i", -1)]

    @property
    def region(self) -> CellRegion:
        """The region."""
        return CellRegion(self.lower, self.upper, self.wrapped)

    def cells(self) -> HalvedTree:
        """The tree of cells.

        Raises:
            NotProvedError: It is none, or the region is.
        """
        require_region(self.equations, self.region)
        return tree_of(self.cut, self.child, len(self.lower))


def lie_within(
    equations: Closures, region: CellRegion, tree: HalvedTree, cells: Indices, boxes: Boxes, number: Indices
) -> Mask:
    """Which of K cells lie in the boxes of these numbers (K,) as widened, of shape (K,).

    Raises:
        NotProvedError: The boxes' parameters are not q.
    """
    independent = equations.system.independent
    n, within = len(independent), np.ones(len(cells), dtype=np.bool_)
    if not len(cells):
        return within
    require(boxes.half.shape[1] == n, "boxes whose parameters are not q")
    across = boxes.directions[number][:, independent]
    require(np.array_equal(across, np.broadcast_to(np.eye(n), across.shape)), "boxes whose parameters are not q")
    centre, half = boxes.centre[number][:, independent], boxes.half[number]
    allowed = half + _NEARLY * (LEAST + ROUNDINGS * UNIT_ROUNDOFF * (np.abs(centre) + half))
    for corner in (tree.lower[cells], tree.lower[cells] + tree.size[cells]):
        at, rest = region.position(corner)
        gap, of_gap = sum_of(at, -centre)
        within &= np.all(np.abs(gap + (of_gap + rest)) <= allowed, axis=1)
    return within


class HalvedTree(NamedTuple):
    """Cells as their numbers say: corners and edges in units of 2⁻³² of the region, (T, n); those there are, (T,)."""

    lower: Integers
    size: Integers
    reached: Mask


def tree_of(cut: Indices, child: Indices, n: int) -> HalvedTree:
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
