"""Slow work in threads of its own: one job a name, a newer one in place of an older, cancelled when nobody waits."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from ccpin.errors import CcpinError

Message = dict[str, Any]
QUIET = 0.1
"""Seconds between two words on progress."""


class Cancelled(Exception):  # noqa: N818 - not an error: nobody waits any more
    """Raised inside a job that is no longer wanted."""


class Job:
    """One piece of work under way; what it calls now and then to tell how far it is, and to hear whether to go on."""

    def __init__(self, name: str, tell: Callable[[Message], None], lock: threading.RLock) -> None:
        self.name = name
        self._tell, self._lock = tell, lock
        self._unwanted = threading.Event()
        self._told = -math.inf

    def progress(self, share: float | None, words: str) -> None:
        """Tell the share done (``None``: not known) in words.

        Raises:
            Cancelled: The work is not wanted any more.
        """
        self.check()
        if time.monotonic() - self._told < QUIET:
            return
        self._told = time.monotonic()
        self._tell({"kind": "progress", "job": self.name, "share": share, "words": words})

    def hand_over(self, part: Callable[[], Message]) -> None:
        """Do what a part of the result asks for and tell it, before the rest is there; errors as for `check`."""
        with self._lock:
            self.check()
            self._tell(part())

    def check(self) -> None:
        """Go on, or raise `Cancelled`."""
        if self._unwanted.is_set():
            raise Cancelled(self.name)

    @property
    def wanted(self) -> bool:
        """Whether anybody waits for it."""
        return not self._unwanted.is_set()

    def cancel(self) -> None:
        """Want it no more."""
        self._unwanted.set()


class Jobs:
    """The work of one session.

    Args:
        send: Where progress, results and errors go; called from the jobs' threads.
        lock: Held while a result is handed over.
    """

    def __init__(self, send: Callable[[Message], None], lock: threading.RLock) -> None:
        self._send, self._lock = send, lock
        self._running: dict[str, tuple[Job, threading.Thread]] = {}

    def start(self, name: str, work: Callable[[Job], Callable[[], Message]]) -> None:
        """Begin work in a thread. It returns what to do with its result, which is done only if it is still wanted."""
        self.cancel(name)
        job = Job(name, self._send, self._lock)
        thread = threading.Thread(target=self._run, args=(job, work), name=f"ccpin-{name}", daemon=True)
        self._running[name] = job, thread
        thread.start()

    def cancel(self, name: str) -> bool:
        """Want the work of a name no more; whether there was any."""
        with self._lock:
            job, _ = self._running.pop(name, (None, None))
        if job is not None:
            job.cancel()
        return job is not None

    def close(self) -> None:
        """Want none of it any more."""
        for name in tuple(self._running):
            self.cancel(name)

    def wait(self, timeout: float) -> None:
        """Until all that is under way has ended."""
        for _, thread in tuple(self._running.values()):
            thread.join(timeout)

    def _run(self, job: Job, work: Callable[[Job], Callable[[], Message]]) -> None:
        try:
            done = work(job)
            answer = None
        except Cancelled:
            return
        except CcpinError as error:
            answer = {"kind": "error", "job": job.name, "words": str(error)}
        except Exception as error:  # a defect, told in the page rather than lost in a thread
            answer = {"kind": "error", "job": job.name, "words": f"{type(error).__name__}: {error}"}
        with self._lock:
            if not job.wanted:
                return
            self._running.pop(job.name, None)
            self._send(done() if answer is None else answer)
