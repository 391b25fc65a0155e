"""Validated integration: enclosures of closed-loop motions that are theorems, and what follows from them.

Needs python-flint (the extra ``validated``), which is imported when a function is called.
"""

from __future__ import annotations

from ccpin.validated.certificate import MoveCertificate, certify_move
from ccpin.validated.enclose import Enclosure, StateBox, enclose

__all__ = ["Enclosure", "MoveCertificate", "StateBox", "certify_move", "enclose"]
