"""A command's parser, and the numbers that options take: what is wrong with one is said beside the option's name."""

from __future__ import annotations

import argparse
import contextlib
import re
import sys
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn, TypeVar

import shtab

from ccpin.cli.commands import COMMANDS

_WIDTH = 78  # of a help's lines, as argparse has them on a terminal of 80 columns
N = TypeVar("N", int, float)

EXIT_CODES = """\
exit codes: 0 done, and what was judged is proven; 1 it cannot be done, said in one sentence (with --json as an object);
            2 wrong usage; 3 undecided; 4 refuted; 130 interrupted
completion: ccpin --print-completion bash > ~/.local/share/bash-completion/completions/ccpin   (or zsh, tcsh)"""

PROVEN, UNDECIDED, REFUTED, INTERRUPTED = 0, 3, 4, 130  # exit codes; 130 as shells have it for Ctrl-C
_OF_VERDICTS = {"proven": PROVEN, "undecided": UNDECIDED, "refuted": REFUTED}


def judged(verdict: str, complete: bool = True) -> int:
    """The exit code of a command that judges: the verdict's, or 130 where the work was interrupted."""
    return _OF_VERDICTS[verdict] if complete else INTERRUPTED


_CHOSEN = re.compile(r"invalid choice: '?(?P<word>.*?)'? \(choose from (?P<known>.*)\)")
_OPTION = re.compile(r"--?[A-Za-z][^=]*")
EXAMPLE = re.compile(r"^(?:example:)? *(ccpin .+)", re.MULTILINE)


class CommandParser(argparse.ArgumentParser):
    """A parser whose help keeps its lines, and whose errors are one line that says what would be right."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**{"formatter_class": argparse.RawDescriptionHelpFormatter} | options)
        self._given: list[str] = []

    def parse_known_args(self, args: Sequence[str] | None = None, namespace: Any = None) -> Any:  # type: ignore[override]
        """The arguments, all of which must be known: a command answers for its own options."""
        self._given = list(sys.argv[1:] if args is None else args)
        if self._subparsers is not None and self._strange_option() is not None:
            self.error("an option before the command")
        parsed, left = super().parse_known_args(args, namespace)
        if left:
            self.error(f"there is no place for {' '.join(left)}")
        return parsed, left

    def error(self, message: str) -> NoReturn:
        """End with exit code 2: the option that is misspelt, the choice that was meant, or an example."""
        from ccpin.description.names import choices

        chosen = _CHOSEN.search(message)
        strange = self._strange_option()
        if strange is not None:
            told = f"there is no option {strange}; {choices(strange, self._shown_options())}"
        elif chosen is not None:
            known = [word.strip("'") for word in chosen["known"].split(", ")]
            told = f"{message[: chosen.start()]}'{chosen['word']}' is none; {choices(chosen['word'], known)}"
        else:
            example = EXAMPLE.search(self.epilog or "")
            told = f"{message}; example: {example[1]}" if example else f"{message}; {self.prog} --help tells all"
        self.exit(2, f"{self.prog}: error: {told}\n")

    def _strange_option(self) -> str | None:
        """The first word given that is spelt like an option and is none, nor the beginning of one."""
        for word in self._given:
            option = _OPTION.match(word)
            if word == "--" or (self._subparsers is not None and not word.startswith("-")):
                return None  # what follows is no option, or another parser's
            if option and not any(known.startswith(option[0]) for known in self._option_string_actions):
                return option[0]
        return None

    def _shown_options(self) -> list[str]:
        return [option for option in self._option_string_actions if option.startswith("--")]


def add_command(
    commands: Any, name: str, examples: str, run: Callable[[argparse.Namespace], int | None]
) -> argparse.ArgumentParser:
    """A command of `COMMANDS`: examples of it, and what runs it."""
    what = COMMANDS[name].what
    parser: argparse.ArgumentParser = commands.add_parser(
        name, help=what, description=textwrap.fill(what, _WIDTH), epilog=examples
    )
    parser.add_argument("--debug", action="store_true", help="show where in the program an error is raised")
    parser.set_defaults(run=run)
    return parser


def add_completion(parser: argparse.ArgumentParser, whole: bool) -> None:
    """``--print-completion``: a script for the shell; mechanisms complete to installed models and files.

    With `whole` the parser knows all commands, so that the script may be asked for; else it is in the help only.
    """
    models = ""
    if whole:
        from ccpin.description.finding import installed_models

        models = " ".join(installed_models())
    preamble = {
        "bash": f'_ccpin_mechanisms() {{ compgen -W "{models}" -- "$1"; compgen -f -- "$1"; }}',
        "zsh": f"_ccpin_mechanisms() {{ _alternative 'models:model:({models})' 'files:file:_files' }}",
    }
    shtab.add_argument_to(parser, preamble=preamble, help="print a completion script for the shell")


def complete(argument: argparse.Action, what: Mapping[str, Any]) -> None:
    """Say how an option's value completes: `shtab.FILE`, `shtab.DIRECTORY` or `MECHANISM`."""
    argument.complete = what  # type: ignore[attr-defined]  # the name shtab looks for


MECHANISM = {"bash": "_ccpin_mechanisms", "zsh": "_ccpin_mechanisms", "tcsh": "f"}


def positive(text: str) -> float:
    """A number above 0."""
    return _read(text, float, "a number above 0", lambda value: 0.0 < value < float("inf"))


def nonnegative(text: str) -> float:
    """A number, 0 or above."""
    return _read(text, float, "a number, 0 or more", lambda value: 0.0 <= value < float("inf"))


def count(text: str) -> int:
    """A whole number above 0."""
    return _read(text, int, "a whole number, 1 or more", lambda value: value >= 1)


def index(text: str) -> int:
    """A whole number, 0 or above."""
    return _read(text, int, "a whole number, 0 or more", lambda value: value >= 0)


def _read(text: str, kind: Callable[[str], N], what: str, allowed: Callable[[N], bool]) -> N:
    with contextlib.suppress(ValueError):
        value = kind(text)
        if allowed(value):
            return value
    raise argparse.ArgumentTypeError(f"must be {what}, not {text}")
