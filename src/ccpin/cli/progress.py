"""Progress on the terminal's stderr while a command computes; none where nobody watches."""

from __future__ import annotations

import contextlib
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

_PATIENCE = 1.0
"""Seconds after which somebody who waits wants to know what for."""


@contextlib.contextmanager
def busy(quiet: bool, what: str) -> Iterator[None]:
    """What is done and for how long, once it takes more than a second; nothing where no terminal shows it."""
    if quiet or not sys.stderr.isatty():
        yield
        return
    done = threading.Event()
    teller = threading.Thread(target=_tell, args=(what, done), daemon=True)
    teller.start()
    try:
        yield
    finally:
        done.set()
        teller.join()


def _tell(what: str, done: threading.Event) -> None:
    if done.wait(_PATIENCE):
        return
    from tqdm import tqdm

    with tqdm(desc=what, bar_format="{desc} … {elapsed}", leave=False) as bar:
        while not done.wait(0.5):
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
