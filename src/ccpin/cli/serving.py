"""A page served from the terminal until Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
import threading
from typing import Protocol


class _Serving(Protocol):
    @property
    def url(self) -> str: ...

    def wait(self) -> bool: ...


def serve(page: _Serving, as_json: bool) -> None:
    """Say where a page is and how it ends, and wait for that.

    A shell starts what a script puts in the background with Ctrl-C ignored; a server has no other end, so it listens.
    """
    on_main = threading.current_thread() is threading.main_thread()
    if on_main and signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    ends = f"Ctrl-C ends it, or an interrupt to process {os.getpid()}: kill -INT {os.getpid()}"
    print(json.dumps({"url": page.url}) if as_json else f"serving {page.url}  ({ends})", flush=True)
    page.wait()
