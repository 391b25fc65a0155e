"""Which cells touch which leaves of their tree, and where."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask, joined
from ccpin.covering.cells import CellTree
from ccpin.covering.region import Region
from ccpin.native.certifier import compiled_core
from ccpin.proof.cell_tree import WHOLE


class CellFaces(NamedTuple):
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


def contacts_of(tree: CellTree, region: Region, cells: Indices) -> CellFaces:
    """The faces that cells share with leaves, across the seam of periodic coordinates too."""
    if (core := compiled_core()) is not None:
        wrapped = region.wrapped.tolist()
        return CellFaces(*core.contacts(tree.lower, tree.size, tree.cut, tree.child, cells, wrapped))
    return joined(_across(tree, region, cells, k, upper) for k in range(len(region.lower)) for upper in (False, True))


def _across(tree: CellTree, region: Region, cells: Indices, k: int, upper: bool) -> CellFaces:
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
    return CellFaces(
        cells[rows], leaf, at_cell, at_leaf, np.prod(extent, axis=1), np.full(len(rows), upper, dtype=np.bool_)
    )
