"""Progress on stderr while a command computes: on a terminal, and elsewhere a line at most."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

_PATIENCE = 1.0
"""Seconds after which somebody who waits wants to know what for."""
_LOOK = 0.5
"""Seconds between two looks."""


def announce(quiet: bool, what: str) -> None:
    """A line at the start of long work for whoever sees no bar: where no terminal shows one, unless quiet."""
    if not (quiet or sys.stderr.isatty()):
        print(f"ccpin: {what}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def busy(quiet: bool, what: str, share: Callable[[], float] | None = None) -> Iterator[None]:
    """What is done and for how long, once it takes more than a second; nothing where no terminal shows it.

    Args:
        quiet: Whether nothing is to be shown whatever the terminal.
        what: What is done, in a word.
        share: How much of it is done, from 0 to 1, where that can be looked up; asked by another thread.
    """
    if quiet or not sys.stderr.isatty():
        yield
        return
    done = threading.Event()
    teller = threading.Thread(target=_tell, args=(what, share, done), daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


def _tell(what: str, share: Callable[[], float] | None, done: threading.Event) -> None:
    if done.wait(_PATIENCE):
        return
    from tqdm import tqdm

    form = "{desc} … {elapsed}" if share is None else "{desc} {percentage:3.0f} %|{bar}| {elapsed}"
    with tqdm(desc=what, total=1.0, bar_format=form, leave=False) as bar:
        while not done.wait(_LOOK):
            if share is not None:
                bar.n = min(max(share(), 0.0), 1.0)
            bar.refresh()


@contextlib.contextmanager
def progress_bar(
    quiet: bool, total: float, form: str, tell: Callable[[Any], tuple[float, str]]
) -> Iterator[Callable[[Any], None] | None]:
    """A function to be called with each progress report, or ``None`` where no terminal shows it.

    Args:
        quiet: Whether nothing is to be shown whatever the terminal.
        total: What the bar's end stands for.
        form: tqdm's format of the bar.
        tell: How far it is, and words beside it, of a report.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from tqdm import tqdm

    with tqdm(total=total, bar_format=form) as bar:

        def show(report: Any) -> None:
            bar.n, words = tell(report)
            bar.set_postfix_str(words)

        yield show
