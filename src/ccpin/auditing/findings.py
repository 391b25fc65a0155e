"""What an auditor finds: of each kind of claim how many were proved, refuted and left open, and what that says."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

_ENOUGH = 8  # claims of a kind that are not proved: no more of it are looked at
_SEARCHED = ("empty", "count", "cover")  # what is searched for
_LONG = 4  # for how many such a one counts that is not decided
_WORDS = {
    "box": "boxes with exactly one nonsingular solution",
    "glue": "shared faces with one σ",
    "apart": "shared faces at which two sheets have two σ",
    "empty": "cells without a closed configuration",
    "singular": "cells with a singular configuration",
    "demand": "boxes within the limits, motors in hold of them, as dexterous as said",
    "count": "cells with as many closed configurations, none singular",
    "tube": "tubes with one singular curve each",
    "joint": "tubes whose curve goes on in the next",
    "once": "tubes whose curve is no other one on the list",
    "cover": "parts of the region without other singular configurations",
}

Result = tuple[str, tuple[int, ...], "bool | None", bool]
"""A kind of claim, which of them, whether it was proved or refuted, and whether there is a way to look at it."""


class Claim(NamedTuple):
    """One kind of claim.

    Attributes:
        what: What it says.
        of: How many there are.
        checked: How many were looked at.
        failed: Which of these were refuted: the document says what is false.
        undecided: Which of these were neither proved nor refuted.
    """

    what: str
    of: int
    checked: int
    failed: tuple[tuple[int, ...], ...]
    undecided: tuple[tuple[int, ...], ...] = ()


@dataclass(frozen=True)
class Audit:
    """What an auditor found.

    Attributes:
        theorem: The theorem's text, as the document has it.
        fingerprint: SHA-256 of the closures it is about.
        claims: The claims checked.
        not_checked: What the document says besides, in words.
        claim: What the document claims as a whole, in words: shares of the region as its cells have them, and numbers
            as its boxes have them.
    """

    theorem: str
    fingerprint: str
    claims: tuple[Claim, ...]
    not_checked: str
    claim: str

    @property
    def holds(self) -> bool:
        """Whether everything looked at was proved: where all was, `claim` is true."""
        return not any(claim.failed or claim.undecided for claim in self.claims)

    @property
    def refuted(self) -> bool:
        """Whether something that the document says was proved to be false."""
        return any(claim.failed for claim in self.claims)

    @property
    def whole(self) -> bool:
        """Whether every claim of the kinds in `claims` was looked at."""
        return all(claim.checked == claim.of for claim in self.claims)

    def __str__(self) -> str:
        lines = [f"closures {self.fingerprint[:16]}…", self.claim]
        for claim in self.claims:
            some = "" if claim.checked == claim.of else f" of {claim.of}"
            good = claim.checked - len(claim.failed) - len(claim.undecided)
            lines.append(f"{claim.what}: {good} proved of {claim.checked} looked at{some}")
            for word, which in (("FALSE", claim.failed), ("not decided", claim.undecided)):
                if which:
                    shown = ", ".join(str(f[0] if len(f) == 1 else f) for f in which[:_ENOUGH])
                    lines.append(f"  {word}: {shown}{', …' if len(which) > _ENOUGH else ''}")
        return "\n".join([*lines, f"not looked at: {self.not_checked}"])


class Outcomes:
    """What was found of each kind of claim."""

    def __init__(self, kinds: dict[str, list[Any]]) -> None:
        self._kinds = kinds
        self._looked = dict.fromkeys(kinds, 0)
        self._open: dict[str, list[tuple[tuple[int, ...], bool | None]]] = {kind: [] for kind in kinds}

    def add(self, kind: str, which: tuple[int, ...], good: bool | None, seen: bool) -> None:
        """One more; none where enough of its kind were not proved, so that the work has an end."""
        if not seen or self.enough(kind):
            return
        self._looked[kind] += 1
        if good is not True:
            self._open[kind].append((which, good))

    def enough(self, kind: str) -> bool:
        """Whether so many of a kind were not proved that no more are looked at; searches without end count for more."""
        long = _LONG if kind in _SEARCHED else 1
        return sum(1 if good is False else long for _, good in self._open[kind]) >= _ENOUGH

    def claim(self, kind: str) -> Claim:
        """What was found of a kind."""
        failed, undecided = (
            tuple(sorted(which for which, good in self._open[kind] if good is word)) for word in (False, None)
        )
        return Claim(_WORDS[kind], len(self._kinds[kind]), self._looked[kind], failed, undecided)
