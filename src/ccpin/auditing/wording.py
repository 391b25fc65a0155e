"""What a document claims as a whole, and what of it nobody looked at, in words.

Shares and numbers are those that the cells and boxes have, which `cells` has shown to tile the region and to belong to
each other: none is taken from a field that says it.
"""

from __future__ import annotations

import numpy as np

from ccpin.auditing.closures import BallClosures
from ccpin.auditing.exclusion import listed_share
from ccpin.auditing.gluing import sheets_of
from ccpin.auditing.reading import ClaimedDocument, Curves

_FILE = (
    "that the closures are those of a file (compare the fingerprint); what joints are called, and how a configuration "
    "is made of their coordinates; the theorem's text; whether the work was complete"
)
_ITERATED = "Ã, w and κ, with which solutions are found in boxes (whoever loads the document proves boxes with them)"
_ASKED = "that limits, driven joints and dexterity are those that were asked for"
_LEFT = "what encloses singular configurations over cells that are not counted (cusps are looked for from there)"
_CURVES = (
    "what singular configurations the {} boxes hold that the document leaves uncovered ({:.3g} % at most of all "
    "coordinates' ranges); those beyond the region and beyond limits; whether two curves that end are one "
    "that goes on between them; their kinds; how many boxes were tried, and how small"
)


def claimed(document: ClaimedDocument | Curves) -> str:
    """What the document claims as a whole."""
    where = ", ".join(
        f"{name} from {low:.6g} to {high:.6g}" if low < high else f"{name} = {low:.6g}"
        for name, low, high in zip(document.header["names"], document.lower, document.upper, strict=True)
    )
    told = _of_curves(document) if isinstance(document, Curves) else _of_cells(document)
    return f"over {where}{_limits(document)}: {told}"


def _limits(document: ClaimedDocument | Curves) -> str:
    """Within which limits configurations are meant."""
    stated, none = document.ranges, np.finfo(np.float64).max
    if stated is None:
        return ""
    words = [
        f"coordinate {j} from {low:.6g} to {high:.6g}".replace(f"{-none:.6g}", "−∞").replace(f"{none:.6g}", "∞")
        for j, (low, high) in zip(document.dependent.tolist(), stated.limits.tolist(), strict=True)
        if low > -none or high < none
    ]
    return f" and of configurations with {', '.join(words)}" if words else ""


def _of_curves(document: Curves) -> str:
    count, left = len(document.sizes), len(document.uncovered_lower)
    closed = int(np.count_nonzero(document.closed))
    all_of = (
        "every singular configuration lies" if not left else f"beyond {left} boxes every singular configuration lies"
    )
    return f"{all_of} on one of {count} curves in {len(document.tubes)} tubes; {closed} of them close on themselves"


def _of_cells(document: ClaimedDocument) -> str:
    boxes = len(document.centre)
    told = ", ".join(f"{100.0 * share:.6g} % {name}" for name, share in document.shares.items())
    if document.faces is None:
        one = "one function" if not len(document.unglued) else f"one function but for {len(document.unglued)} faces"
        radius = f"the square of half width {document.header['radius']:.6g} about the seed is certified"
        return f"{told}; σ is {one} on {boxes} boxes; {radius}"
    sheets = len(np.unique(sheets_of(document, document.faces)))
    return f"{told}, of which it is said how many configurations there are; {sheets} sheets in {boxes} boxes"


def besides(document: ClaimedDocument | Curves) -> str:
    """What is not looked at."""
    if isinstance(document, Curves):
        share = listed_share(BallClosures(document), document)
        listed = _CURVES.format(len(document.uncovered_lower), 100.0 * share)
        return f"{listed}; {_FILE}"
    more = _LEFT if document.counts is not None else _ASKED if document.demands is not None else None
    return "; ".join(part for part in (more, _ITERATED, _FILE) if part)
