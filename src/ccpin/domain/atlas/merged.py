"""Atlases of parts of a region, made apart, as the one atlas of the region.

What is sound. A box satisfies Theorem N of `boxes` whatever atlas it is in, and a cell that is empty or singular is so
whatever the branch. Every box of a part is reached from the part's seed over glued faces. So where a box of one part
and one of another are glued at a face that they share (the corollary of `boxes`), all boxes of both parts are reached
from either seed. Parts are joined in this way, beginning with the first; one that no glued face joins to it may be of
another assembly mode, and is refused. Every other shared face is glued too, or listed.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ccpin.arrays import Array, Indices, Mask, joined, numbers, rows_of, whole
from ccpin.covering.cells import CellStatus, CellTree
from ccpin.covering.claims import proved_glue
from ccpin.covering.faces import CellFaces, contacts_of
from ccpin.covering.merging import grafted, whole_region
from ccpin.covering.region import Corners, Region, corners_of
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.cover_claims import proved_cover, seams_of
from ccpin.domain.atlas.emptying import empty_facts
from ccpin.domain.atlas.radius_map import certified_radius
from ccpin.domain.closures.packing import same_reading
from ccpin.errors import InvalidInputError
from ccpin.proof.solutions import boxes_of


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
    region = whole_region(parts)
    tree, places = grafted(region, parts)
    solutions = tuple(fact for part in parts for fact in part.solutions)
    owner = np.repeat(np.arange(len(parts)), [len(part.boxes.kappa) for part in parts])
    seams = seams_of(parts[0].problem, region, tree, boxes_of(solutions), _between(tree, region, owner))
    glue = [fact for part in parts for fact in part.glue()]
    glue += proved_glue(parts[0].problem, seams, solutions)
    proved = proved_cover(parts[0].problem, region, tree, parts[0].seed, solutions, tuple(glue))
    _refuse_strangers(owner, proved.cover.found["reached"])
    proved = proved._replace(empty=empty_facts(parts[0].reading, region, tree))
    merged = replace(
        parts[0],
        solutions=solutions,
        proved=proved,
        complete=all(part.complete for part in parts),
        region=region,
        tree=tree,
        singular=joined(
            part.singular._replace(cell=place.of(part.singular.cell)) for part, place in zip(parts, places, strict=True)
        ),
    )
    return replace(merged, radius=float(certified_radius(merged, merged.region.reduce(merged.q0[None]))[0]))


def _refuse_others(first: Atlas, other: Atlas, k: int) -> None:
    """What speaks of other things than the first."""
    if first.fingerprint != other.fingerprint or first.names != other.names:
        raise InvalidInputError(
            f"part {k} is about other closures than part 1: parts are of one mechanism as one file states it (where it "
            "has ball joints or distances, whose charts are centred at q0, from one q0)"
        )
    if not same_reading(first.reading, other.reading):
        raise InvalidInputError(f"part {k} has other bounds=, limits= or dexterity= than part 1: they must be the same")
    if np.any(first.region.held != other.region.held):
        raise InvalidInputError(f"part {k} holds other coordinates than part 1: slices are merged with slices")


def _between(tree: CellTree, region: Region, owner: Indices) -> CellFaces:
    """The faces that certified cells of different parts share, each once."""
    contacts = contacts_of(tree, region, tree.leaves(CellStatus.CERTIFIED))
    contacts = rows_of(contacts, contacts.upper & (tree.status[contacts.leaf] == CellStatus.CERTIFIED))
    return rows_of(contacts, owner[tree.box[contacts.cell]] != owner[tree.box[contacts.leaf]])


def _refuse_strangers(owner: Indices, reached: Mask) -> None:
    """Parts with boxes none of which a way over glued faces joins to the seed's."""
    for k in np.setdiff1d(owner, owner[reached]).tolist():
        if k:
            raise InvalidInputError(
                f"part {k + 1} is not proved to be on the branch of part 1: none of the faces that its boxes "
                "share with others carries the same σ. Certify it from a closed configuration on that branch (near=)"
            )
