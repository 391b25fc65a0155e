"""`ccpin merge`: atlases of parts of a region as the one atlas of the region."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import complete
from ccpin.cli.progress import busy

_EXAMPLES = """\
example: ccpin domain rpdr --lower-deg -150 -160 --upper-deg -120 -100 --save left.npz
         ccpin domain rpdr --lower-deg -120 -160 --upper-deg -90 -100 --save right.npz
         ccpin merge left.npz right.npz --out both.npz"""
_FACTS = ("certified_fraction", "empty_fraction", "singular_fraction", "undecided_fraction", "unreached_fraction")


def add_merge(commands: Any) -> None:
    """The command and its options."""
    what = "put saved atlases of the parts of a region together: of one branch, the regions got by halving one box"
    parser = commands.add_parser("merge", help=what, description=what, epilog=_EXAMPLES)
    files = parser.add_argument(
        "atlases", type=Path, nargs="+", metavar="FILE", help="what `ccpin domain --save` wrote"
    )
    complete(files, shtab.FILE)
    out = parser.add_argument(
        "--out", type=Path, required=True, metavar="FILE", help="write it there (.json, else npz)"
    )
    complete(out, shtab.FILE)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_merge)


def _merge(options: argparse.Namespace) -> int:
    from ccpin.domain import Atlas, merge

    with busy(options.json, "gluing the parts"):
        atlas = merge([Atlas.load(path) for path in options.atlases])
        atlas.save(options.out)
    facts: dict[str, Any] = {name: getattr(atlas, name) for name in (*_FACTS, "single_valued", "complete", "verdict")}
    if options.json:
        print(json.dumps(facts | {"boxes": len(atlas.boxes.kappa), "radius": atlas.radius}, indent=2))
    else:
        print(f"{atlas!r}\n{atlas.verdict}: {atlas.reason}\nwritten to {options.out}")
    return 0
