"""`ccpin new`: a URDF to start from."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete
from ccpin.description.drafts import DRAFTS, drafted
from ccpin.errors import InvalidInputError
from ccpin.mechanism.loading.loader import load

_EXAMPLES = """\
example: ccpin new five-bar --out five_bar.urdf
         ccpin new delta --lengths arm=0.3 forearm=0.7 --out delta.urdf
         ccpin check delta.urdf
         ccpin new stewart --lengths base=0.5 platform=0.3 height=0.6 --out hexapod.urdf
         ccpin new ankle"""


def add_new(commands: Any) -> None:
    """The command and its options."""
    kinds = "\n".join(
        f"{kind:<10}{draft.what}\n{'':<12}" + " ".join(f"{name}={value:g}" for name, value in draft.lengths.items())
        for kind, draft in DRAFTS.items()
    )
    parser = add_command(commands, "new", f"kinds and their usual lengths:\n{kinds}\n{_EXAMPLES}", _new)
    parser.add_argument("kind", choices=tuple(DRAFTS), help="what to start from")
    parser.add_argument("--lengths", nargs="+", metavar="NAME=M", default=[], help="lengths in metres (default: usual)")
    written = "the file to write (default: the kind's name, in this folder); none is written over"
    out = parser.add_argument("-o", "--out", type=Path, metavar="URDF", help=written)
    complete(out, shtab.FILE)
    parser.add_argument("--json", action="store_true", help="print JSON")


def _new(options: argparse.Namespace) -> int:
    out: Path = Path(f"{options.kind}.urdf") if options.out is None else options.out
    if out.suffix != ".urdf":
        raise InvalidInputError(f"--out names a .urdf, not '{out}' (ccpin convert writes other formats from it)")
    if out.exists():
        raise InvalidInputError(f"'{out}' is there already: name another file by --out")
    mechanism = load(drafted(options.kind, _lengths(options.lengths)))
    mechanism.save(out)
    if options.json:
        print(json.dumps({"written": str(out), "n": mechanism.n, "motors": list(mechanism.actuated)}))
    else:
        print(f"{out} written: n = {mechanism.n}, driven by {', '.join(mechanism.actuated)}")
        print(f"next: ccpin check {out}, ccpin studio {out}")
    return 0


def _lengths(written: list[str]) -> dict[str, float]:
    """The lengths by name.

    Raises:
        InvalidInputError: One is not written name=metres.
    """
    found: dict[str, float] = {}
    for word in written:
        name, _, value = word.partition("=")
        try:
            found[name] = float(value)
        except ValueError:
            raise InvalidInputError(f"--lengths takes name=metres, as in arm=0.3, not '{word}'") from None
    return found
