"""A region of q-space and its cells: a binary tree of axis-parallel boxes with whole-number corners."""

from __future__ import annotations

from enum import IntEnum
from itertools import product
from typing import Any, Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array, Columns, Indices, rows_of
from ccpin.covering.region import Region
from ccpin.proof.cell_tree import WHOLE, Integers
from ccpin.proof.rounding import blur

_LARGE = 2**28  # bytes of a buffer


class CellStatus(IntEnum):
    """What is known of a cell; `SINGULAR`: a closed configuration over one of its q is proved to be singular."""

    UNREACHED = 0
    CANDIDATE = 1
    CERTIFIED = 2
    UNDECIDED = 3
    EMPTY = 4
    SPLIT = 5
    SINGULAR = 6


class Cells(NamedTuple):
    """The cells of a tree by number: leaves carry a `CellStatus`, split cells their two children.

    Attributes:
        lower: Lower corners, of shape (N, n), in units of 2⁻³² of the region.
        size: Edge lengths in the same units, of shape (N, n).
        cut: The coordinate a split cell is halved along, of shape (N,).
        child: The lower half's number (the upper half's is one more), or −1, of shape (N,).
        status: `CellStatus`, of shape (N,).
        box: The number of a certified cell's box, or −1, of shape (N,).
    """

    lower: Integers
    size: Integers
    cut: Integers
    child: Integers
    status: NDArray[np.int8]
    box: Integers


class CellTree:
    """A binary tree of cells; `lower`, `size`, `cut`, `child`, `status` and `box` are those of `Cells`."""

    def __init__(self, cells: Cells) -> None:
        self._growing = Growing(cells)
        self.lower, self.size, self.cut, self.child, self.status, self.box = cells

    def __reduce__(self) -> tuple[type[CellTree], tuple[Cells]]:
        """A copy's arrays are its own cells again."""
        return CellTree, (self._growing.trimmed(),)

    @property
    def cells(self) -> Cells:
        """All cells."""
        return self._growing.rows

    @classmethod
    def whole(cls, n: int) -> CellTree:
        """One cell: the region."""
        none, corner = np.array([-1]), np.zeros((1, n), dtype=np.int64)
        zero = np.zeros(1, dtype=np.int64)
        return cls(Cells(corner, corner + WHOLE, zero, none, np.zeros(1, dtype=np.int8), none.copy()))

    def split(self, cells: Indices, cut: Indices) -> Indices:
        """Halve leaves along a coordinate each; the new cells' numbers, of shape (2 · len(cells),)."""
        children = len(self.child) + np.arange(2 * len(cells))
        self.child[cells], self.cut[cells], self.status[cells] = children[::2], cut, CellStatus.SPLIT
        halves = rows_of(self.cells, np.repeat(cells, 2))
        rows, along = np.arange(len(children)), np.repeat(cut, 2)
        halves.size[rows, along] //= 2
        halves.lower[rows[1::2], cut] += halves.size[rows[1::2], cut]
        halves.status[:], halves.child[:], halves.box[:] = CellStatus.UNREACHED, -1, -1
        self._growing.add(halves)
        self.lower, self.size, self.cut, self.child, self.status, self.box = self.cells
        return children

    def put(self, leaf: int, cells: Cells) -> None:
        """Put cells in the place of a leaf, the first in its own, the others behind all there are."""
        for name in Cells._fields:
            getattr(self, name)[leaf] = getattr(cells, name)[0]
        self._growing.add(rows_of(cells, slice(1, None)))
        self.lower, self.size, self.cut, self.child, self.status, self.box = self.cells

    def leaves(self, *statuses: CellStatus) -> Indices:
        """Numbers of all cells that are not split, or of those of them that have one of some statuses."""
        leaves = np.flatnonzero(self.child < 0)
        return leaves[np.isin(self.status[leaves], statuses)] if statuses else leaves

    def shares(self, cells: Indices) -> Array:
        """What share of the region each of some cells is, of shape (K,)."""
        return np.asarray(np.prod(self.size[cells] / WHOLE, axis=1))

    def share(self, cells: Indices) -> float:
        """What share of the region some cells are together."""
        return float(self.shares(cells).sum())

    def overlapping(self, lower: Integers, upper: Integers) -> tuple[Indices, Indices]:
        """Which leaves meet the boxes [lower, upper), (K, n) each, in their interiors: pairs (box, leaf), sorted."""
        query, node = np.arange(len(lower)), np.zeros(len(lower), dtype=np.int64)
        queries, leaves = [query[:0]], [node[:0]]
        while len(query):
            child = self.child[node]
            ended = child < 0
            queries.append(query[ended])
            leaves.append(node[ended])
            query, node, child = query[~ended], node[~ended], child[~ended]
            cut = self.cut[node]
            border = self.lower[child + 1, cut]
            low, high = lower[query, cut] < border, upper[query, cut] > border
            query, node = np.concatenate([query[low], query[high]]), np.concatenate([child[low], child[high] + 1])
        query, node = np.concatenate(queries), np.concatenate(leaves)
        order = np.lexsort((node, query))
        return query[order], node[order]

    def locate(self, coordinates: Integers) -> NDArray[np.int64]:
        """The leaf that holds each point (K, n); −1 where the point has a negative coordinate."""
        node = np.zeros(len(coordinates), dtype=np.int64)
        rows = np.arange(len(coordinates))
        while True:
            child = self.child[node]
            inner = child >= 0
            if not np.any(inner):
                return np.where(np.all(coordinates >= 0, axis=1), node, -1)
            cut = self.cut[node]
            border = self.lower[np.maximum(child, 0) + 1, cut]
            node = np.where(inner, child + (coordinates[rows, cut] >= border), node)


def place(tree: CellTree, region: Region, cells: Indices) -> tuple[Array, Array]:
    """Centres and half widths of cells in q-space, (K, n) each."""
    size = tree.size[cells]
    return region.position(tree.lower[cells] + 0.5 * size), 0.5 * region.width * (size / WHOLE)


def leaves_holding(tree: CellTree, region: Region, q: Array, error: Array) -> Indices:
    """The leaf that holds each q (K, n) with all of its error (K, n or 1); −1 where none does."""
    low, high = (tree.locate(region.cell_coordinates(q + side * error)) for side in (-1.0, 1.0))
    return np.where(low == high, low, -1)


def leaves_about(tree: CellTree, region: Region, q: Array) -> Indices:
    """The leaves that points (K, n) may be in, the likeliest first, of shape (K, C); −1 outside of the region.

    One (C = 1) unless some are turned into the region, which rounds them: then those of all points within `blur`.
    """
    turned = region.reduce(q) != q
    first = tree.locate(region.cell_coordinates(q))[:, None]
    if not np.any(turned):
        return first
    error = np.where(turned, blur(q), 0.0)
    sides = np.array(list(product((-1.0, 1.0), repeat=q.shape[1])))
    corners = (region.reduce(q)[:, None] + sides * error[:, None]).reshape(-1, q.shape[1])
    return np.concatenate([first, tree.locate(region.cell_coordinates(corners)).reshape(len(q), -1)], axis=1)


# Which cells of an atlas touch which leaves, and where.


class Growing(Generic[Columns]):
    """A named tuple of arrays with a common leading axis; rows are added in amortised constant time each.

    `rows` are views into buffers with room to spare; after `add` the new `rows` are to be used.
    """

    def __init__(self, rows: Columns) -> None:
        self._buffers, self._count = rows_of(rows, slice(None)), len(rows[0])
        self.rows: Columns = self._buffers

    def add(self, rows: Columns) -> None:
        """Add rows behind the others."""
        start, self._count = self._count, self._count + len(rows[0])
        if self._count > len(self._buffers[0]):
            self._buffers = type(rows)(*(_wider(buffer, start, self._count) for buffer in self._buffers))
        for buffer, new in zip(self._buffers, rows, strict=True):
            buffer[start : self._count] = new
        self.rows = rows_of(self._buffers, slice(self._count))

    def trimmed(self) -> Columns:
        """The rows in arrays of their own, without room to spare."""
        return type(self.rows)(*(array.copy() for array in self.rows))


def _wider(buffer: NDArray[Any], used: int, needed: int) -> NDArray[Any]:
    """A buffer for at least `needed` rows, with the first `used` of another.

    What is not written to takes no memory, and a copy costs more than a try: room is for four times as many, of large
    buffers for half as many again.
    """
    room = 3 * needed if needed * buffer[:1].nbytes < _LARGE else needed // 2
    wide = np.empty((needed + room, *buffer.shape[1:]), dtype=buffer.dtype)
    wide[:used] = buffer[:used]
    return wide


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
