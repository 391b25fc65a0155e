"""The certified radius as a function of q: how large a square about each point an atlas certifies."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Indices, instance
from ccpin.covering.cells import CellStatus
from ccpin.covering.region import points_of
from ccpin.domain.atlas.atlas import Atlas
from ccpin.proof.cell_tree import WHOLE

_CHUNK = 1_000_000  # pairs of a point and a cell at a time: 8 MB an array of their distances


def certified_radius(atlas: Atlas, q: ArrayLike) -> Array:
    """Half width of the largest square about each point that lies in the atlas's certified cells, σ one function there.

    It is the maximum-norm distance to the nearest cell that is not certified, or whose box is not of `one_function`, or
    to the edge of the region; where that closes on itself, half a turn at most. It is 0 at points not certified. Such a
    square belongs to Ω.

    Args:
        atlas: From `certify`.
        q: Points of shape (K, n), in radians (metres for sliding coordinates).

    Returns:
        Radii of shape (K,), in the units of q.

    Raises:
        InvalidInputError: q has the wrong shape, or is not finite.
    """
    instance(atlas, "atlas", Atlas, "an Atlas")
    points = points_of(q, atlas.names)
    region, tree = atlas.region, atlas.tree
    inside = np.atleast_1d(atlas.contains(points))
    placed = region.reduce(points)
    blocked = _bordering(atlas)
    lower, upper = region.position(tree.lower[blocked]), region.position(tree.lower[blocked] + tree.size[blocked])
    turn = np.where(region.wrapped, region.width, 0.0)
    edges = np.where(region.wrapped, 0.5 * region.width, np.minimum(placed - region.lower, region.upper - placed))
    free_edge = np.where(region.held, np.inf, edges).min(axis=1)
    radius = np.where(inside, np.maximum(free_edge, 0.0), 0.0)
    chunk = max(1, _CHUNK // max(1, len(blocked)))
    for start in range(0, len(points), chunk):
        window = slice(start, start + chunk)
        distance = _distance(placed[window], lower, upper, turn)
        radius[window] = np.where(inside[window], np.minimum(radius[window], distance), 0.0)
    return np.asarray(radius * (1.0 - 1e-12))


def without_sigma(atlas: Atlas) -> Indices:
    """The leaves that are not certified, or whose boxes are not of `one_function`."""
    leaves = atlas.tree.leaves()
    box = atlas.tree.box[leaves]
    certified = atlas.tree.status[leaves] == CellStatus.CERTIFIED
    certified[certified] = atlas.one_function[box[certified]]
    return np.asarray(leaves[~certified])


def _bordering(atlas: Atlas) -> Indices:
    """The cells without σ that touch one that has it, or the region's edge: the nearest one is among them."""
    tree = atlas.tree
    blocked = without_sigma(atlas)
    known = np.ones(len(tree.child), dtype=np.bool_)
    known[blocked] = False
    lower, size = tree.lower[blocked], tree.size[blocked]
    query, leaf = tree.overlapping(lower - 1, lower + size + 1)
    keep = ((lower == 0) | (lower + size == WHOLE)).any(axis=1)
    keep[query[known[leaf]]] = True
    return np.asarray(blocked[keep])


def _distance(points: Array, lower: Array, upper: Array, turn: Array) -> Array:
    """Maximum-norm distance of points (K, n) to the nearest box (B, n), coordinates with a turn the short way round."""
    nearest = np.full((len(points), len(lower)), -np.inf)
    for k in range(points.shape[1]):
        gaps = np.full(nearest.shape, np.inf)
        for shift in (0.0,) if turn[k] == 0.0 else (-turn[k], 0.0, turn[k]):
            x = points[:, k, None] + shift
            gaps = np.minimum(gaps, np.maximum(np.maximum(lower[None, :, k] - x, x - upper[None, :, k]), 0.0))
        nearest = np.maximum(nearest, gaps)
    return np.asarray(nearest.min(axis=1, initial=np.inf))
