"""A certificate in a file, whatever kind it is of."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def document(path: Path) -> Any:
    """The atlas, the sheets or the cover of singular curves in a file.

    Raises:
        InvalidInputError: It is none.
    """
    from ccpin.containers import format_of
    from ccpin.domain import Atlas, SheetAtlas, SingularCover
    from ccpin.domain.documents import CURVES, SHEETS

    stated = format_of(path)
    for kind, document in ((SHEETS, SheetAtlas), (CURVES, SingularCover)):
        if stated == kind.schema.format:
            return document.load(path)
    return Atlas.load(path)
