"""Who does long work, and when it is to end: worker threads and processes, Ctrl-C, time."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from types import FrameType
from typing import NamedTuple, Protocol, TypeVar

from ccpin.arrays import whole
from ccpin.errors import InvalidInputError

FEW = 4
"""So many threads of NumPy's own work, on arrays of thousands, go on side by side; more wait for each other."""
_AGAIN = 0.02  # s
_ACTIVE: ContextVar[tuple[threading.Event, ...]] = ContextVar("active", default=())
_THREADS: ContextVar[int] = ContextVar("threads", default=1)
Item = TypeVar("Item")
Result = TypeVar("Result")


class Stopped(Exception):  # noqa: N818 - not an error: what is proved is kept
    """Raised between chunks after an interrupt, and where a budget is spent."""


class Flag(Protocol):
    """What tells that work is to end."""

    def is_set(self) -> bool:
        """Whether it is."""


class Until(NamedTuple):
    """A flag that is also set from a time on (`time.monotonic`)."""

    flag: Flag
    time: float

    def is_set(self) -> bool:
        """Whether it is, or the time is over."""
        return self.flag.is_set() or time.monotonic() >= self.time


@contextmanager
def stoppable(seconds: float | None = None) -> Iterator[threading.Event]:
    """Make the first Ctrl-C, or the end of a time, set an event, so that no bookkeeping is cut in half.

    Ctrl-C within another one's stretch of work sets that one's event too, and what is begun after that ends at once.
    The second Ctrl-C acts as ever.
    """
    flag, around = threading.Event(), _ACTIVE.get()
    if any(outer.is_set() for outer in around):
        flag.set()
    token = _ACTIVE.set((*around, flag))
    try:
        with _timed(flag, seconds), _interruptible((*around, flag)):
            yield flag
    finally:
        _ACTIVE.reset(token)


def ended() -> bool:
    """Whether the stretch of work that this is in is to end (`stoppable`)."""
    around = _ACTIVE.get()
    return bool(around) and around[-1].is_set()


def check() -> None:
    """Raise `Stopped` where it is."""
    if ended():
        raise Stopped


@contextmanager
def _timed(flag: threading.Event, seconds: float | None) -> Iterator[None]:
    timer = None if seconds is None else threading.Timer(min(seconds, threading.TIMEOUT_MAX), flag.set)
    if timer is not None:
        timer.daemon = True
        timer.start()
    try:
        yield
    finally:
        if timer is not None:
            timer.cancel()


@contextmanager
def _interruptible(flags: tuple[threading.Event, ...]) -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def stop(number: int, frame: FrameType | None) -> None:
        del number, frame
        for flag in flags:
            flag.set()
        signal.signal(signal.SIGINT, signal.default_int_handler if len(flags) > 1 else before)

    signal.signal(signal.SIGINT, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def insistent() -> Iterator[None]:
    """Make every Ctrl-C be heard.

    Python drops a `KeyboardInterrupt` that falls into a destructor or a weak reference's callback (a library's, say),
    and tells `sys.unraisablehook`: there it is asked for again, a moment later.
    """
    before = sys.unraisablehook

    def again(dropped: sys.UnraisableHookArgs) -> None:
        if not issubclass(dropped.exc_type, KeyboardInterrupt):
            before(dropped)
            return
        timer = threading.Timer(_AGAIN, signal.raise_signal, (signal.SIGINT,))  # now it would fall into this hook
        timer.daemon = True
        timer.start()

    sys.unraisablehook = again
    try:
        yield
    finally:
        sys.unraisablehook = before


def processes(workers: int) -> int:
    """How many processes are started where so many are asked for: no more than twice those that can run at a time.

    Raises:
        InvalidInputError: It is not a whole number of at least one.
    """
    return min(whole(workers, "workers"), 2 * (os.cpu_count() or 1))


@contextmanager
def executor_for(executor: Executor | None, workers: int | None, threads: float = 0) -> Iterator[Executor | None]:
    """The executor given, or workers where more than one was asked for; ``None``: this thread does all.

    Workers are processes, or up to so many `threads`, for work that lets go of the interpreter's lock: these begin at
    once, and nothing is copied from one process to another. What this thread does `side_by_side` has as many threads.

    Raises:
        InvalidInputError: Both were given, or `workers` is not a whole number of at least one.
    """
    if executor is not None and workers is not None:
        raise InvalidInputError("give an executor or a number of workers, not both")
    workers = None if workers is None else processes(workers)
    if workers is None or workers == 1:
        yield executor
        return
    pool = ThreadPoolExecutor(workers) if workers <= threads else ProcessPoolExecutor(workers, initializer=_serve)
    token = _THREADS.set(workers)
    try:
        yield pool
    finally:
        _THREADS.reset(token)
        pool.shutdown(wait=False, cancel_futures=True)


def side_by_side(task: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """What a task makes of each item, in order: on as many threads as workers were asked for (`executor_for`).

    What it raises is raised, and what has not begun by then is left.
    """
    count = min(_THREADS.get(), len(items))
    if count < 2:
        return [task(item) for item in items]
    pool = ThreadPoolExecutor(count)
    try:
        futures = [pool.submit(copy_context().run, _alone, task, item) for item in items]
        return [future.result() for future in futures]
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _alone(task: Callable[[Item], Result], item: Item) -> Result:
    """A task on this thread and no other, in a context of its own."""
    _THREADS.set(1)
    return task(item)


def _serve() -> None:
    """In a worker: Ctrl-C is the main process's business, and none outlives it, were it killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
