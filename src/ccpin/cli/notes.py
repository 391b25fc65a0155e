"""Notes as a reader wants them: what is said of forty joints in the same words is said once."""

from __future__ import annotations

import re
from collections.abc import Iterable

_QUOTED = re.compile(r"'([^']*)'")
_NAMED = 3
"""Names told of those that a sentence holds for."""


def gathered(notes: Iterable[str]) -> list[str]:
    """The notes in their order; those that differ in quoted names only as the first of them, with the others' names."""
    alike: dict[str, list[str]] = {}
    for note in notes:
        alike.setdefault(_QUOTED.sub("''", note), []).append(note)
    return [_one_for_all(same) for same in alike.values()]


def _one_for_all(same: list[str]) -> str:
    others = [f"'{_QUOTED.findall(note)[0]}'" for note in dict.fromkeys(same[1:]) if "'" in note]
    if not others:
        return same[0]
    more = f" and {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    return f"{same[0]} (so too of {', '.join(others[:_NAMED])}{more})"
