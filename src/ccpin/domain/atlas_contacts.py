"""Which cells of an atlas touch which leaves, and where."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.domain.atlas_tree import WHOLE, CellTree, Region

Array = NDArray[np.float64]
Index = NDArray[np.intp]


class Contacts(NamedTuple):
    """K faces that cells share with leaves.

    Attributes:
        cell, leaf: Their numbers, of shape (K,).
        at_cell, at_leaf: The middle of the face in each one's coordinates, whole-number units, of shape (K, n).
        area: Relative to the region's cross section, of shape (K,).
        upper: Whether it is the cell's upper face, of shape (K,).
    """

    cell: Index
    leaf: Index
    at_cell: Array
    at_leaf: Array
    area: Array
    upper: NDArray[np.bool_]


def contacts_of(tree: CellTree, region: Region, cells: Index) -> Contacts:
    """The faces that cells share with leaves, across the seam of periodic coordinates too."""
    found = [_across(tree, region, cells, k, upper) for k in range(len(region.lower)) for upper in (False, True)]
    return Contacts(*(np.concatenate(arrays) for arrays in zip(*found, strict=True)))


def _across(tree: CellTree, region: Region, cells: Index, k: int, upper: bool) -> Contacts:
    """Contacts across the lower or upper faces perpendicular to coordinate k."""
    low, high = tree.lower[cells].copy(), tree.lower[cells] + tree.size[cells]
    face = high[:, k].copy() if upper else low[:, k].copy()
    beyond = face if upper else face - 1
    if region.wrapped[k]:
        beyond = beyond % WHOLE
    within = np.flatnonzero((beyond >= 0) & (beyond < WHOLE))
    low[:, k], high[:, k] = beyond, beyond + 1
    touching = tree.overlapping(low[within], high[within])
    rows, leaf = within[touching.query], touching.leaf
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
