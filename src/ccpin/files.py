"""Writing files whole or not at all, or line by line so that what is there stays good."""

from __future__ import annotations

import abc
import io
import json
import os
import secrets
import stat
import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import IO, Any, TypeVar, overload

from ccpin.errors import InvalidInputError

T = TypeVar("T")


def writable_target(path: str | Path) -> Path:
    """A path a file can be written to; its folder is created where it is absent.

    Raises:
        InvalidInputError: It is a folder or a socket, or its folder cannot be created or written to.
    """
    if not isinstance(path, str | Path):
        raise InvalidInputError(f"a file to write must be a path, not {type(path).__name__}")
    target = Path(path)
    try:
        if target.is_dir():
            raise InvalidInputError(f"cannot write '{target}': it is a folder; name the file to write")
        if target.is_socket():
            raise InvalidInputError(f"cannot write '{target}': it is a socket")
        target.parent.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"cannot write '{target}': {error}") from None
    if not (_is_special(target) or os.access(target.parent, os.W_OK)):
        raise InvalidInputError(f"cannot write '{target}': its folder is not writable")
    return target


def writable_folder(path: str | Path, name: str) -> Path:
    """A folder that files can be written to; it is created where it is absent.

    Args:
        path: The folder.
        name: The argument that it is.

    Raises:
        InvalidInputError: It is no folder, or cannot be created or written to; or it is not named (``""``).
    """
    if not isinstance(path, str | Path) or not str(path):
        raise InvalidInputError(f"{name} must name a folder; it is {path!r}")
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise InvalidInputError(f"{name} '{folder}' is no folder to write to: {error}") from None
    if not os.access(folder, os.W_OK | os.X_OK):
        raise InvalidInputError(f"{name} '{folder}' is no folder to write to: it is not writable")
    return folder


def write_atomically(path: str | Path, mode: str, write: Callable[[IO[Any]], object]) -> None:
    """Write a file whole or not at all.

    It is written under no name (where the system has no files without one, under another name beside it) and then
    takes the place of what was there, whose permissions and, where it may, owner it keeps. A link stays a link: what
    it points to is written. Devices and pipes are no files that another could take the place of: once all is known
    it is written into them.

    Args:
        path: The file; its folder is created where it is absent.
        mode: ``"w"`` for text (UTF-8), ``"wb"`` for bytes.
        write: Called with an open file.

    Raises:
        InvalidInputError: The file cannot be written; what was there before is still there.
    """
    target = writable_target(path)
    try:
        if _is_special(target):
            _write_into(target, mode, write)
        else:
            _replace(Path(os.path.realpath(target)), mode, write)
    except OSError as error:
        raise InvalidInputError(f"cannot write '{target}': {error}") from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole or not at all; as `write_atomically`."""
    write_atomically(path, "w", lambda file: file.write(text))


def _is_special(target: Path) -> bool:
    """Whether something is there that is no regular file."""
    return target.exists() and not target.is_file()


def _write_into(target: Path, mode: str, write: Callable[[IO[Any]], object]) -> None:
    """Write into a device or a pipe, in which nothing can be sought."""
    held: IO[Any] = io.BytesIO() if "b" in mode else io.StringIO()
    write(held)
    held.seek(0)
    with target.open(mode, encoding=_encoding(mode)) as file:
        file.write(held.read())


def _replace(target: Path, mode: str, write: Callable[[IO[Any]], object]) -> None:
    """Put a new file in the place of a regular one, or of none."""
    part = target.parent / f".{target.name[:40]}.{secrets.token_hex(8)}"
    descriptor, named = _new_file(target.parent, part)
    try:
        with os.fdopen(descriptor, mode, encoding=_encoding(mode)) as file:
            write(file)
            file.flush()
            _take_after(target, descriptor)
            if not named:
                _name(descriptor, part)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)


def _new_file(folder: Path, part: Path) -> tuple[int, bool]:
    """A new file in a folder, and whether it has a name: one without is gone with the process that writes it."""
    with suppress(AttributeError, OSError):
        return os.open(folder, os.O_TMPFILE | os.O_RDWR, 0o666), False
    return os.open(part, os.O_CREAT | os.O_EXCL | os.O_RDWR | getattr(os, "O_BINARY", 0), 0o666), True


def _name(descriptor: int, part: Path) -> None:
    """Give a file without a name one."""
    folder = os.open(part.parent, os.O_RDONLY)
    try:
        os.link(f"/proc/self/fd/{descriptor}", part, src_dir_fd=folder)  # with a folder, the system follows the link
    finally:
        os.close(folder)


def _take_after(target: Path, descriptor: int) -> None:
    """Give a new file the permissions and, where that is allowed, the owner of the one whose place it takes."""
    with suppress(FileNotFoundError, AttributeError):  # nothing there; or a system without such permissions
        there = target.stat()
        with suppress(PermissionError):
            os.fchown(descriptor, there.st_uid, there.st_gid)
        os.fchmod(descriptor, stat.S_IMODE(there.st_mode))


def _encoding(mode: str) -> str | None:
    return None if "b" in mode else "utf-8"


class OneByOne(Sequence[T], abc.ABC):
    """A sequence whose members are got one by one, by their number."""

    @overload
    def __getitem__(self, place: int) -> T: ...

    @overload
    def __getitem__(self, place: slice) -> list[T]: ...

    def __getitem__(self, place: int | slice) -> T | list[T]:
        if isinstance(place, slice):
            return [self[k] for k in range(*place.indices(len(self)))]
        return self._one(range(len(self))[place])

    @abc.abstractmethod
    def _one(self, number: int) -> T:
        """Member 0 ≤ number < len(self)."""


class Journal(OneByOne[dict[str, Any]]):
    """An append-only file of JSON lines, the first of which says what it is; made to be killed and opened again.

    Each record is one write, synchronised with the disk. A last line that was cut off is dropped when the file is
    opened. While it is open no other process can open it as a journal (where the system has locks); processes forked
    meanwhile do not hold it, so it is free when this one ends, however it ends.

    Its records are read when they are asked for, also after `close`, so memory does not grow with the file.

    Args:
        path: The file; it and its folder are created where they are absent.
        header: What the first line must say.

    Raises:
        InvalidInputError: The file holds something else, is in use, or cannot be read or written.
    """

    def __init__(self, path: str | Path, header: Mapping[str, Any]) -> None:
        self._path = writable_target(path)
        if _is_special(self._path):
            raise InvalidInputError(f"'{path}' is no regular file, and a journal is read again: name another file")
        self._starts: list[int] = []
        self._end = 0
        try:
            self._file = open(self._path, "a+b")  # noqa: SIM115 - closed by `close`
        except OSError as error:
            raise InvalidInputError(f"cannot write '{path}': {error}") from None
        _OPEN.add(self)
        try:
            self._lock()
            self._read(dict(header))
        except BaseException:
            self._file.close()
            raise

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    def __len__(self) -> int:
        return len(self._starts)

    def _one(self, number: int) -> dict[str, Any]:
        try:
            with self._path.open("rb") as file:
                file.seek(self._starts[number])
                return dict(json.loads(file.readline()))
        except (OSError, ValueError, TypeError) as error:
            raise InvalidInputError(f"'{self._path}' was changed while it was in use: {error}") from None

    def append(self, record: Mapping[str, Any]) -> None:
        """Add a line; it is on the disk when this returns.

        Raises:
            InvalidInputError: It cannot be written; nothing of it is left in the file.
        """
        start = self._end
        self._write(record)
        self._starts.append(start)

    def close(self) -> None:
        """Let others open it; what it holds can still be read."""
        self._file.close()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _write(self, record: Mapping[str, Any]) -> None:
        line, file = json.dumps(record).encode() + b"\n", self._file.fileno()
        try:
            left = memoryview(line)
            while left:
                left = left[os.write(file, left) :]
            os.fsync(file)
        except BaseException as error:
            with suppress(OSError):
                os.ftruncate(file, self._end)
            if isinstance(error, OSError):
                raise InvalidInputError(f"cannot write '{self._path}': {error}") from None
            raise
        self._end += len(line)

    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InvalidInputError(f"'{self._path}' is being written by another process") from None

    def _read(self, header: dict[str, Any]) -> None:
        """Find where the records begin; cut off what is behind the last whole one."""
        starts, line = [], b""
        self._file.seek(0)
        for line in self._file:
            if line.endswith(b"\n"):
                starts.append(self._end)
                self._end += len(line)
        if starts and _parsed(line) is None and len(starts) > 1 and line.endswith(b"\n"):
            self._end = starts.pop()
        self._check(header, beginning=line if not starts else None)
        self._file.truncate(self._end)
        if not starts:
            self._write(header)
        self._starts = starts[1:]

    def _check(self, header: dict[str, Any], beginning: bytes | None) -> None:
        """The first line says what it must; where none is whole, what there is is the beginning of one that does."""
        if beginning is not None:
            if json.dumps(header).encode().startswith(beginning):
                return
            raise InvalidInputError(f"'{self._path}' is no journal: name another file")
        self._file.seek(0)
        found, wanted = _parsed(self._file.readline()), json.loads(json.dumps(header))
        if found is None:
            raise InvalidInputError(f"'{self._path}' is no journal: name another file")
        names = sorted(name for name in {*found, *wanted} if found.get(name) != wanted.get(name))
        if names:
            told = "; ".join(f"{name} is {found.get(name)} there and {wanted.get(name)} here" for name in names)
            raise InvalidInputError(f"'{self._path}' is the journal of another task: {told}")

    def _let_go(self) -> None:
        """In a forked process: give up its copy of the file, which would hold the lock when this process is gone."""
        if not self._file.closed:
            with open(os.devnull, "r+b") as nowhere:
                os.dup2(nowhere.fileno(), self._file.fileno(), inheritable=False)


def _parsed(line: bytes) -> dict[str, Any] | None:
    """A record; ``None`` where the line is none."""
    try:
        found = json.loads(line)
    except ValueError:
        return None
    return found if isinstance(found, dict) else None


_OPEN: weakref.WeakSet[Journal] = weakref.WeakSet()


def _let_go_of_all() -> None:
    for journal in list(_OPEN):
        journal._let_go()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_let_go_of_all)
