"""`ccpin report`: one self-contained page about a mechanism."""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from pathlib import Path
from typing import Any

from ccpin.cli.command import add_command
from ccpin.cli.options import add_mechanism, add_vector, load, vector
from ccpin.cli.progress import announce, progress_bar

_BAR = "{l_bar}{bar}| {postfix}"


def add_report(commands: Any) -> None:
    """The command and its options."""
    example = "example: ccpin report delta -o delta.html"
    parser = add_command(commands, "report", example, _report)
    add_mechanism(parser)
    parser.add_argument("-o", "--out", type=Path, metavar="HTML", required=True, help="the page to write")
    add_vector(parser, "start", "where the experiment starts at rest (default: the reference)")
    add_vector(parser, "goal", "its set point (default: one beside the start)")
    parser.add_argument("--duration", type=float, metavar="S", help="of the experiment (default 1)")
    parser.add_argument("--depth", type=int, default=8, metavar="N", help="halvings of the atlas's edges (default 8)")


def _report(options: argparse.Namespace) -> int:
    from ccpin import report
    from ccpin.report.page import PARTS

    mechanism = load(options)
    start, goal = vector(options, "start", mechanism), vector(options, "goal", mechanism)
    settings = report.ReportSettings(start=start, goal=goal, duration=options.duration, depth=options.depth)
    done: list[str] = []

    def tell(part: str) -> tuple[float, str]:
        done.append(part)
        return len(done) - 1.0, part

    announce(options.json, f"writing {options.out} takes about ten seconds")
    command = shlex.join(["ccpin", *sys.argv[1:]]) if Path(sys.argv[0]).stem in ("ccpin", "__main__") else None
    with progress_bar(options.json, float(len(PARTS)), _BAR, tell) as progress:
        written = report.write(mechanism, options.out, settings, command=command, progress=progress)
    if options.json:
        print(json.dumps(written._asdict() | {"path": str(written.path)}, indent=2))
    else:
        missing = [f"  without {part}: {reason}" for part, reason in written.failed.items()]
        print("\n".join([f"wrote {written.path} in {sum(written.seconds.values()):.1f} s", *missing]))
    return 0
