"""A certificate in a file, whatever kind it is of."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any


def document(path: Path) -> Any:
    """The atlas, the sheets or the cover of singular curves in a file.

    Raises:
        InvalidInputError: It is none.
    """
    from ccpin.domain import Atlas, SheetAtlas, SingularCover
    from ccpin.errors import InvalidInputError

    for kind in (SingularCover, SheetAtlas):
        with contextlib.suppress(InvalidInputError):
            return kind.load(path)
    return Atlas.load(path)
