"""`ccpin verify`: a certificate checked by an auditor that shares no code with what produced it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.certificates import document
from ccpin.cli.command import PROVEN, REFUTED, UNDECIDED, add_command, complete, count
from ccpin.cli.progress import progress_bar

_EXAMPLES = """\
example: ccpin domain rpdr --centre-deg -108 -72 --atlas --depth 4 --save rpdr.json
         ccpin verify rpdr.json --model rpdr --sample 50
         ccpin domain rpdr --curves --lower-deg 100 35 --upper-deg 140 75 --save curves.json
         ccpin verify curves.json --sample 4"""
_BAR = "{l_bar}{bar}| {postfix} [{elapsed}<{remaining}]"


def add_verify(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "verify", _EXAMPLES, _verify)
    file = parser.add_argument("certificate", type=Path, metavar="FILE", help="what `ccpin domain --save` wrote")
    complete(file, shtab.FILE)
    parser.add_argument("--model", metavar="MODEL", help="also: the closures are those of this model's file today")
    parser.add_argument("--sample", type=count, metavar="N", help="N claims of each kind at random (default: all)")
    parser.add_argument("--workers", type=count, default=1, metavar="N", help="share the work among N processes")
    parser.add_argument("--json", action="store_true", help="print JSON")


def _verify(options: argparse.Namespace) -> int:
    from ccpin.auditing import verify

    same = None if options.model is None else _is_about(options.certificate, options.model)
    with progress_bar(options.json, 100.0, _BAR, lambda p: (100.0 * p.done / p.of, f"{p.done} of {p.of}")) as progress:
        audit = verify(options.certificate, sample=options.sample, workers=options.workers, progress=progress)
    if options.json:
        claims = [claim._asdict() for claim in audit.claims]
        facts: dict[str, Any] = {"holds": audit.holds, "refuted": audit.refuted, "claim": audit.claim}
        facts |= {"whole": audit.whole, "fingerprint": audit.fingerprint, "claims": claims}
        print(json.dumps(facts | {"model": same, "not_checked": audit.not_checked}, indent=2))
    else:
        print(audit)
        if same is not None:
            print(f"closures of {options.model}: {'the same, bit for bit' if same else 'NOT the same'}")
    if audit.refuted or same is False:
        return REFUTED
    return PROVEN if audit.holds else UNDECIDED


def _is_about(path: Path, model: str) -> bool:
    import ccpin

    return bool(document(path).is_about(ccpin.load(model)))
