"""`ccpin verify`: a certificate checked by an auditor that shares no code with what produced it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.certificates import document
from ccpin.cli.command import PROVEN, REFUTED, UNDECIDED, add_command, complete, count, judged
from ccpin.cli.progress import busy, progress_bar
from ccpin.errors import InvalidInputError

_EXAMPLES = """\
example: ccpin domain rpdr --centre-deg -108 -72 --atlas --depth 4 --save rpdr.json
         ccpin verify rpdr.json --model rpdr --sample 50
         ccpin domain rpdr --curves --lower-deg 100 35 --upper-deg 140 75 --save curves.json
         ccpin verify curves.json --sample 4
         ccpin export rpdr --what mass --lower-deg -92 -92 --upper-deg -88 -88 --save mass.npz --out firmware
         ccpin verify mass.npz --model rpdr"""
PROGRAM = "ccpin-program-1"
_NOT_CHECKED = "that it is a mechanism's: what is recorded of that has the digest, or has not"
_BAR = "{l_bar}{bar}| {postfix} [{elapsed}<{remaining}]"


def add_verify(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "verify", _EXAMPLES, _verify)
    file = parser.add_argument("certificate", type=Path, metavar="FILE", help="what --save wrote")
    complete(file, shtab.FILE)
    parser.add_argument("--model", metavar="MODEL", help="also: the closures are those of this model's file today")
    parser.add_argument("--sample", type=count, metavar="N", help="N claims of each kind at random (default: all)")
    parser.add_argument("--workers", type=count, default=1, metavar="N", help="share the work among N processes")
    parser.add_argument("--json", action="store_true", help="print JSON")


def _verify(options: argparse.Namespace) -> int:
    from ccpin.auditing import verify
    from ccpin.containers import format_of

    if format_of(options.certificate) == PROGRAM:
        return _replayed(options)
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


def _replayed(options: argparse.Namespace) -> int:
    """A program's certificate, proved once more by the kernel that proved it first."""
    import ccpin
    from ccpin.proof.facts import NotProvedError
    from ccpin.validated import ProgramCertificate

    if options.sample is not None:
        raise InvalidInputError("--sample is not for a program's certificate, which is replayed whole")
    certificate = ProgramCertificate.load(options.certificate)
    try:
        with busy(options.json, "proving it again"):
            certificate = certificate.replay()
        reason = certificate.reason
    except NotProvedError as error:
        reason = str(error)
    same = None if options.model is None else certificate.is_about(ccpin.load(options.model))
    if options.json:
        facts: dict[str, Any] = {"verdict": certificate.verdict, "reason": reason, "model": same}
        facts |= {"program": certificate.program.digest, "statement": certificate.statement()}
        print(json.dumps(facts | {"not_checked": _NOT_CHECKED}, indent=2))
    else:
        print(f"{certificate.verdict}: {reason}", certificate.statement(), f"not checked: {_NOT_CHECKED}", sep="\n")
        if same is not None:
            print(f"closures of {options.model}: {'the same, operation by operation' if same else 'NOT the same'}")
    return REFUTED if same is False else judged(certificate.verdict)


def _is_about(path: Path, model: str) -> bool:
    import ccpin

    return bool(document(path).is_about(ccpin.load(model)))
