"""Sheets over parts of a region, made apart, as those over the region.

What is sound. What is said of a cell (how many closed configurations each of its q has, that there are none, that one
is singular), of the boxes over it (Theorem N) and of two glued ones is about that cell and those boxes, whatever the
region they are cells of: it stands. Boxes on the two sides of a seam are glued where the corollary of `boxes` proves
that they carry the same σ there, as all others are. Parts count within the same limits, and so does the whole: the
ranges over all of the region are derived anew (Lemma R of `ccpin.proof.ranges`), and all of it is proved once more, as
one. The boxes that enclose all singular
closed configurations over each part enclose together those over the whole.

Sheets of two parts are one where such gluing joins them; on it, as on any, assembly modes may change places round a
cusp that no part has whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from threading import Event

import numpy as np

from ccpin.arrays import joined, rows_of
from ccpin.covering.merging import grafted, whole_region
from ccpin.covering.runner import Runner
from ccpin.domain.closures.packing import same_reading
from ccpin.domain.sheets.cover import Members, glued_pairs
from ccpin.domain.sheets.sheet_claims import mark, proved_again
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.errors import InvalidInputError
from ccpin.proof.ranges import ranges_over


def merge_sheets(parts: Sequence[SheetAtlas]) -> SheetAtlas:
    """One sheet atlas of several, of which there is one at least; `ccpin.domain.merge` says the rest."""
    for k, other in enumerate(parts[1:], start=2):
        _refuse_others(parts[0], other, k)
    region = whole_region(parts)
    tree, places = grafted(region, parts)
    pairs = list(zip(parts, places, strict=True))
    boxes, first = joined(part.boxes for part in parts), np.cumsum([0, *(len(part.boxes.kappa) for part in parts)])
    members = joined(
        Members(place.of(part.members.cell), part.members.box + start)
        for (part, place), start in zip(pairs, first[:-1], strict=True)
    )
    members = rows_of(members, np.argsort(members.cell, kind="stable"))
    count = np.full(len(tree.child), -1, dtype=np.int64)
    for part, place in pairs:
        count[place.of(np.arange(len(part.count)))] = part.count
    problem, runner = parts[0].problem, Runner(parts[0].problem, None, None, Event())
    ranges = ranges_over(problem.system, parts[0].ranges, (region.lower, region.upper))
    merged = replace(
        parts[0],
        region=region,
        ranges=ranges,
        tree=tree,
        boxes=boxes,
        members=members,
        glued=glued_pairs(runner, region, tree, members, boxes),
        count=count,
        left=joined(part.left._replace(cell=place.of(part.left.cell)) for part, place in pairs),
        singular=joined(part.singular._replace(cell=place.of(part.singular.cell)) for part, place in pairs),
        complete=all(part.complete for part in parts),
        proved=None,
    )
    proved = proved_again(runner, merged)
    mark(tree, proved)
    return replace(
        merged, boxes=proved.boxes, members=proved.members, glued=proved.glued, count=proved.count, proved=proved
    )


def _refuse_others(first: SheetAtlas, other: SheetAtlas, k: int) -> None:
    """What speaks of other things than the first."""
    if first.names != other.names or not same_reading(first.reading, other.reading):
        raise InvalidInputError(
            f"part {k} is about other closures, or other bounds=, than part 1: parts are of one mechanism as one file "
            "states it"
        )
    if np.any(first.ranges.limits != other.ranges.limits):
        raise InvalidInputError(f"part {k} counts between other limits than part 1")
