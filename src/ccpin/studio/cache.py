"""What took long to prove, kept on disk by the fingerprint of what it was proved of."""

from __future__ import annotations

import hashlib
import json
import os
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ccpin.containers import plain_arrays
from ccpin.covering.sources import code_digest
from ccpin.domain.atlas.atlas import Atlas
from ccpin.domain.closures.packing import pack_reading
from ccpin.domain.closures.system import Reading
from ccpin.errors import CcpinError
from ccpin.files import write_atomically

T = TypeVar("T")
Arrays = dict[str, NDArray[np.generic]]
ROOM = 400e6
"""Bytes that all of it may take; beyond, what was not asked for longest goes."""
_POLL = 0.1  # s between looks at whether one still wants to wait


def fingerprint(reading: Reading, *arrays: NDArray[np.generic], kind: str) -> str:
    """A digest of every number the closures consist of, of what was asked about them, and of the code that answers."""
    header, own = pack_reading(reading)
    digest = hashlib.sha256(json.dumps([kind, code_digest().hex(), header], sort_keys=True).encode())
    for name, array in (*sorted(own.items()), *((str(k), array) for k, array in enumerate(arrays))):
        digest.update(f"{name}{array.dtype}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return f"{kind}-{digest.hexdigest()[:32]}"


def cache_folder() -> Path:
    """``$CCPIN_CACHE``, else ``ccpin`` in ``$XDG_CACHE_HOME`` or in ``~/.cache``."""
    stated = os.environ.get("CCPIN_CACHE")
    if stated:
        return Path(stated)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "ccpin"


class Cache:
    """Named arrays in a folder. What cannot be read is absent, and a folder that cannot be written keeps nothing."""

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = cache_folder() if folder is None else folder
        self._locks: defaultdict[str, threading.Lock] = defaultdict(threading.Lock)

    def load(self, key: str) -> Arrays | None:
        """What is kept under a key, or ``None``."""
        return self._read(key, plain_arrays)

    def save(self, key: str, arrays: Arrays) -> None:
        """Keep arrays under a key, where there is room."""
        self._write(key, lambda path: write_atomically(path, "wb", lambda file: np.savez_compressed(file, **arrays)))  # type: ignore[arg-type]

    def load_atlas(self, key: str) -> Atlas | None:
        """The atlas kept under a key, or ``None``."""
        return self._read(key, Atlas.load)

    def keep_atlas(self, key: str, atlas: Atlas) -> None:
        """Keep an atlas under a key, where there is room."""
        self._write(key, atlas.save)

    @contextmanager
    def alone(self, key: str, check: Callable[[], None]) -> Iterator[None]:
        """Be the only one in this process that works on a key; `check` is called while another does."""
        lock = self._locks[key]
        while not lock.acquire(timeout=_POLL):
            check()
        try:
            yield
        finally:
            lock.release()

    def _read(self, key: str, read: Callable[[Path], T]) -> T | None:
        path = self._path(key)
        try:
            found = read(path)
        except CcpinError:
            return None
        with suppress(OSError):
            os.utime(path)
        return found

    def _write(self, key: str, write: Callable[[Path], None]) -> None:
        with suppress(CcpinError, OSError):
            write(self._path(key))
            self._make_room()

    def _path(self, key: str) -> Path:
        return self.folder / f"{key}.npz"

    def _make_room(self) -> None:
        files = sorted(self.folder.glob("*.npz"), key=lambda path: path.stat().st_mtime, reverse=True)
        used = 0
        for k, path in enumerate(files):
            used += path.stat().st_size
            if used > ROOM and k:
                path.unlink(missing_ok=True)
