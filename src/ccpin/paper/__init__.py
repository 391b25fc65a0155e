"""The whole paper at one command: every numbered equation, figure and table beside what ccpin makes of it.

`reproduce` computes it, `write` makes one self-contained page of it; the scripts draw single figures with the same
functions.
"""

from __future__ import annotations

from pathlib import Path

from ccpin.files import write_text
from ccpin.paper.experiments import figure8, figure9, figure10, move_times
from ccpin.paper.omega import figure6, figure7, table_one
from ccpin.paper.reproduction import Reproduction, reproduce
from ccpin.paper.reproduction_page import page
from ccpin.paper.study import Study

__all__ = [
    "Study",
    "figure6",
    "figure7",
    "figure8",
    "figure9",
    "figure10",
    "move_times",
    "reproduce",
    "table_one",
    "write",
]
__dir__ = __all__.copy


def write(found: Reproduction, path: str | Path) -> Path:
    """Write a reproduction as one self-contained page; return its path.

    Raises:
        InvalidInputError: The folder cannot be written to.
    """
    write_text(path, page(found))
    return Path(path)
