"""Progress on the terminal's stderr while a command computes; none where nobody watches."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import Any


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
