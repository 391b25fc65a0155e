"""`ccpin check`: whether a file's loops close, what moves, what drives it, and what is suspicious about it."""

from __future__ import annotations

import argparse
import json
from math import isclose, isfinite
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete, judged
from ccpin.cli.notes import gathered, listed
from ccpin.cli.options import add_mechanism, described, wishes
from ccpin.cli.progress import busy
from ccpin.description.model import MechanismDescription
from ccpin.dynamics.drives import Drive, Drives, moving_mass
from ccpin.dynamics.plausibility import reach
from ccpin.dynamics.soundness import Soundness, examine, told_gap
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism

_EXAMPLES = """\
example: ccpin check rpdr
         ccpin check stewart --json
         ccpin check four_bar --reference crank=0.5 --out four_bar.png"""
_VERDICTS = {
    "proven": "sound: nothing wrong was found",
    "undecided": "doubtful: look at what is marked so",
    "refuted": "wrong: what is marked so contradicts itself",
}

_GROUPS = 4
"""Efforts told of those that standing still takes."""

_THEN = {True: "assembled", False: "at the least open pose found"}


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
    facts = _facts(found, description)
    print(json.dumps(facts, indent=2) if options.json else _in_words(options.mechanism, facts, found))
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


def _facts(found: Soundness, description: MechanismDescription) -> dict[str, Any]:
    mechanism, drives = found.mechanism, found.drives
    facts: dict[str, Any] = {
        "verdict": found.verdict,
        "couplings": len(description.couplings),
        "closes": mechanism is not None,
        "reach": reach(description),
        "mass": sum(link.inertia.mass for link in description.links if link.inertia is not None),
        "stated": [gap._asdict() for gap in found.stated],
        "assembled": [gap._asdict() for gap in found.assembled],
    }
    if mechanism is not None and drives is not None:
        facts |= {"moving_mass": moving_mass(mechanism)}
        facts |= {"mobility": mechanism.n, "independent": list(mechanism.independent)}
        motors = [drive._asdict() | {"limits": [_finite(limit) for limit in drive.limits]} for drive in drives.each]
        facts |= {"motors": motors, "driven": drives.driven}
    return facts | {"findings": [finding._asdict() for finding in found.findings]}


def _finite(limit: float) -> float | None:
    return limit if isfinite(limit) else None


def _in_words(name: str, facts: dict[str, Any], found: Soundness) -> str:
    counted = {"loop": len(facts["stated"]), "coupling": facts["couplings"]}
    ties = ", ".join(f"{number} {word}{'s' if number > 1 else ''}" for word, number in counted.items() if number)
    sizes = f"joints up to {facts['reach']:.3g} m apart, {facts['mass']:.4g} kg in all"
    if (moving := facts.get("moving_mass")) is not None:
        sizes += f", {'all' if isclose(moving, facts['mass']) else f'{moving:.4g} kg'} of it moving"
    lines = [f"{name}: {'closes' if facts['closes'] else 'was not closed'} ({ties}; {sizes})", *_gaps(found)]
    if found.mechanism is not None and found.drives is not None:
        lines += _moves(found.mechanism, found.drives)
    for weight in ("wrong", "doubtful", "note"):
        said = [finding.sentence for finding in found.findings if finding.weight == weight]
        lines += [f"{weight}: {sentence}" for sentence in gathered(said)]
    return "\n".join([*lines, _VERDICTS[found.verdict]])


def _moves(mechanism: Mechanism, drives: Drives) -> list[str]:
    """What moves, and what of it each motor drives: those that drive their own joint alone in one line."""
    if not mechanism.n:
        return ["nothing moves"]
    sizes = [(name, _ways(mechanism, name)) for name in mechanism.independent]
    names = [f"{name} ({size} of them)" if size > 1 else name for name, size in sizes]
    own = [drive for drive in drives.each if drive.coordinates == (drive.joint,)]
    lines = [f"moves in {'one way' if mechanism.n == 1 else f'{mechanism.n} ways'}: {', '.join(names)}"]
    if own:
        lines.append(f"  motors that drive the joint they are on: {', '.join(map(_motor, own))}")
    lines += [
        f"  motor {_motor(drive)} drives {', '.join(drive.coordinates) or 'nothing'}"
        for drive in drives.each
        if drive not in own
    ]
    return [*lines, f"motors drive {drives.driven} of {mechanism.n}", *_standing(drives)]


def _standing(drives: Drives) -> list[str]:
    """What standing still takes beside the limits that are stated: nearest to theirs first, alike ones at once."""
    alike: dict[tuple[str, str], list[Drive]] = {}
    for drive in drives.each:
        if drive.standing is not None and drive.limited:
            alike.setdefault(drive.told(), []).append(drive)
    if not alike:
        return []
    groups = sorted(alike.items(), key=lambda group: -group[1][0].share)
    takes = [f"{effort} of {listed([drive.motor for drive in same])} ({limit})" for (effort, limit), same in groups]
    if len(takes) > _GROUPS:
        rest = sum(len(same) for _, same in groups[_GROUPS:])
        takes = [*takes[:_GROUPS], f"of {rest} more a smaller share of the limit"]
    way = ", in one of many ways," if drives.shared else ""
    return [f"standing still as assembled takes{way} {'; '.join(takes)}"]


def _ways(mechanism: Mechanism, coordinate: str) -> int:
    joint, component = mechanism.tree.split(coordinate)
    return 1 if component else mechanism.tree.joint(joint).kind.nv


def _motor(motor: Drive) -> str:
    return motor.motor if motor.motor == motor.joint else f"{motor.motor} of {motor.joint}"


def _gaps(found: Soundness) -> list[str]:
    """A line for the loops that are as far open as each other."""
    after = {gap.name: f", {told_gap(gap)} {_THEN[found.mechanism is not None]}" for gap in found.assembled}
    alike: dict[str, list[str]] = {}
    for gap in found.stated:
        alike.setdefault(f"{told_gap(gap)} as stated{after.get(gap.name, '')}", []).append(gap.name)
    return [f"  loop{'s' if len(names) > 1 else ''} {listed(names)}: {said}" for said, names in alike.items()]
