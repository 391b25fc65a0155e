"""Names that are nearly right."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that this one is most like, or ``None`` where it is like none."""
    found = get_close_matches(name.lower(), {other.lower(): other for other in known}, n=1, cutoff=0.7)
    return next((other for other in known if found and other.lower() == found[0]), None)


def meant(word: str, known: Iterable[str]) -> str | None:
    """The known word of which this must be a misspelling: its letters in another order, or nearly it."""
    expected = tuple(known)
    shuffled = next((name for name in expected if len(name) > 2 and sorted(name) == sorted(word)), None)
    return shuffled or nearest(word, expected)


def hint(word: str, known: Iterable[str]) -> str:
    """How a sentence about a name that is not known goes on, if one that is must have been meant."""
    near = meant(word, sorted(known))
    return f"; did you mean '{near}'?" if near else ""


def choices(name: str, known: Iterable[str]) -> str:
    """How an error about an unknown name ends: the one that was meant, perhaps, and all there are."""
    listed = tuple(known)
    meant = nearest(name, listed)
    return (f"did you mean '{meant}'? " if meant else "") + f"there are {', '.join(listed) or 'none'}"
