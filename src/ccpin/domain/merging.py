"""Certificates of parts of a region, made apart, as one of the region."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypeVar

from ccpin.arrays import instance
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.atlas.merged import merge_atlases
from ccpin.domain.sheets.merged import merge_sheets
from ccpin.domain.sheets.sheets import SheetAtlas
from ccpin.domain.singular.curves import SingularCover
from ccpin.domain.singular.merged import merge_covers
from ccpin.errors import InvalidInputError

Part = TypeVar("Part", Atlas, SheetAtlas, SingularCover)


def merge(parts: Sequence[Part]) -> Part:
    """One atlas, sheet atlas or cover of singular curves of several, over the parts of one region.

    The parts are made each on its own, with any effort, anywhere; `split_region` has suitable regions. What they make
    is saved, verified, asked and merged again as any other.

    Atlases are of one branch: made by `certify` (or `certify_workspace`) each from a closed configuration of its own
    over its region. The first one's q₀ is that of the whole. Faces between two parts at which they were not shown to
    carry the same σ are in `unglued`.

    Sheet atlases are `certify_sheets`'s, of every assembly mode. Boxes on the two sides of a seam are glued where they
    carry the same σ: sheets of several parts are one there.

    Covers are `certify_singularities`'s, of every assembly mode. Each singular configuration over the whole region is
    on a curve of one of them or in a box that one of them lists. Curves that go on from one part into another are
    joined, and those that several parts have are listed once, where that is proved; else each stays, as if it were a
    curve of its own, of which the claim is as true. Covers that were proved here, and not read from files, are proved
    once more as a whole, which takes as long as all of them.

    Args:
        parts: Atlases or sheet atlases over regions that are got from one box by halving it, and its parts, along
            coordinates; or covers over regions that fill a box together, and may overlap.

    Returns:
        That of the whole region, complete if all are.

    Raises:
        InvalidInputError: They are about other closures, demands or ranges, their regions leave a gap; or of atlases
            and sheet atlases: they overlap or are not got by halving; or of atlases: one is not proved to be on the
            first one's branch.
    """
    if not isinstance(parts, Iterable):
        raise InvalidInputError(f"parts must be a list of atlases, or of covers, not {type(parts).__name__}")
    given = list(parts)
    if not given:
        raise InvalidInputError("there is nothing to merge: give atlases, sheet atlases or covers of singular curves")
    if isinstance(given[0], SingularCover):
        covers = [instance(part, f"parts[{k}]", SingularCover, "a SingularCover") for k, part in enumerate(given)]
        return replace(merge_covers(covers), source=_sources(covers))
    if isinstance(given[0], SheetAtlas):
        sheets = [instance(part, f"parts[{k}]", SheetAtlas, "a SheetAtlas") for k, part in enumerate(given)]
        return replace(merge_sheets(sheets), source=_sources(sheets))
    what = "an Atlas, or all are sheet atlases, or covers of singular curves"
    atlases = [instance(part, f"parts[{k}]", Atlas, what) for k, part in enumerate(given)]
    return replace(merge_atlases(atlases), source=_sources(atlases))


def _sources(parts: Sequence[Atlas | SheetAtlas | SingularCover]) -> str | None:
    """The files that a whole rests on; ``None`` where none of its parts was loaded."""
    return ", ".join(dict.fromkeys(part.source for part in parts if part.source is not None)) or None
