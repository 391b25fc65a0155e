"""`ccpin merge`: atlases, sheets, or covers of singular curves, of the parts of a region as one of the region."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.certificates import curve_facts, curves_in_words, document, sheet_facts, sheets_in_words
from ccpin.cli.command import add_command, complete, judged
from ccpin.cli.progress import busy

_EXAMPLES = """\
example: ccpin domain rpdr --lower-deg -150 -160 --upper-deg -120 -100 --save left.npz
         ccpin domain rpdr --lower-deg -120 -160 --upper-deg -90 -100 --save right.npz
         ccpin merge left.npz right.npz --out both.npz
         ccpin domain rpdr --curves --lower-deg 100 35 --upper-deg 120 75 --save a.json
         ccpin domain rpdr --curves --lower-deg 120 35 --upper-deg 140 75 --save b.json
         ccpin merge a.json b.json -o c.json"""
_FACTS = ("certified_fraction", "empty_fraction", "singular_fraction", "undecided_fraction", "unreached_fraction")


def add_merge(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "merge", _EXAMPLES, _merge)
    files = parser.add_argument("parts", type=Path, nargs="+", metavar="FILE", help="what `ccpin domain --save` wrote")
    complete(files, shtab.FILE)
    out = parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="FILE", help="write it there (.json, else npz)"
    )
    complete(out, shtab.FILE)
    parser.add_argument("--json", action="store_true", help="print JSON")


def _merge(options: argparse.Namespace) -> int:
    from ccpin.domain import SheetAtlas, SingularCover, merge

    with busy(options.json, "gluing the parts"):
        merged: Any = merge([document(path) for path in options.parts])
        merged.save(options.out)
    if isinstance(merged, SingularCover):
        facts = curve_facts(merged)
        words = f"{merged!r}\n{curves_in_words(facts)}"
    elif isinstance(merged, SheetAtlas):
        facts = sheet_facts(merged)
        words = f"{merged!r}\n{sheets_in_words(facts)}"
    else:
        facts = {name: getattr(merged, name) for name in (*_FACTS, "single_valued", "complete", "verdict")}
        facts |= {"boxes": len(merged.boxes.kappa), "radius": merged.radius}
        words = f"{merged!r}\n{merged.verdict}: {merged.reason}"
    print(json.dumps(facts, indent=2) if options.json else f"{words}\nwritten to {options.out}")
    return judged(facts.get("verdict", "proven"))  # sheets are counts, without a verdict
