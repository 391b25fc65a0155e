"""What a document says of the cells of its region: that they tile it, and which boxes lie over which.

**Lemma.** Let row 0 be the whole region, [0, 2³²]ⁿ in whole numbers; let each row that has children be cut in the
middle of one edge, its children be the two halves, in their order; and let each row but 0 be one row's child. Then the
rows without children tile the region, and what finds the leaf that holds a point by the cuts finds the only one.

*Proof.* By induction over the cuts: the leaves of a row tile it. Each row is reached once, so there are no others. ∎

So shares of the region, and how far the nearest cell is that is not certified, follow from the statuses.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.auditing.container import Arrays
from ccpin.auditing.structure import in_range, require

WHOLE = 2**32  # an edge of the region, in the whole numbers of the tree's corners
CERTIFIED, EMPTY, SPLIT, SINGULAR = 2, 4, 5, 6  # a cell's status, as documents write it
_STATUSES = (0, 1, CERTIFIED, 3, EMPTY, SINGULAR)  # those of leaves: all but SPLIT
_EVEN = 1e-9  # of an edge: how far a box's edges may be from its cell's
_SHORT = 1.0 + 1e-12  # on the radius: rounding of the distances it is the least of

Integers = NDArray[np.int64]


class Over(NamedTuple):
    """Which box lies over which cell, side by side."""

    cell: Integers
    box: Integers


def check_tree(arrays: Arrays) -> None:
    """The lemma's hypotheses, level by level, and that statuses are those of leaves and of others.

    Raises:
        ContradictionError: Not so.
    """
    lower, size, cut, child = (arrays[f"tree_{name}"] for name in ("lower", "size", "cut", "child"))
    count, n = lower.shape
    require(count > 0 and not np.any(lower[0]) and np.all(size[0] == WHOLE), "tree: its first cell is not the region")
    held, reached = arrays["lower"] == arrays["upper"], np.zeros(count, dtype=np.bool_)
    level = np.zeros(1, dtype=np.int64)
    while level.size:
        require(
            not np.any(reached[level]) and len(np.unique(level)) == len(level), "tree_child: a cell is two cells' child"
        )
        reached[level] = True
        require(np.all(child[level] >= -1), "tree_child: a number below −1")
        level = level[child[level] >= 0]
        first, axis = child[level], cut[level]
        require(np.all(first < count - 1), "tree_child: a cell that is none")
        require(in_range(axis, n) and not np.any(held[axis]), "tree_cut: cut along what is no edge")
        rows = np.arange(len(level))
        half = size[level].copy()
        require(np.all(half[rows, axis] % 2 == 0), "tree_size: an edge cannot be halved")
        half[rows, axis] //= 2
        above = lower[level].copy()
        above[rows, axis] += half[rows, axis]
        halves = np.array_equal(size[first], half) and np.array_equal(size[first + 1], half)
        placed = np.array_equal(lower[first], lower[level]) and np.array_equal(lower[first + 1], above)
        require(halves and placed, "tree_lower, tree_size: children are not the halves of their cell")
        level = np.concatenate([first, first + 1])
    require(bool(np.all(reached)), "tree: there are cells in no other")
    require(in_range(cut, n), "tree_cut: an edge that is none")
    leaf, status = child < 0, arrays["tree_status"]
    require(np.all(status[~leaf] == SPLIT), "tree_status: a cell with children is not called split")
    require(np.all(np.isin(status[leaf], _STATUSES)), "tree_status: a leaf has a status that there is not")
    _check_singular(arrays, leaf)


def _check_singular(arrays: Arrays, leaf: NDArray[np.bool_]) -> None:
    """Cells called singular, and no others, have a singular configuration each."""
    cell, called = arrays["singular_cell"], np.flatnonzero(leaf & (arrays["tree_status"] == SINGULAR))
    require(len({*cell.tolist()}) == len(cell), "singular_cell names a cell twice")
    missing = np.setdiff1d(called, cell)
    require(not missing.size, f"cell {missing[:1]} is called singular without a singular configuration")
    require(not np.setdiff1d(cell, called).size, "singular_cell names cells that are not called singular")


def check_atlas(header: dict[str, Any], arrays: Arrays) -> Over:
    """Each certified cell has its box, no other has one, the seed is over q₀, and the radius is not too long.

    Raises:
        ContradictionError: Not so.
    """
    status, box, count = arrays["tree_status"], arrays["tree_box"], len(arrays["box_centre"])
    cells = np.flatnonzero(status == CERTIFIED)
    require(np.all(box[status != CERTIFIED] == -1), "tree_box: a cell has a box that is not certified")
    require(np.array_equal(np.sort(box[cells]), np.arange(count)), "tree_box: certified cells have not one box each")
    require(in_range(arrays["unglued"], count), "unglued names boxes that are none")
    require(np.array_equal(arrays["q0"], arrays["seed"][arrays["system_independent"]]), "q0 is not the seed's")
    radius = header["radius"]
    require(0.0 <= radius <= _radius(arrays) * _SHORT, f"'radius' is {radius}, and not all of that is certified")
    return Over(cells, box[cells])


def _radius(arrays: Arrays) -> float:
    """How far q₀ is from what ends a square on which σ is one function, in the maximum norm.

    That is a cell not certified, a face that is unglued (the farther of its two cells), or the region's end.
    """
    q0, start, end, wrapped = arrays["q0"], arrays["lower"], arrays["upper"], arrays["wrapped"]
    width, held = end - start, arrays["lower"] == arrays["upper"]
    turn = np.where(wrapped, width, 0.0)
    q = np.where(wrapped, start + np.mod(q0 - start, np.where(wrapped, width, 1.0)), q0)
    low = start + width * (arrays["tree_lower"] / WHOLE)
    high = low + width * (arrays["tree_size"] / WHOLE)
    gaps = [np.maximum(np.maximum(low - at, at - high), 0.0) for at in (q - turn, q, q + turn)]
    away = np.max(np.min(gaps, axis=0)[:, ~held], axis=1)
    certified = np.flatnonzero(arrays["tree_status"] == CERTIFIED)
    cell = certified[np.argsort(arrays["tree_box"][certified])]
    torn = np.max(away[cell[arrays["unglued"]]], axis=1) if len(arrays["unglued"]) else away[:0]
    others = (arrays["tree_child"] < 0) & (arrays["tree_status"] != CERTIFIED)
    nearest = float(np.min(np.concatenate([away[others], torn]), initial=np.inf))
    edges = np.where(wrapped, 0.5 * width, np.minimum(q - start, end - q))[~held]
    return min(nearest, float(edges.min()))


def check_sheets(arrays: Arrays) -> Over:
    """Members lie over leaves that may have them, as many as are counted; gluing is of two boxes at one face.

    Raises:
        ContradictionError: Not so.
    """
    cell, box, status = arrays["members_cell"], arrays["members_box"], arrays["tree_status"]
    count, leaf = arrays["count"], arrays["tree_child"] < 0
    boxes = len(arrays["box_centre"])
    require(np.all(arrays["tree_box"] == -1), "tree_box: sheets list their boxes as members")
    require(in_range(cell, len(leaf)) and np.all(leaf[cell]), "members_cell names cells that are no leaves")
    require(np.all(np.diff(cell) >= 0), "members_cell is not in the order of cells")
    require(np.array_equal(np.sort(box), np.arange(boxes)), "members_box: boxes lie not over one cell each")
    have = np.bincount(cell, minlength=len(leaf))
    certified, empty = leaf & (status == CERTIFIED), leaf & (status == EMPTY)
    require(np.all(count >= -1) and np.all(count[~leaf] == -1), "count: a number below −1, or of a cell that is split")
    require(np.all(count[certified] == have[certified]), "count: not as many as a certified cell has boxes")
    require(not np.any(count[empty] | have[empty]), "count: an empty cell has configurations")
    require(np.all((count < 0) | (have <= count)), "count: fewer than a cell has boxes")
    first, second = arrays["glued_first"], arrays["glued_second"]
    require(in_range(first, boxes) and in_range(second, boxes), "glued names boxes that are none")
    require(np.all(first != second), "glued: a box is glued to itself")
    _check_faces(arrays)
    require(in_range(arrays["left_cell"], len(leaf)), "left_cell names cells that are none")
    require(np.all(arrays["left_half"] >= 0.0), "left_half is negative")
    return Over(cell, box)


def _check_faces(arrays: Arrays) -> None:
    """A face's middle is the same for both boxes, but for a full turn of what closes on itself."""
    gap, width = arrays["glued_at_first"] - arrays["glued_at_second"], arrays["upper"] - arrays["lower"]
    turns = np.where(arrays["wrapped"], np.round(gap / np.where(width > 0.0, width, 1.0)), 0.0)
    near = np.abs(gap - turns * width) <= _EVEN * np.maximum(width, 1.0)
    require(np.all(near & (np.abs(turns) <= 1)), "glued_at_first and glued_at_second are two places")


def check_boxes(arrays: Arrays, over: Over, half: NDArray[np.float64]) -> None:
    """D moves q as δ does, and each box is its cell's: with h as Theorem K has it (`half`) it covers all of it.

    Raises:
        ContradictionError: Not so.
    """
    independent, n = arrays["system_independent"], arrays["box_half"].shape[1]
    same = np.all(arrays["box_directions"][:, independent] == np.eye(n), axis=(1, 2))
    require(bool(np.all(same)), "box_directions: D is not I for the independent coordinates")
    require(np.all(arrays["box_half"] >= 0.0) and np.all(arrays["box_radius"] > 0.0), "box_half, box_radius: no sizes")
    kappa = arrays["box_kappa"]
    require(np.all((kappa >= 0.0) & (kappa < 1.0)), "box_kappa: no number from 0 to below 1")
    require(np.all(arrays["box_weight"] > 0.0), "box_weight: no positive numbers")
    start = [Fraction(float(x)) for x in arrays["lower"]]
    width = [Fraction(float(x)) - a for x, a in zip(arrays["upper"], start, strict=True)]
    centre = arrays["box_centre"][:, independent]
    for cell, box in zip(over.cell.tolist(), over.box.tolist(), strict=True):
        for k in range(n):
            share = (
                Fraction(int(arrays["tree_lower"][cell, k]), WHOLE),
                Fraction(int(arrays["tree_size"][cell, k]), WHOLE),
            )
            low, edge = start[k] + width[k] * share[0], width[k] * share[1]
            c, h = Fraction(float(centre[box, k])), Fraction(float(half[box, k]))
            stated = Fraction(float(arrays["box_half"][box, k]))
            covers = c - h <= low and low + edge <= c + h
            room = Fraction(_EVEN) * edge + (h - stated)
            even = c - stated >= low - room and c + stated <= low + edge + room
            require(covers and even, f"box {box} is not the box of cell {cell}, over which it is said to lie")
