"""Writing files whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any

from ccpin.errors import InvalidInputError


def writable_target(path: str | Path) -> Path:
    """A path a file can be written to; its folder is created where it is absent.

    Raises:
        InvalidInputError: It is a folder, or its folder cannot be created or written to.
    """
    if not isinstance(path, str | Path):
        raise InvalidInputError(f"a file to write must be a path, not {type(path).__name__}")
    target = Path(path)
    if target.is_dir():
        raise InvalidInputError(f"cannot write '{target}': it is a folder; name the file to write")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"cannot write '{target}': {error}") from None
    if not os.access(target.parent, os.W_OK):
        raise InvalidInputError(f"cannot write '{target}': its folder is not writable")
    return target


def write_atomically(path: str | Path, mode: str, write: Callable[[IO[Any]], object]) -> None:
    """Write a file whole or not at all: a temporary file beside it, then a rename over it.

    Args:
        path: The file; its folder is created where it is absent.
        mode: ``"w"`` for text (UTF-8), ``"wb"`` for bytes.
        write: Called with the open temporary file.

    Raises:
        InvalidInputError: The file cannot be written; what was there before is still there.
    """
    target = writable_target(path)
    try:
        descriptor, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name[:40]}.")
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"cannot write '{target}': {error}") from None
    try:
        with os.fdopen(descriptor, mode, encoding=None if "b" in mode else "utf-8") as file:
            write(file)
        os.chmod(name, 0o644)
        os.replace(name, target)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{target}': {error}") from None
    finally:
        Path(name).unlink(missing_ok=True)
