"""What a line of the table says."""

from __future__ import annotations

from typing import NamedTuple


class Room(NamedTuple):
    """A module's share of the table.

    Attributes:
        module: As ``proof/newton``.
        tests: Files or tests under tests/ that are to notice a change.
        sharpness: (a fragment of a source line, of what is changed there, the reason why it need not be noticed).
        places: Its functions, methods (``Class.method``) and constants that are changed; none named: all that are not
            excused and that no other room of the module names.
    """

    module: str
    tests: tuple[str, ...]
    sharpness: tuple[tuple[str, str, str], ...] = ()
    places: tuple[str, ...] = ()


class Excused(NamedTuple):
    """Places of a module on whose numbers no claim rests.

    Attributes:
        module: As ``covering/proposals``.
        places: Its functions, methods and constants; empty: the whole module.
        reason: Why a wrong number there makes no claim false (a search that proposes and names what checks it, words,
            files).
    """

    module: str
    places: tuple[str, ...]
    reason: str
