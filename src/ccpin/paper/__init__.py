"""The whole paper at one command: every numbered equation, figure and table beside what ccpin makes of it.

`reproduce` computes it, `write` makes one self-contained page of it; the scripts draw single figures with the same
functions.
"""

from __future__ import annotations

from pathlib import Path

from ccpin.files import write_atomically
from ccpin.paper.corrections import errata
from ccpin.paper.experiments import MoveTimes, figure8, figure9, figure10, move_times, poles, why_slower
from ccpin.paper.item import Drawing, Erratum, Item
from ccpin.paper.move_certificate import Theorem3Facts
from ccpin.paper.omega import Radii, figure6, figure7, radii, table_one
from ccpin.paper.reproduction import COUNT, Reproduction, reproduce
from ccpin.paper.reproduction_page import page
from ccpin.paper.study import BENCH, ESTIMATE, GOAL, K_P, K_V, START, WIDTH, Study

__all__ = [
    "BENCH",
    "COUNT",
    "ESTIMATE",
    "GOAL",
    "K_P",
    "K_V",
    "START",
    "WIDTH",
    "Drawing",
    "Erratum",
    "Item",
    "MoveTimes",
    "Radii",
    "Reproduction",
    "Study",
    "Theorem3Facts",
    "errata",
    "figure6",
    "figure7",
    "figure8",
    "figure9",
    "figure10",
    "move_times",
    "page",
    "poles",
    "radii",
    "reproduce",
    "table_one",
    "why_slower",
    "write",
]


def write(found: Reproduction, path: str | Path) -> Path:
    """Write a reproduction as one self-contained page; return its path.

    Raises:
        InvalidInputError: The folder cannot be written to.
    """
    write_atomically(path, "w", lambda file: file.write(page(found)))
    return Path(path)
