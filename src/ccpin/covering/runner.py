"""Running the tasks of atlases: in this process or an executor's, each chunk kept on disk, stoppable."""

from __future__ import annotations

import hashlib
import json
import math
import time
from collections.abc import Callable
from concurrent.futures import CancelledError, Executor, Future
from concurrent.futures import TimeoutError as FutureTimeoutError
from copy import copy
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import listener
from ccpin.covering.cells import CellStatus, CellTree
from ccpin.covering.sources import code_digest
from ccpin.errors import InvalidInputError
from ccpin.files import writable_folder, write_atomically
from ccpin.proof.digests import digest
from ccpin.proof.equations import Problem
from ccpin.work import Flag, Stopped, Until

Arrays = tuple[NDArray[np.generic], ...]
Task = Callable[[Problem, Arrays], Arrays]

_POLL = 0.2  # s
_CHUNK, _SUFFIX = "ccpin-chunk-2", ".chunk"
_STALLED = 5.0  # s


class Progress(NamedTuple):
    """How far an atlas is: certified boxes, cells waiting, and the certified fraction of the region."""

    boxes: int
    waiting: int
    certified: float


class Work(NamedTuple):
    """Who does the work of an atlas, where it is kept and who hears of it: the arguments of `certify` so named."""

    workers: int | None = None
    executor: Executor | None = None
    checkpoint: str | Path | None = None
    progress: Callable[[Progress], None] | None = None


Report = Callable[[CellTree, int, int], None]
"""Told a tree, how many boxes there are and how many cells wait."""


def reporter(progress: Callable[[Progress], None] | None) -> Report:
    """What tells a caller how far an atlas is."""
    told = listener(progress)

    def report(tree: CellTree, boxes: int, waiting: int) -> None:
        if progress is not None:  # shares are not worked out for nobody
            told(Progress(boxes, waiting, tree.share(tree.leaves(CellStatus.CERTIFIED))))

    return report


class ChunkStore:
    """Results on disk by what they were computed from and by which code; files appear whole or not at all.

    A search reads thousands of small ones, so a file is three things and no archive: the checksum of the other two, a
    line that says the key, the dtypes and the shapes, and the numbers.

    Raises:
        InvalidInputError: The folder is none, or cannot be made or written to.
    """

    def __init__(self, folder: str | Path | None, problem: Problem) -> None:
        self.folder = None if folder is None else writable_folder(folder, "checkpoint")
        if self.folder is not None:
            self._origin = code_digest() + bytes.fromhex(digest(problem))

    def key(self, task: Task, arrays: Arrays) -> str:
        """The name of a result: a digest of the code, the problem, the task and every bit of the arrays.

        Empty without a folder.
        """
        if self.folder is None:
            return ""
        found = hashlib.sha256(self._origin + task.__name__.encode())
        for array in arrays:
            found.update(f"{array.dtype.str}{array.shape}".encode())
            found.update(np.ascontiguousarray(array).data)
        return found.hexdigest()

    def load(self, key: str) -> Arrays | None:
        """A stored result, or ``None`` where there is none (or a file that is damaged, or of another name)."""
        if self.folder is None:
            return None
        try:
            whole = (self.folder / f"{key}{_SUFFIX}").read_bytes()
            checksum, head, numbers = whole.split(b"\n", 2)
            if checksum != _checksum(head, numbers):
                return None
            header = json.loads(head)
            if {*header} != {"format", "key", "arrays"} or (header["format"], header["key"]) != (_CHUNK, key):
                return None
            found, start = list[NDArray[Any]](), 0
            for name, shape in header["arrays"]:
                dtype = np.dtype(name)
                array = np.frombuffer(numbers, dtype, math.prod(shape), start).reshape(shape)
                found.append(array.copy())
                start += array.nbytes
            return tuple(found)
        except (OSError, ValueError, TypeError):
            return None

    def save(self, key: str, result: Arrays) -> None:
        """Store a result."""
        if self.folder is not None:
            arrays = [np.asarray(array) for array in result]
            outlines = [[array.dtype.str, array.shape] for array in arrays]
            head = json.dumps({"format": _CHUNK, "key": key, "arrays": outlines}).encode()
            numbers = b"".join(array.tobytes() for array in arrays)
            whole = b"\n".join([_checksum(head, numbers), head, numbers])
            write_atomically(self.folder / f"{key}{_SUFFIX}", "wb", lambda file: file.write(whole))


def _checksum(head: bytes, numbers: bytes) -> bytes:
    """SHA-256 of what a file holds below it."""
    return hashlib.sha256(head + b"\n" + numbers).hexdigest().encode()


class Runner:
    """Maps a task over chunks, in order, with the same chunks whoever computes them.

    An executor is anything with ``submit(function, *arguments) -> Future`` (``None``: this process); `checkpoint` is a
    folder for results, and the flag is looked at between chunks. What an executor lost is computed here, and so is what
    it does not give within a while; one that gives nothing meanwhile is asked no more.
    """

    def __init__(self, problem: Problem, executor: Executor | None, checkpoint: str | Path | None, flag: Flag) -> None:
        self.problem, self.flag = problem, flag
        self.store = ChunkStore(checkpoint, problem)
        self._executor = executor

    def within(self, seconds: float | None) -> Runner:
        """One that stops after a time too, if any is given."""
        sooner = copy(self)
        if seconds is not None:
            sooner.flag = Until(self.flag, time.monotonic() + seconds)
        return sooner

    def map(self, task: Task, chunks: list[Arrays]) -> list[Arrays]:
        """The task's results for every chunk, in order.

        Raises:
            Stopped: An interrupt was asked for; what was computed is in the store.
        """
        keys = [self.store.key(task, chunk) for chunk in chunks]
        results = [self.store.load(key) for key in keys]
        missing = [k for k, result in enumerate(results) if result is None]
        futures = self._submit(task, {k: chunks[k] for k in missing})
        for k in missing:
            self.check()
            result = self._result(k, futures) if k in futures else None
            if result is None:
                result = task(self.problem, chunks[k])
            self.store.save(keys[k], result)
            results[k] = result
        return [result for result in results if result is not None]

    def once(self, task: Task, arrays: Arrays) -> Arrays:
        """The result of a task of this process; it is kept unless an interrupt has cut it short."""
        key = self.store.key(task, arrays)
        result = self.store.load(key)
        if result is None:
            result = task(self.problem, arrays)
            if not self.flag.is_set():
                self.store.save(key, result)
        return result

    def check(self) -> None:
        """Raise `Stopped` where an interrupt was asked for."""
        if self.flag.is_set():
            raise Stopped

    def _submit(self, task: Task, chunks: dict[int, Arrays]) -> dict[int, Future[Arrays]]:
        """Submit what the executor takes; what a broken one refuses is computed here.

        Raises:
            InvalidInputError: It takes no work at all: it is closed, say.
        """
        futures: dict[int, Future[Arrays]] = {}
        if self._executor is None:
            return futures
        try:
            for k, chunk in chunks.items():
                futures[k] = self._executor.submit(task, self.problem, chunk)
        except RuntimeError:
            self._executor = None
        except Exception as error:
            raise InvalidInputError(
                f"the executor takes no work ({type(error).__name__}: {error}): is it open?"
            ) from error
        return futures

    def _result(self, k: int, futures: dict[int, Future[Arrays]]) -> Arrays | None:
        """A future's result; ``None`` where its worker was lost (or the task failed: computing it here will tell)."""
        future, due = futures[k], time.monotonic() + _STALLED
        done = sum(other.done() for other in futures.values())
        while True:
            self.check()
            try:
                return future.result(timeout=_POLL if self._executor is not None else 0.0)
            except FutureTimeoutError:
                if future.done() or self._executor is None:
                    return None
                if time.monotonic() >= due:
                    if sum(other.done() for other in futures.values()) == done:
                        self._executor = None
                    return None
            except (Exception, CancelledError):
                return None
