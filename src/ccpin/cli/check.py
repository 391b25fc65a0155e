"""`ccpin check`: whether a file's loops close, what moves, what holds it, and what is suspicious about it."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np
import shtab

from ccpin.cli.command import add_command, complete, judged
from ccpin.cli.notes import gathered
from ccpin.cli.options import add_mechanism, described, wishes
from ccpin.cli.progress import busy
from ccpin.dynamics.soundness import Soundness, examine
from ccpin.errors import InvalidInputError

_EXAMPLES = """\
example: ccpin check rpdr
         ccpin check stewart --json
         ccpin check four_bar --reference crank=0.5 --out four_bar.png"""
_VERDICTS = {
    "proven": "sound: nothing wrong was found",
    "undecided": "doubtful: look at what is marked so",
    "refuted": "wrong: what is marked so contradicts itself",
}


def add_check(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "check", _EXAMPLES, _check)
    add_mechanism(parser)
    drawn = "draw it: .png (closed, and as the file states it), .html (to turn about)"
    complete(parser.add_argument("--out", type=Path, metavar="FILE", help=drawn), shtab.FILE)


def _check(options: argparse.Namespace) -> int:
    if options.out is not None and options.out.suffix.lower() not in (".png", ".html"):
        raise InvalidInputError(f"--out draws a .png or an .html, not '{options.out.name}'")
    with busy(options.json, f"checking {options.mechanism}"):
        description = described(options)
        found = examine(description, **wishes(options))
    if options.out is not None and found.mechanism is not None:
        with busy(options.json, "drawing"):
            _draw(found.mechanism, options.out)
    facts = _facts(found, len(description.couplings))
    print(json.dumps(facts, indent=2) if options.json else _in_words(options.mechanism, facts))
    if options.out is not None and not options.json:
        print(f"wrote {options.out}" if found.mechanism is not None else f"{options.out} not written: nothing closed")
    return judged(found.verdict)


def _draw(mechanism: Any, out: Path) -> None:
    from ccpin import plotting, visualization
    from ccpin.report.description_facts import as_stated, cut_open

    if out.suffix.lower() == ".html":
        visualization.snapshot(mechanism, None, out)
    else:
        plotting.save(as_stated(mechanism) or cut_open(mechanism), out)


def _facts(found: Soundness, couplings: int) -> dict[str, Any]:
    mechanism = found.mechanism
    facts: dict[str, Any] = {
        "verdict": found.verdict,
        "couplings": couplings,
        "closes": mechanism is not None,
        "stated": [gap._asdict() for gap in found.stated],
        "assembled": [gap._asdict() for gap in found.assembled],
    }
    if mechanism is not None:
        facts |= {"mobility": mechanism.n, "independent": list(mechanism.independent)}
        facts |= {"motors": [motor._asdict() for motor in found.held], "driven": found.driven}
    return facts | {"findings": [finding._asdict() for finding in found.findings]}


def _in_words(name: str, facts: dict[str, Any]) -> str:
    counted = {"loop": len(facts["stated"]), "coupling": facts["couplings"]}
    ties = ", ".join(f"{number} {word}{'s' if number > 1 else ''}" for word, number in counted.items() if number)
    lines = [f"{name}: {'closes' if facts['closes'] else 'was not closed'} ({ties})", *_gaps(facts)]
    if facts["closes"]:
        ways = "one way" if facts["mobility"] == 1 else f"{facts['mobility']} ways"
        lines.append(f"moves in {ways}: {', '.join(facts['independent'])}")
        lines += [
            f"  motor {motor['motor']} of {motor['joint']} holds {', '.join(motor['coordinates']) or 'nothing'}"
            for motor in facts["motors"]
        ]
        lines.append(f"motors hold {facts['driven']} of {facts['mobility']}")
    for weight in ("wrong", "doubtful", "told"):
        said = [finding["sentence"] for finding in facts["findings"] if finding["weight"] == weight]
        lines += [f"{'note' if weight == 'told' else weight}: {sentence}" for sentence in gathered(said)]
    return "\n".join([*lines, _VERDICTS[facts["verdict"]]])


def _gaps(facts: dict[str, Any]) -> list[str]:
    after = {gap["name"]: gap for gap in facts["assembled"]}
    then = "assembled" if facts["closes"] else "at the least open pose found"
    return [
        f"  loop {gap['name']}: {_gap(gap)} as stated"
        + (f", {_gap(after[gap['name']])} {then}" if gap["name"] in after else "")
        for gap in facts["stated"]
    ]


def _gap(gap: dict[str, Any]) -> str:
    """In mm and degrees; what is below a nanometre or a millionth of a degree is 0."""
    length, angle = 1e3 * gap["length"], np.degrees(gap["angle"])
    return f"{length if length > 1e-6 else 0:.4g} mm {angle if angle > 1e-6 else 0:.4g}°"
