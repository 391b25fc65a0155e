"""What a line of the table says."""

from __future__ import annotations

from typing import NamedTuple


class Room(NamedTuple):
    """A module's share of the table.

    Attributes:
        module: As ``proof/newton``.
        places: Its functions, methods (``Class.method``) and constants that are changed.
        tests: Files or tests under tests/ that are to notice it.
        sharpness: (a fragment of a source line, of what is changed there, the reason why it need not be noticed).
    """

    module: str
    places: tuple[str, ...]
    tests: tuple[str, ...]
    sharpness: tuple[tuple[str, str, str], ...] = ()


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
