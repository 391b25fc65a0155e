"""`ccpin convert`: a mechanism written in another format, or in its own with the pose and joints settled."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete
from ccpin.cli.notes import gathered
from ccpin.cli.options import add_mechanism, load
from ccpin.cli.progress import busy
from ccpin.description.formats import FORMATS


def add_convert(commands: Any) -> None:
    """The command and its options."""
    example = "example: ccpin convert rpdr --out rpdr.xml"
    parser = add_command(commands, "convert", example, _convert)
    add_mechanism(parser)
    written = "the file to write; .urdf, .sdf, .xml or .yaml"
    complete(parser.add_argument("--out", required=True, metavar="FILE", help=written), shtab.FILE)
    parser.add_argument("--to", choices=tuple(FORMATS), help="the format, where the suffix does not tell it")


def _convert(options: argparse.Namespace) -> int:
    mechanism = load(options)
    with busy(options.json, "writing"):
        notes = mechanism.save(options.out, options.to)
    if options.to == "toolbox" or (options.to is None and Path(options.out).suffix in FORMATS["toolbox"].suffixes):
        notes = ("its robot.urdf is written beside it", *notes)
    if options.json:
        print(json.dumps({"written": options.out, "n": mechanism.n, "notes": notes}))
    else:
        print(f"{options.out} written: {mechanism.name}, n = {mechanism.n}, closed at its reference")
        print(*(f"note: {note}" for note in gathered(notes)), sep="\n", end="\n" if notes else "")
    return 0
