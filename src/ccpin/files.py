"""Writing files whole or not at all, or line by line so that what is there stays good."""

from __future__ import annotations

import json
import os
import tempfile
import weakref
from collections.abc import Callable, Mapping
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


class Journal:
    """An append-only file of JSON lines, the first of which says what it is; made to be killed and opened again.

    Each record is one write, flushed to the disk. A last line that was cut off is dropped when the file is opened.
    While it is open no other process can open it as a journal (where the system has locks); processes forked
    meanwhile do not hold it, so it is free when this one ends, however it ends.

    Args:
        path: The file; it and its folder are created where they are absent.
        header: What the first line must say.

    Attributes:
        records: What the file held when it was opened.

    Raises:
        InvalidInputError: The file holds something else, is in use, or cannot be written.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any]) -> None:
        self._path = writable_target(path)
        try:
            self._file = open(self._path, "a+b")  # noqa: SIM115 - closed by `close`
        except OSError as error:
            raise InvalidInputError(f"cannot write '{path}': {error}") from None
        _OPEN.add(self)
        try:
            self._lock()
            self.records = self._read(dict(header))
        except BaseException:
            self._file.close()
            raise

    def append(self, record: Mapping[str, Any]) -> None:
        """Add a line; it is on the disk when this returns."""
        self._file.write(json.dumps(record).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let others open it."""
        self._file.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InvalidInputError(f"'{self._path}' is being written by another process") from None

    def _read(self, header: dict[str, Any]) -> list[dict[str, Any]]:
        self._file.seek(0)
        text = self._file.read()
        whole = text[: text.rfind(b"\n") + 1]
        try:
            lines = [json.loads(line) for line in whole.splitlines()]
        except ValueError:
            lines = [None]
        if (lines and lines[0] != header) or not (whole or json.dumps(header).encode().startswith(text)):
            raise InvalidInputError(f"'{self._path}' holds something else than {header}: name another file")
        self._file.truncate(len(whole))
        if not lines:
            self.append(header)
        return lines[1:]

    def _let_go(self) -> None:
        """In a forked process: give up its copy of the file, which would hold the lock when this process is gone."""
        if not self._file.closed:
            with open(os.devnull, "r+b") as nowhere:
                os.dup2(nowhere.fileno(), self._file.fileno(), inheritable=False)


_OPEN: weakref.WeakSet[Journal] = weakref.WeakSet()


def _let_go_of_all() -> None:
    for journal in list(_OPEN):
        journal._let_go()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go_of_all)
