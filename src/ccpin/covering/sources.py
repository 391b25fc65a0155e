"""Which code computed a result that is kept: a proof function that is mended must not be told what it once said."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

import numpy as np

from ccpin.native import backend

_ROOMS = ("arrays.py", "covering", "description", "domain", "kinematics", "mechanism", "native", "proof")


def code_digest(*rooms: str) -> bytes:
    """SHA-256 of the sources that results of tasks rest on, and of the compiled core, where that computes.

    Args:
        rooms: Others than those that certificates rest on.
    """
    core = backend()
    return _digest(core.reason.removeprefix("compiled core ") if core.name == "native" else "", rooms)


@cache
def _digest(core: str, rooms: tuple[str, ...]) -> bytes:
    found, home = hashlib.sha256(np.__version__.encode()), Path(__file__).parents[1]
    for room in (*_ROOMS, *rooms):
        place = home / room
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            found.update(str(path.relative_to(home)).encode() + path.read_bytes())
    if core:
        found.update(Path(core).read_bytes())
    return found.digest()
