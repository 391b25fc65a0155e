"""``ccpin`` and ``python -m ccpin``: the command line, quiet where Ctrl-C meets it on its way in or out."""

import signal
import sys


def run() -> int:
    """The command line; returns the exit code. What its own errors are told by is `ccpin.cli.main`."""
    try:
        from ccpin.cli import main

        code = main()
    except KeyboardInterrupt:  # before there was a command, or after
        return 130
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # all is done and written: Python's own end needs no traceback
    return code


if __name__ == "__main__":
    sys.exit(run())
