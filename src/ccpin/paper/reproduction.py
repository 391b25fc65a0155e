"""The whole paper at one call: every item of every chapter, the errata, and what they were computed with."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from ccpin.arrays import listener
from ccpin.pages.provenance import versions
from ccpin.paper import control, experiments, modeling, omega, reduced, robot
from ccpin.paper.corrections import errata
from ccpin.paper.item import Erratum, Item
from ccpin.paper.study import Study

CHAPTERS: tuple[tuple[str, Callable[[Study], Iterator[Item]]], ...] = (
    ("Free system and constraints", modeling.items),
    ("The reduced model", reduced.items),
    ("The Rice Planar Delta Robot", robot.items),
    ("The domain Ω", omega.items),
    ("PD control", control.items),
    ("Experiments", experiments.items),
)
COUNT = 39
"""How many items there are, for a bar's end; a test holds it."""


class Reproduction(NamedTuple):
    """The paper, recomputed.

    Attributes:
        chapters: (title, items) in the paper's order.
        errata: What must be read otherwise.
        versions: (name, value) of what it was computed with.
        seconds: How long it took.
        slowest: The item that took longest, in words.
    """

    chapters: tuple[tuple[str, tuple[Item, ...]], ...]
    errata: tuple[Erratum, ...]
    versions: tuple[tuple[str, str], ...]
    seconds: float
    slowest: str

    @property
    def items(self) -> tuple[Item, ...]:
        """All items in their order."""
        return tuple(item for _, items in self.chapters for item in items)

    @property
    def agrees(self) -> bool:
        """Whether every item is within its bound."""
        return all(item.agrees for item in self.items)

    def as_json(self) -> dict[str, Any]:
        """All but the figures: JSON-ready."""
        return {
            "agrees": self.agrees,
            "items": [item.as_json() | {"chapter": title} for title, items in self.chapters for item in items],
            "errata": [one._asdict() for one in self.errata],
            "versions": dict(self.versions),
            "seconds": self.seconds,
        }


def reproduce(progress: Callable[[Item], None] | None = None) -> Reproduction:
    """Compute every item and the errata; minutes at most.

    Args:
        progress: Called with each item once it is there.
    """
    told = listener(progress)
    study, began = Study(), time.perf_counter()
    chapters, spent = [], list[tuple[float, str]]()
    for title, items in CHAPTERS:
        done, before = [], time.perf_counter()
        for item in items(study):
            done.append(item)
            spent.append((time.perf_counter() - before, item.number))
            before = time.perf_counter()
            told(item)
        chapters.append((title, tuple(done)))
    corrected = tuple(errata(study))
    longest = max(spent)
    seconds = time.perf_counter() - began
    return Reproduction(tuple(chapters), corrected, versions(), seconds, f"{longest[1]}, {longest[0]:.0f} s")
