"""Atlases of parts of a region, made apart, as the one atlas of the region.

What is sound. A box satisfies Theorem K of `boxes` whatever atlas it is in, and a cell that is empty or singular is so
whatever the branch. Every box of a part is reached from the part's seed over glued faces. So where a box of one part
and one of another are glued at a face that they share (the corollary of `boxes`), all boxes of both parts are reached
from either seed. Parts are joined in this way, beginning with the first; one that no glued face joins to it may be of
another assembly mode, and is refused. Every other shared face is glued too, or listed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ccpin.arrays import Array, Indices, Mask, joined, numbers, rows_of, whole
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cells import (
    TURN,
    WHOLE,
    CellStatus,
    CellTree,
    Contacts,
    Corners,
    Integers,
    Region,
    contacts_of,
    corners_of,
)
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.atlas.singular import SingularCells
from ccpin.domain.atlas.store import same_problem
from ccpin.domain.newton import glued
from ccpin.errors import InvalidInputError

_ALIGNED = 4e-15  # of corners (rad, m): below what Theorem K widens boxes by
_TURN = 1e-9
_CHUNK = 500


def split_region(region: Corners, parts: int) -> list[tuple[Array, Array]]:
    """The parts (lower, upper) of a region, halved along its longest edges: what `merge` puts together again.

    Args:
        region: (lower, upper), each of shape (n,); of edges as long as one another the first is halved.
        parts: How many: a power of two.

    Raises:
        InvalidInputError: The region is malformed, or `parts` is no power of two.
    """
    count = whole(parts, "parts")
    if count & (count - 1):
        raise InvalidInputError(f"parts must be a power of two, as edges are halved; it is {count}")
    shape = numbers(region, "region").shape
    lower, upper = corners_of(region, [f"q{k + 1}" for k in range(shape[1] if len(shape) == 2 else 0)], slices=True)
    found = [(lower, upper)]
    while len(found) < count:
        axis = int(np.argmax(found[0][1] - found[0][0]))
        found = [half for part in found for half in _halves(*part, axis)]
    return found


def _halves(lower: Array, upper: Array, axis: int) -> list[tuple[Array, Array]]:
    below, above = upper.copy(), lower.copy()
    below[axis] = above[axis] = lower[axis] + 0.5 * (upper[axis] - lower[axis])
    return [(lower, below), (above, upper)]


def merge_atlases(parts: list[Atlas]) -> Atlas:
    """One atlas of several, of which there is one at least; `ccpin.domain.merge` says the rest."""
    for k, other in enumerate(parts[1:], start=2):
        _refuse_others(parts[0], other, k)
    region = _whole(parts)
    tree, places = _tree(region, parts)
    boxes = joined([part.boxes for part in parts])
    first = np.cumsum([0, *(len(part.boxes.kappa) for part in parts)])
    owner = np.repeat(np.arange(len(parts)), np.diff(first))
    contacts = _between(tree, region, owner)
    pairs = np.column_stack([tree.box[contacts.cell], tree.box[contacts.leaf]])
    merged = replace(
        parts[0],
        boxes=boxes,
        unglued=np.concatenate([part.unglued + start for part, start in zip(parts, first[:-1], strict=True)]),
        complete=all(part.complete for part in parts),
        region=region,
        tree=tree,
        singular=joined(_moved(part, *place) for part, place in zip(parts, places, strict=True)),
    )
    same = _agree(merged, contacts)
    _refuse_strangers(len(parts), owner, pairs, same)
    merged = replace(merged, unglued=np.concatenate([merged.unglued, pairs[~same]]).astype(np.int64))
    return replace(merged, radius=float(certified_radius(merged, merged.region.reduce(merged.q0[None]))[0]))


def _refuse_others(first: Atlas, other: Atlas, k: int) -> None:
    """What speaks of other things than the first."""
    if first.fingerprint != other.fingerprint or first.names != other.names:
        raise InvalidInputError(
            f"part {k} is about other closures than part 1: parts are of one mechanism as one file states it (where it "
            "has ball joints or distances, whose charts are centred at q0, from one q0)"
        )
    if not same_problem(first.problem, other.problem):
        raise InvalidInputError(f"part {k} has other bounds=, limits= or dexterity= than part 1: they must be the same")
    if np.any(first.region.held != other.region.held):
        raise InvalidInputError(f"part {k} holds other coordinates than part 1: slices are merged with slices")


def _whole(parts: list[Atlas]) -> Region:
    """The smallest region that holds all parts."""
    lower = np.min([part.region.lower for part in parts], axis=0)
    upper = np.max([part.region.upper for part in parts], axis=0)
    system = parts[0].problem.system
    wrapped = system.periodic[system.independent] & (upper - lower >= TURN - _TURN)
    return Region(lower, np.where(wrapped, lower + TURN, upper), wrapped)


def _moved(part: Atlas, cell: int, start: int) -> SingularCells:
    """A part's singular cells by their numbers in the whole: `cell` for its first one, others moved by `start`."""
    return part.singular._replace(cell=np.where(part.singular.cell == 0, cell, part.singular.cell + start))


def _tree(region: Region, parts: list[Atlas]) -> tuple[CellTree, list[tuple[int, int]]]:
    """The region's cells: halved down to the parts', whose trees are put there; where each came, see `_moved`."""
    places = [_place(region, part.region, k) for k, part in enumerate(parts, start=1)]
    first = np.cumsum([0, *(len(part.boxes.kappa) for part in parts)])
    tree = CellTree.whole(len(region.lower))
    waiting, put = [(0, list(range(len(parts))))], [(0, 0)] * len(parts)
    while waiting:
        cell, held = waiting.pop()
        lower, size = tree.lower[cell], tree.size[cell]
        if not held:
            at = region.position(lower).tolist(), region.position(lower + size).tolist()
            raise InvalidInputError(f"no part covers the region from {at[0]} to {at[1]}")
        exact = [k for k in held if np.array_equal(places[k][0], lower) and np.array_equal(places[k][1], size)]
        if exact:
            if len(held) > 1:
                k = next(k for k in held if k != exact[0])
                raise InvalidInputError(f"parts {min(k, exact[0]) + 1} and {max(k, exact[0]) + 1} overlap")
            put[exact[0]] = cell, len(tree.child) - 1  # its first cell takes the place of this one
            _graft(tree, cell, parts[exact[0]], int(first[exact[0]]), exact[0] + 1)
            continue
        axis, above = _cut(lower + size // 2, held, places)
        child = int(tree.split(np.array([cell]), np.array([axis]))[0])
        waiting += [(child + side, [k for k in held if above[k] == bool(side)]) for side in (0, 1)]
    return tree, put


def _cut(middle: Integers, held: list[int], places: list[tuple[Integers, Integers]]) -> tuple[int, dict[int, bool]]:
    """A coordinate along which no part lies on both sides of the middle, and which parts lie above it."""
    for axis, border in enumerate(middle):
        if all(places[k][0][axis] >= border or places[k][0][axis] + places[k][1][axis] <= border for k in held):
            return axis, {k: bool(places[k][0][axis] >= border) for k in held}
    raise InvalidInputError(
        f"parts {', '.join(str(k + 1) for k in held)} are not got by halving a region: cut it with split_region"
    )


def _place(region: Region, part: Region, k: int) -> tuple[Integers, Integers]:
    """A part's lower corner and edges in the region's whole-number units."""
    scale = WHOLE / region.span
    lower = np.round((part.lower - region.lower) * scale).astype(np.int64)
    size = np.where(region.held, WHOLE, np.round(part.width * scale)).astype(np.int64)
    halved = (size > 0) & (size & (size - 1) == 0) & (lower % np.maximum(size, 1) == 0)
    ends = np.abs(region.position(lower) - part.lower), np.abs(region.position(lower + size) - part.upper)
    if not np.all(halved & (np.maximum(*ends) <= _ALIGNED) & (region.wrapped | ~part.wrapped)):
        raise InvalidInputError(
            f"part {k} from {part.lower.tolist()} to {part.upper.tolist()} is not got by halving the region from "
            f"{region.lower.tolist()} to {region.upper.tolist()}: cut it with split_region"
        )
    return lower, size


def _graft(tree: CellTree, cell: int, part: Atlas, first_box: int, k: int) -> None:
    """Put a part's cells in the place of a cell."""
    size, cells = tree.size[cell], part.tree.cells
    ratio = WHOLE // size
    if np.any(cells.size % ratio):
        raise InvalidInputError(f"part {k} has cells too small to be told apart in the whole region: merge fewer parts")
    start = len(tree.child) - 1
    moved = cells._replace(
        lower=tree.lower[cell] + cells.lower // ratio,
        size=cells.size // ratio,
        child=np.where(cells.child >= 0, cells.child + start, -1),
        box=np.where(cells.box >= 0, cells.box + first_box, -1),
    )
    tree.put(cell, moved)


def _between(tree: CellTree, region: Region, owner: Indices) -> Contacts:
    """The faces that certified cells of different parts share, each once."""
    contacts = contacts_of(tree, region, tree.leaves(CellStatus.CERTIFIED))
    contacts = rows_of(contacts, contacts.upper & (tree.status[contacts.leaf] == CellStatus.CERTIFIED))
    return rows_of(contacts, owner[tree.box[contacts.cell]] != owner[tree.box[contacts.leaf]])


def _agree(atlas: Atlas, contacts: Contacts) -> Mask:
    """At which faces the two boxes are proved to carry the same σ, of shape (K,)."""
    same, independent = np.zeros(len(contacts.cell), dtype=np.bool_), atlas.problem.system.independent
    for start in range(0, len(same), _CHUNK):
        part = rows_of(contacts, slice(start, start + _CHUNK))
        one, other = (atlas.boxes.take(atlas.tree.box[cells]) for cells in (part.cell, part.leaf))
        here = atlas.region.position(part.at_cell) - one.centre[:, independent]
        there = atlas.region.position(part.at_leaf) - other.centre[:, independent]
        same[start : start + _CHUNK] = glued(atlas.problem, one, here, other, there)
    return same


def _refuse_strangers(count: int, owner: Indices, pairs: Indices, same: Mask) -> None:
    """Parts with boxes that no chain of glued faces joins to the first."""
    reached, joins = {0}, {(int(a), int(b)) for a, b in owner[pairs[same]]}
    while new := {b for a, b in joins | {(b, a) for a, b in joins} if a in reached} - reached:
        reached |= new
    for k in range(count):
        if k not in reached and np.any(owner == k):
            faces = int(np.sum(np.any(owner[pairs] == k, axis=1)))
            raise InvalidInputError(
                f"part {k + 1} is not proved to be on the branch of part 1: none of the {faces} faces that its boxes "
                "share with others carries the same σ. Certify it from a closed configuration on that branch (guess=)"
            )
