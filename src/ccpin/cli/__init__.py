"""The command line: arguments to package calls, results to the terminal; no mathematics."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence

from ccpin.cli.check import add_check
from ccpin.cli.command import EXIT_CODES, CommandParser, add_completion
from ccpin.cli.convert import add_convert
from ccpin.cli.doctor import add_doctor
from ccpin.cli.domain import add_domain
from ccpin.cli.examples import add_examples
from ccpin.cli.info import add_info, add_modes
from ccpin.cli.merge import add_merge
from ccpin.cli.new import add_new
from ccpin.cli.paper import add_paper
from ccpin.cli.report import add_report
from ccpin.cli.simulate import add_simulate
from ccpin.cli.studio import add_studio
from ccpin.cli.verify import add_verify
from ccpin.cli.view import add_view
from ccpin.errors import CcpinError
from ccpin.work import insistent


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code.

    0 done or proven, 1 an error, 2 wrong usage, 3 undecided, 4 refuted, 130 interrupted.
    """
    options = _parser().parse_args(arguments)
    try:
        with insistent():
            code = int(options.run(options) or 0)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader of a pipe has gone
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  (flushed at exit)
        return 1
    except KeyboardInterrupt:
        print("ccpin: interrupted", file=sys.stderr)
        return 130
    except Exception as error:
        if options.debug:
            raise
        _tell(error, options.json)
        return 1


def _tell(error: Exception, as_json: bool) -> None:
    """An error as one line, or as an object; one that no user should ever provoke says how to see where it is from."""
    kind, message = type(error).__name__, " ".join(str(error).split())
    if not isinstance(error, CcpinError):
        message = f"{message or 'no message'} (this error is not foreseen: --debug shows where it is raised)"
    if as_json:
        print(json.dumps({"error": kind, "message": message}))
    else:
        print(f"ccpin: {kind}: {message}", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = CommandParser(prog="ccpin", description="Reduced models of closed-chain mechanisms.", epilog=EXIT_CODES)
    version = sys.modules["ccpin"].__version__  # type: ignore[attr-defined]  # of the package this one is a part of
    parser.add_argument("--version", action="version", version=f"ccpin {version}")
    add_completion(parser)
    commands = parser.add_subparsers(dest="command", required=True, metavar="command", parser_class=CommandParser)
    for add in (
        add_new,
        add_info,
        add_check,
        add_modes,
        add_simulate,
        add_domain,
        add_merge,
        add_verify,
        add_view,
        add_studio,
        add_convert,
        add_report,
        add_paper,
        add_doctor,
        add_examples,
    ):
        add(commands)
    return parser
