"""Where a workspace has the most room: the middle of the largest cube or ball among the certified cells of a map.

The map is drawn on a grid of cells as small as its smallest. Of every one of them the distance to the nearest that is
not certified whole is known (a distance transform); where it is largest is the place. What is found there is certified
like all cells of the map, but that no place has more room is shown to the grid's fineness only, for the branch and the
straight surroundings mapped.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy import ndimage

from ccpin.arrays import Array, Mask
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.radius_map import without_sigma
from ccpin.proof.cell_tree import WHOLE

_MOST_VOXELS = 2**21  # 16 MB of distances


class Room(NamedTuple):
    """The largest cube or ball of voxels of a map.

    Attributes:
        centre: Where, in the atlas's coordinates, of shape (n,); those held as the region holds them.
        share: Its half width (or radius) over the region's, in the coordinates that are not held; 0: there is none.
        theta: A closed configuration in the certified cell of the centre, of shape (n′,).
        enclosed: Whether it ends at cells that are not certified, not at the region's border.
    """

    centre: Array
    share: float
    theta: Array
    enclosed: bool


def roomiest(atlas: Atlas, round: bool) -> Room:
    """The largest cube (or ball) of certified cells, in units of the region's edges."""
    free = ~atlas.region.held
    inside, size = _certified(atlas, free)
    padded = np.pad(inside, 1)
    away = ndimage.distance_transform_edt(padded) if round else ndimage.distance_transform_cdt(padded, "chessboard")
    away = np.asarray(away[tuple(slice(1, -1) for _ in inside.shape)], dtype=np.float64)
    widest = float(away.max())
    best = np.argwhere(away == widest)
    voxel = np.round(best.mean(axis=0)).astype(np.intp)
    if away[tuple(voxel)] < widest - 1.0:  # the best are about a hole
        voxel = best[0]
    region = atlas.region
    centre = region.lower.copy()
    centre[free] += region.width[free] * (voxel + 0.5) * size
    least = float(away[tuple(voxel)])
    border = float(np.min(np.minimum(voxel + 1, np.array(inside.shape) - voxel)))
    box = atlas.tree.box[atlas.tree.locate(region.cell_coordinates(centre[None]))[0]] if least else -1
    theta = atlas.boxes.centre[box] if box >= 0 else atlas.seed
    return Room(centre, 2.0 * max(least - 0.5, 0.0) * float(size.max()), theta, least < border)


def _certified(atlas: Atlas, free: Mask) -> tuple[Mask, Array]:
    """Which voxels are certified whole, an axis for each coordinate that is not held, and their share of its edges."""
    tree = atlas.tree
    leaves, other = tree.leaves(), without_sigma(atlas)
    size = tree.size[leaves][:, free].min(axis=0)
    while np.prod(WHOLE / size.astype(np.float64)) > _MOST_VOXELS:
        size[np.argmin(size)] *= 2
    size[:] = size.max()  # cubes of cubes
    low = tree.lower[other][:, free]
    first, last = low // size, -(-(low + tree.size[other][:, free]) // size)
    inside = np.ones(tuple(WHOLE // size), dtype=np.bool_)
    for begin, end in zip(first, last, strict=True):
        inside[tuple(slice(a, b) for a, b in zip(begin, end, strict=True))] = False
    return inside, size / WHOLE
