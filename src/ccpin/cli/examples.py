"""`ccpin examples`: what there is to run, a line each."""

from __future__ import annotations

import argparse
import ast
import json
from pathlib import Path
from typing import Any

from ccpin.cli.command import EXAMPLE, add_command

_SOURCES = Path(__file__).resolve().parents[3]
"""The checkout, where this is one."""


def add_examples(commands: Any) -> None:
    """The command and its options; it lists the examples of all commands that stand before it."""
    parser = add_command(commands, "examples", "example: ccpin examples\n         ccpin examples --json", _examples)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(commands=commands)


def _examples(options: argparse.Namespace) -> int:
    shown = [one for parser in options.commands.choices.values() for one in of_command(parser)]
    found = {"commands": shown, "scripts": scripts(_SOURCES / "scripts"), "pages": pages(_SOURCES / "docs" / "howto")}
    if options.json:
        print(json.dumps(found, indent=2))
        return 0
    for part, listed in found.items():
        wide = max((len(one["run"]) for one in listed if len(one["run"]) <= 60), default=0)
        print(
            *([f"{part}:", *(f"  {one['run']:<{wide}}  {one['what']}" for one in listed)] if listed else []), sep="\n"
        )
    if not found["scripts"]:
        print("more, as scripts and how-to pages, is in ccpin's sources")
    return 0


def of_command(parser: argparse.ArgumentParser) -> list[dict[str, str]]:
    """The examples that a command's help shows which begin with itself, each with what the command does."""
    name = parser.prog
    return [
        {"run": line, "what": " ".join((parser.description or "").partition(" (exit")[0].split())}
        for line in EXAMPLE.findall(parser.epilog or "")
        if line.startswith(f"{name} ")
    ][:1]


def scripts(folder: Path) -> list[dict[str, str]]:
    """The programs of a folder with the first line of what they say of themselves."""
    found = []
    for path in sorted(folder.glob("*.py")):
        text = path.read_text(encoding="utf-8")
        said = ast.get_docstring(ast.parse(text))
        if said and "__main__" in text:
            found.append({"run": f"python {path.parent.name}/{path.name}", "what": said.splitlines()[0]})
    return found


def pages(folder: Path) -> list[dict[str, str]]:
    """The how-to pages of a folder with their titles."""
    titles = {path: path.read_text(encoding="utf-8").splitlines()[0] for path in sorted(folder.glob("*.md"))}
    return [{"run": f"docs/howto/{path.name}", "what": title.lstrip("# ")} for path, title in titles.items()]
