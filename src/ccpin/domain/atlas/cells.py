"""A region of q-space and its cells: a binary tree of axis-parallel boxes with whole-number corners."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import Array, Indices, Mask, joined, numbers, rows_of
from ccpin.domain.atlas.growing import Growing
from ccpin.domain.closures.seeds import Seed
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism
from ccpin.native.certifier import compiled_core
from ccpin.proof.rounding import blur, product_of, sum_of

Corners = Sequence[ArrayLike] | Array  # (lower, upper)
Integers = NDArray[np.int64]

LEVELS = 32
WHOLE = 1 << LEVELS
TURN = 2.0 * np.pi
_SLACK = 1e-9


class CellStatus(IntEnum):
    """What is known of a cell; `SINGULAR`: a closed configuration over one of its q is proved to be singular."""

    UNREACHED = 0
    CANDIDATE = 1
    CERTIFIED = 2
    UNDECIDED = 3
    EMPTY = 4
    SPLIT = 5
    SINGULAR = 6


@dataclass(frozen=True, eq=False)
class Region:
    """An axis-parallel box of q-space; a full turn of a periodic coordinate closes on itself.

    A coordinate whose two bounds are the same is held: the region is a slice.

    Attributes:
        lower, upper: Corners, of shape (n,).
        wrapped: Whether a coordinate is a full turn, of shape (n,).
    """

    lower: Array
    upper: Array
    wrapped: Mask

    @property
    def width(self) -> Array:
        """Edge lengths, of shape (n,)."""
        return self.upper - self.lower

    @property
    def held(self) -> Mask:
        """Whether a coordinate has one value only, of shape (n,)."""
        return np.asarray(self.upper == self.lower)

    @property
    def span(self) -> Array:
        """Edge lengths, 1 of coordinates that are held, of shape (n,)."""
        return np.where(self.held, 1.0, self.width)

    @property
    def volume(self) -> float:
        """Length, area or volume, in the coordinates that are not held."""
        return float(np.prod(self.span))

    def position(self, corner: Integers | Array) -> Array:
        """Whole-number coordinates as points of q-space, each the nearest double or next to it.

        lower + (upper − lower)·t with the errors of difference, product and sum carried along: what is left is within
        u of the point and u² of the region's size, as the lemma of `ccpin.proof.rounding` asks.
        """
        share = np.asarray(corner, dtype=np.float64) / WHOLE
        width, of_width = sum_of(self.upper, -self.lower)
        moved, of_moved = product_of(width, share)
        point, of_point = sum_of(np.broadcast_to(self.lower, moved.shape), moved)
        return np.asarray(point + (of_point + (of_moved + of_width * share)))

    def cell_coordinates(self, q: Array) -> Integers:
        """The whole-number coordinates of points (K, n), turned into the region where it wraps; −1 outside of it."""
        turned = self.reduce(q)
        inside = np.all((turned >= self.lower) & (turned <= self.upper), axis=1)
        scaled = np.where(inside[:, None], (turned - self.lower) / self.span, 0.0)
        found = np.clip(np.floor(scaled * WHOLE), 0, WHOLE - 1)
        found = np.where(self.held, 0.0, found)
        found -= (found > 0.0) & (turned < self.position(found))  # the quotient is rounded, a border is not
        found += (found < WHOLE - 1) & (turned >= self.position(found + 1.0))
        return np.where(inside[:, None], found, -1).astype(np.int64)

    def reduce(self, q: Array) -> Array:
        """Points with their periodic coordinates turned into the region."""
        turns = np.where(self.wrapped, np.floor((q - self.lower) / self.span), 0.0)
        reduced = np.clip(q - turns * self.width, self.lower, self.upper)  # rounding must not pass the edge
        return np.where(self.wrapped, reduced, q)


def corners_of(region: Corners, names: Sequence[str], slices: bool = False) -> tuple[Array, Array]:
    """The corners (lower, upper) of a region over named coordinates, n finite numbers each, lower below upper.

    With `slices` the bounds of some may be equal.

    Raises:
        InvalidInputError: They are not.
    """
    n = len(names)
    try:
        corners = numbers(region, "region").copy()
    except InvalidInputError:
        corners = np.empty(0)
    if corners.shape != (2, n) or not np.all(np.isfinite(corners)):
        raise InvalidInputError(
            f"a region is (lower, upper), each of shape ({n},) and finite: one bound a coordinate ({', '.join(names)})"
        )
    held = corners[1] == corners[0]
    if np.any(corners[1] < corners[0]) or (np.any(held) and not slices) or np.all(held):
        raise InvalidInputError(
            f"the region's lower corner {corners[0].tolist()} must be below its upper corner {corners[1].tolist()}"
            + (" in one coordinate at least, and above it in none" if slices else "")
        )
    return corners[0], corners[1]


def region_of(mechanism: Mechanism, seed: Seed, region: Corners | None) -> Region:
    """The region asked for, or by default a full turn for a joint whose limits allow it, the limits otherwise.

    A periodic coordinate given a full turn (to 1e-9) closes on itself. A default full turn is [−π, π].

    Raises:
        InvalidInputError: Bounds are malformed, do not hold q₀ or exceed a full turn; or a slide has no limits.
    """
    system = seed.reading.system
    periodic, q0 = system.periodic[system.independent], seed.q
    names = mechanism.independent
    lower, upper = corners_of(_limits(mechanism, seed) if region is None else region, names, slices=True)
    wrapped = periodic & (upper - lower >= TURN - _SLACK)
    if np.any(upper - lower > TURN + _SLACK, where=periodic):
        raise InvalidInputError("a region may not exceed a full turn of a revolute joint")
    upper[wrapped] = lower[wrapped] + TURN
    inside = wrapped | ((q0 >= lower) & (q0 <= upper))
    if not np.all(inside):
        name = names[int(np.argmin(inside))]
        raise InvalidInputError(f"q0 = {q0.tolist()} lies outside the region in '{name}'")
    return Region(lower, upper, wrapped)


def _limits(mechanism: Mechanism, seed: Seed) -> tuple[Array, Array]:
    """Default bounds of the independent coordinates."""
    system, model = seed.reading.system, mechanism.tree.model
    lower, upper = np.full(system.n, -np.pi), np.full(system.n, np.pi)
    for row, index in enumerate(system.independent):
        joint = next(joint for joint in seed.reading.chart.joints if joint.v.start <= index < joint.v.stop)
        low, high = -np.inf, np.inf
        if joint.kind.nq == 1:
            low, high = float(model.lowerPositionLimit[joint.q.start]), float(model.upperPositionLimit[joint.q.start])
        if system.periodic[index] and not high - low < TURN - _SLACK:
            continue
        if not np.isfinite(high - low):
            raise InvalidInputError(f"joint '{joint.name}' has no limits: give a region")
        lower[row], upper[row] = low, high
    return lower, upper


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


class Contacts(NamedTuple):
    """K faces that cells share with leaves.

    Attributes:
        cell, leaf: Their numbers, of shape (K,).
        at_cell, at_leaf: The middle of the face in each one's coordinates, whole-number units, of shape (K, n).
        area: Relative to the region's cross section, of shape (K,).
        upper: Whether it is the cell's upper face, of shape (K,).
    """

    cell: Indices
    leaf: Indices
    at_cell: Array
    at_leaf: Array
    area: Array
    upper: Mask


def contacts_of(tree: CellTree, region: Region, cells: Indices) -> Contacts:
    """The faces that cells share with leaves, across the seam of periodic coordinates too."""
    if (core := compiled_core()) is not None:
        wrapped = region.wrapped.tolist()
        return Contacts(*core.contacts(tree.lower, tree.size, tree.cut, tree.child, cells, wrapped))
    return joined(_across(tree, region, cells, k, upper) for k in range(len(region.lower)) for upper in (False, True))


def _across(tree: CellTree, region: Region, cells: Indices, k: int, upper: bool) -> Contacts:
    """Contacts across the lower or upper faces perpendicular to coordinate k."""
    low, high = tree.lower[cells].copy(), tree.lower[cells] + tree.size[cells]
    face = high[:, k].copy() if upper else low[:, k].copy()
    beyond = face if upper else face - 1
    if region.wrapped[k]:
        beyond = beyond % WHOLE
    within = np.flatnonzero((beyond >= 0) & (beyond < WHOLE))
    low[:, k], high[:, k] = beyond, beyond + 1
    query, leaf = tree.overlapping(low[within], high[within])
    rows = within[query]
    start = np.maximum(low[rows], tree.lower[leaf])
    end = np.minimum(high[rows], tree.lower[leaf] + tree.size[leaf])
    at_cell = 0.5 * (start + end)
    at_leaf = at_cell.copy()
    at_cell[:, k] = face[rows]
    at_leaf[:, k] = tree.lower[leaf, k] + (0 if upper else tree.size[leaf, k])
    extent = (end - start) / WHOLE
    extent[:, k] = 1.0
    return Contacts(
        cells[rows], leaf, at_cell, at_leaf, np.prod(extent, axis=1), np.full(len(rows), upper, dtype=np.bool_)
    )
