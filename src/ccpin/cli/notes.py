"""Notes as a reader wants them: what is said of forty joints in the same words is said once."""

from __future__ import annotations

import re
from collections.abc import Iterable

_QUOTED = re.compile(r"'([^']*)'")
_NUMBER = re.compile(r"(?<![\w.])[-−+]?\d+(\.\d+)?(e[-+]?\d+)?")
_NAMED = 3
"""Names told of those that a sentence holds for."""


def gathered(notes: Iterable[str]) -> list[str]:
    """The notes in their order; those that differ in quoted names and numbers as the first of them, with who else.

    The numbers of the others are left out, and that is told; a note about nothing quoted stays as it is.
    """
    alike: dict[str, list[str]] = {}
    for note in dict.fromkeys(notes):
        alike.setdefault(_NUMBER.sub("0", _QUOTED.sub("''", note)) if "'" in note else note, []).append(note)
    return [_one_for_all(same) for same in alike.values()]


def _one_for_all(same: list[str]) -> str:
    if len(same) == 1:
        return same[0]
    others = list(dict.fromkeys(f"'{_QUOTED.findall(note)[0]}'" for note in same[1:]))
    alike = len({_QUOTED.sub("''", note) for note in same}) == 1
    return f"{same[0]} (so too{'' if alike else ', with other numbers,'} of {listed(others)})"


def listed(names: list[str]) -> str:
    """The first of them, and how many more."""
    if len(names) <= _NAMED + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_NAMED])} and {len(names) - _NAMED} more"
