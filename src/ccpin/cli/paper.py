"""`ccpin paper`: the whole paper recomputed, as one page."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ccpin.cli.command import PROVEN, REFUTED, add_command
from ccpin.cli.progress import progress_bar
from ccpin.files import writable_target

if TYPE_CHECKING:
    from ccpin.paper.item import Item

_BAR = "{l_bar}{bar}| {n_fmt} of {total_fmt} items, {postfix}"


def add_paper(commands: Any) -> None:
    """The command and its options."""
    example = "example: ccpin paper -o paper.html"
    parser = add_command(commands, "paper", example, _paper)
    parser.add_argument("-o", "--out", type=Path, metavar="HTML", help="write the page there")
    parser.add_argument("--json", action="store_true", help="print machine-readable JSON: items, differences, errata")


def _paper(options: argparse.Namespace) -> int:
    from ccpin import paper
    from ccpin.paper.reproduction import COUNT

    if options.out is not None:
        writable_target(options.out)  # told before minutes are spent
    done: list[Item] = []

    def tell(item: Item) -> tuple[float, str]:
        done.append(item)
        return float(len(done)), item.number

    with progress_bar(options.json, float(COUNT), _BAR, tell) as progress:
        found = paper.reproduce(progress)
    if options.out is not None:
        paper.write(found, options.out)
    print(json.dumps(found.as_json(), indent=2, ensure_ascii=False) if options.json else _in_words(found, options.out))
    return PROVEN if found.agrees else REFUTED


def _in_words(found: Any, out: Path | None) -> str:
    lines = [f"{'item':<28}{'difference':>12} {'':8}{'bound':>10}"]
    for item in found.items:
        verdict = "" if item.agrees else "  NOT within"
        lines.append(f"{item.number:<28}{item.difference:12.1e} {item.unit:8}{item.bound:10.0e}{verdict}")
    lines.append(f"{sum(item.agrees for item in found.items)} of {len(found.items)} items agree; {found.seconds:.0f} s")
    if out is not None:
        lines.append(f"wrote {out}")
    return "\n".join(lines)
