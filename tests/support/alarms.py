"""A signal after so long: what a run does when it is interrupted."""

import signal
from contextlib import contextmanager


@contextmanager
def alarm(seconds, handler=signal.default_int_handler):
    """The handler is called after so many seconds of the clock; by default it is Ctrl-C."""
    before = signal.signal(signal.SIGALRM, handler)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
