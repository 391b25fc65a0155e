"""The command line: arguments to package calls, results to the terminal; no mathematics."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Collection, Sequence
from importlib import import_module

from ccpin.cli.command import EXIT_CODES, CommandParser, add_completion
from ccpin.cli.commands import COMMANDS


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code.

    0 done or proven, 1 an error, 2 wrong usage, 3 undecided, 4 refuted, 130 interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    options = _parser(_called(words)).parse_args(words)
    from ccpin.work import insistent  # with NumPy, for which help does not wait

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
    from ccpin.errors import CcpinError

    kind, message = type(error).__name__, " ".join(str(error).split())
    if not isinstance(error, CcpinError):
        message = f"{message or 'no message'} (this error is not foreseen: --debug shows where it is raised)"
    if as_json:
        print(json.dumps({"error": kind, "message": message}))
    else:
        print(f"ccpin: {kind}: {message}", file=sys.stderr)


def _called(words: Sequence[str]) -> Collection[str]:
    """The commands that a command line needs to know more of than what they do."""
    name = next((word for word in words if not word.startswith("-")), None)
    if name == "examples" or any(word.startswith("--p") for word in words[:1]):  # of all of them; a completion script
        return COMMANDS
    return [name] if name in COMMANDS else []


def _parser(called: Collection[str] = tuple(COMMANDS)) -> argparse.ArgumentParser:
    """The command line; of commands that are not called it knows what they do, and loads nothing."""
    parser = CommandParser(prog="ccpin", description="Reduced models of closed-chain mechanisms.", epilog=EXIT_CODES)
    version = sys.modules["ccpin"].__version__  # type: ignore[attr-defined]  # of the package this one is a part of
    parser.add_argument("--version", action="version", version=f"ccpin {version}")
    add_completion(parser, len(called) == len(COMMANDS))
    commands = parser.add_subparsers(dest="command", required=True, metavar="command", parser_class=CommandParser)
    for name, command in COMMANDS.items():
        if name in called:
            getattr(import_module(f"ccpin.cli.{command.module}"), f"add_{name}")(commands)
        else:
            commands.add_parser(name, help=command.what)
    return parser
