"""``python -m benchmarks [PART …]``: one table of ratios, and JSON, a figure and a page where asked."""

from __future__ import annotations

import argparse
import json
import sys
from importlib import import_module
from pathlib import Path

from benchmarks.machine import machine
from benchmarks.measured import Measured, Options
from benchmarks.table import table
from benchmarks.targets import checked

PARTS = (
    "models",
    "families",
    "batches",
    "lanes",
    "memory",
    "simulated",
    "accuracy",
    "atlas",
    "certificates",
    "enclosures",
    "load",
    "walks",
)
PEOPLES_MODELS = ("cassie_like", "digit_like")


def measured(parts: tuple[str, ...], options: Options) -> list[Measured]:
    """Every figure of some parts; after Ctrl-C those there are."""
    figures = list[Measured]()
    try:
        for part in parts:
            print(f"measuring {part} …", file=sys.stderr, flush=True)
            figures.extend(import_module(f"benchmarks.parts.{part}").measure(options))
    except KeyboardInterrupt:
        print("interrupted: what follows is what was measured so far", file=sys.stderr)
    return figures


def main(arguments: list[str] | None = None) -> None:
    """Measure (or read what was measured), print, and write what is asked for."""
    asked = _parser().parse_args(arguments)
    if asked.read:
        found = json.loads(asked.read.read_text(encoding="utf-8"))
        where, figures = found["machine"], [Measured(**each) for each in found["figures"]]
    else:
        where, figures = machine(), measured(tuple(asked.parts) or PARTS, _options(asked))
    print(table(figures))
    if asked.check:
        print("\n" + checked(figures))
    if asked.json:
        whole = {"machine": where, "figures": [each._asdict() for each in figures]}
        asked.json.write_text(json.dumps(whole, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    if asked.figure:
        from benchmarks.figure import draw

        draw(figures, asked.figure)
    if asked.page:
        from benchmarks.page import page

        asked.page.write_text(page(figures, where), encoding="utf-8")


def _options(asked: argparse.Namespace) -> Options:
    """What the command line says, over the defaults."""
    options = Options.smallest() if asked.smallest else Options()
    given = {
        name: getattr(asked, name) for name in ("models", "sizes", "peer_joints", "numpy_joints", "rows", "rounds")
    }
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in given.items() if value}
    options = options._replace(**given, deep=options.deep and not asked.quick)
    others = tuple(str(asked.others / name) for name in PEOPLES_MODELS) if asked.others else ()
    return options._replace(models=options.models + others)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], metavar="PART", help=f"of {', '.join(PARTS)}; all")
    parser.add_argument("--models", nargs="+", help="installed models' names, or files")
    parser.add_argument("--others", type=Path, metavar="FOLDER", help=f"where {' and '.join(PEOPLES_MODELS)} are")
    parser.add_argument("--sizes", nargs="+", type=int, help="numbers of four-bars in the families")
    parser.add_argument("--peer-joints", type=int, help="largest member of a family that peers are asked for")
    parser.add_argument("--numpy-joints", type=int, help="largest one that the NumPy reference is asked for")
    parser.add_argument("--rows", type=int, help="of a batch")
    parser.add_argument("--rounds", type=int, help="how often everything is timed in turn")
    parser.add_argument("--quick", action="store_true", help="without what takes minutes")
    parser.add_argument("--smallest", action="store_true", help="the least that shows that every part works")
    parser.add_argument("--check", action="store_true", help="also the targets: met or missed")
    parser.add_argument("--read", type=Path, metavar="FILE", help="figures from a JSON file, measuring nothing")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--figure", type=Path, metavar="FILE", help="a picture of ratios and exponents")
    parser.add_argument("--page", type=Path, metavar="FILE", help="a page of Markdown")
    return parser


if __name__ == "__main__":
    main()
