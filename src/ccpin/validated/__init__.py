"""Validated integration: enclosures of closed-loop motions that are theorems, and what follows from them.

Needs python-flint (the extra ``validated``), which is imported when a function is called.
"""

from __future__ import annotations

from ccpin.validated.flow.enclosure import Enclosure, StateBox, enclose
from ccpin.validated.sets.move import MoveCertificate, certify_move
from ccpin.validated.sets.set_enclosure import SetEnclosure, enclose_set
from ccpin.validated.sets.subdivision import Starts, Tube

__all__ = [
    "Enclosure",
    "MoveCertificate",
    "SetEnclosure",
    "Starts",
    "StateBox",
    "Tube",
    "certify_move",
    "enclose",
    "enclose_set",
]
