"""The table: which functions and constants theorems rest on, which tests are to notice a change, and what need not be.

Every number, square, sum, condition and inequality in the places named is changed in turn (`changes`), so nothing in
them can be left out. A change that makes a bound only larger, or a search only less lucky, is *sharpness only*: its
fragment and the reason stand in `rooms`, and so do the places on which no claim rests.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

from tests.mutants.changes import Change, changes_of, parsed, places_of
from tests.mutants.room import Excused, Room
from tests.mutants.rooms import (
    atlases,
    auditing,
    covering,
    domain,
    folds_and_cusps,
    identification,
    proof,
    sheets,
    singular,
    stability,
    theorem2,
    transmission,
    validated,
)
from tests.mutants.running import SOURCES, source_of

_AREAS = (
    proof,
    covering,
    domain,
    atlases,
    theorem2,
    sheets,
    singular,
    folds_and_cusps,
    stability,
    validated,
    identification,
    transmission,
    auditing,
)
ROOMS: tuple[Room, ...] = tuple(room for area in _AREAS for room in area.ROOMS)
EXCUSED: tuple[Excused, ...] = tuple(place for area in _AREAS for place in area.EXCUSED)
WHOLE: tuple[str, ...] = ("auditing", "control/stability", "covering", "domain", "proof", "validated")


class Mutant(NamedTuple):
    """A change, its room, and the reason why it is not run (empty: it is)."""

    room: Room
    change: Change
    reason: str


@cache
def changed_in(room: Room) -> tuple[str, ...]:
    """The places of its module that a room changes."""
    if room.places:
        return room.places
    named = {place for each in (*ROOMS, *EXCUSED) if each.module == room.module for place in each.places}
    there = places_of(parsed(source_of(room.module).read_text()))
    return tuple(place for place in there if place not in named)


def mutants_of(room: Room) -> Iterator[Mutant]:
    """All mutants of a module.

    Raises:
        LookupError: A place or a fragment that the module no longer has.
    """
    unused = set(room.sharpness)
    try:
        for change in changes_of(source_of(room.module).read_text(), changed_in(room)):
            entries = [e for e in room.sharpness if e[0] in change.text and e[1] in change.what]
            unused -= set(entries)
            yield Mutant(room, change, entries[0][2] if entries else "")
    except KeyError as missing:
        raise LookupError(f"{room.module} has no {missing}: the table of mutants is to be mended") from None
    if unused:
        raise LookupError(f"{room.module} has nothing to change at {sorted(unused)}: the table is to be mended")


def unlisted(folder: str) -> list[str]:
    """Places under a folder of the package that have something to change and stand neither in a room nor excused.

    Raises:
        LookupError: Something is excused that is not there.
    """
    named = {(room.module, place) for room in ROOMS for place in changed_in(room)}
    missing: list[str] = []
    for file in sorted((SOURCES / folder).rglob("*.py")):
        module, source = str(file.relative_to(SOURCES).with_suffix("")), file.read_text()
        there = places_of(parsed(source))
        excused = [e for e in EXCUSED if e.module == module]
        gone = {place for e in excused for place in e.places} - set(there)
        if gone:
            raise LookupError(f"{module} has no {sorted(gone)}: the table of mutants is to be mended")
        if any(not e.places for e in excused):
            continue
        free = {place for e in excused for place in e.places}
        missing += [
            f"{module}: {place}"
            for place in there
            if place not in free and (module, place) not in named and any(changes_of(source, (place,)))
        ]
    return missing
