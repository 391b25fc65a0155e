"""Validated integration: enclosures of closed-loop motions that are theorems, and what follows from them.

Needs python-flint (the extra ``validated``), which is imported when a function is called.
"""

from __future__ import annotations

from ccpin.validated.certificate import MoveCertificate, certify_move
from ccpin.validated.enclose import Bounds, Enclosure, enclose

__all__ = ["Bounds", "Enclosure", "MoveCertificate", "certify_move", "enclose"]
