"""`ccpin transmission`: from motors to joints through the closed chain: ratios, rotor inertia, limits, shortcuts."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shtab

from ccpin.arrays import Array
from ccpin.cli.command import add_command, complete, positive
from ccpin.cli.options import add_mechanism, load
from ccpin.cli.progress import busy
from ccpin.errors import InvalidInputError
from ccpin.transmission.polytopes import Polytope
from ccpin.transmission.posture import Posture
from ccpin.transmission.shortcuts import SHORTCUTS, compare
from ccpin.transmission.surveys import Survey, survey
from ccpin.transmission.swing import Swing
from ccpin.transmission.transmission import Transmission

_EXAMPLES = """\
example: ccpin transmission four_bar
         ccpin transmission four_bar --rotor 2e-4 --shortcuts 1 4 --out limits.png
         ccpin transmission rpdr --joints joint3 joint4 --effort 10 --speed 20"""


def add_transmission(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "transmission", _EXAMPLES, _transmission)
    add_mechanism(parser)
    parser.add_argument("--joints", nargs="+", metavar="JOINT", help="the serial robot's (default: where evident)")
    parser.add_argument("--motors", nargs="+", metavar="JOINT", help="the joints driven (default: the file's motors)")
    behind = "behind the gear, one number or one each"
    parser.add_argument("--effort", nargs="+", type=positive, metavar="NM", help=f"limits of the motors {behind}")
    parser.add_argument("--speed", nargs="+", type=positive, metavar="RAD/S", help=f"limits of the motors {behind}")
    parser.add_argument("--rotor", nargs="+", type=positive, metavar="KGM2", help=f"rotor inertia {behind}")
    swing = "frequencies of swings over a third of the range along which shortcuts are compared"
    parser.add_argument("--shortcuts", nargs="+", type=positive, metavar="HZ", help=swing)
    written = "draw limits of effort and speed as a picture (.png, .pdf, .svg), or write a page with sliders (.html)"
    complete(parser.add_argument("--out", type=Path, metavar="FILE", help=written), shtab.FILE)


def _transmission(options: argparse.Namespace) -> int:
    mechanism = load(options)
    transmission = Transmission(mechanism, options.joints, options.motors)
    if options.rotor is not None:
        transmission = _with_rotors(transmission, options.rotor)
    effort, speed = _each(options.effort), _each(options.speed)
    with busy(options.json, "postures over the range"):
        found = survey(transmission)
        facts = _facts(found, effort, speed)
    if options.shortcuts:
        with busy(options.json, "shortcuts along swings"):
            facts["shortcuts"] = list(_compared(found, options.shortcuts))
    if options.out is not None:
        with busy(options.json, "drawing"):
            _draw(found, options.out, list(_in_words(facts)), effort, speed)
        facts["written"] = str(options.out)
    print(json.dumps(facts, indent=2) if options.json else "\n".join(_in_words(facts)))
    return 0


def _draw(found: Survey, out: Path, words: Sequence[str], effort: Array | None, speed: Array | None) -> None:
    """A page or a picture, by the file's ending."""
    from ccpin import plotting
    from ccpin.files import writable_target, write_atomically
    from ccpin.transmission.limits_page import transmission_page
    from ccpin.transmission.pictures import plot_limits

    if out.suffix != ".html":
        plotting.save(plot_limits(found.transmission, effort=effort, speed=speed), out)
        return
    page = transmission_page(found, words, effort=effort, speed=speed)
    write_atomically(writable_target(out), "w", lambda file: file.write(page))


def _each(given: Sequence[float] | None) -> Array | None:
    """One number for all, or one each."""
    return None if given is None else np.array(given[0] if len(given) == 1 else given)


def _with_rotors(transmission: Transmission, rotors: Sequence[float]) -> Transmission:
    """The same with rotor inertias stated of the motors' joints."""
    from ccpin.description.changes.overrides import with_stated
    from ccpin.mechanism.loading.loader import load as load_mechanism

    each = list(rotors) * (transmission.n if len(rotors) == 1 else 1)
    if len(each) != transmission.n:
        raise InvalidInputError(f"--rotor takes one number, or {transmission.n}")
    stated = {name: {"armature": x} for name, x in zip(transmission.motors, each, strict=True)}
    whole = load_mechanism(with_stated(transmission.joint_model.mechanism.settled(), stated, None))
    return Transmission(whole, transmission.joints, transmission.motors)


def _facts(found: Survey, effort: Array | None, speed: Array | None) -> dict[str, Any]:
    """What is told, JSON-ready."""
    transmission = found.transmission
    home = transmission.reference
    facts: dict[str, Any] = {
        "name": transmission.joint_model.mechanism.name,
        "joints": list(transmission.joints),
        "motors": list(transmission.motors),
        "units": [list(side.units) for side in (transmission.joint_side, transmission.motor_side)],
        "range": [found.lower.tolist(), found.upper.tolist()],
        "postures": len(found.postures),
        "missed": found.missed,
        "q_joint": home.q_joint.tolist(),
        "q_motor": home.q_motor.tolist(),
        "jacobian": home.jacobian.tolist(),
        "axis_ratios": _over(home.axis_ratios, found.axis_ratios),
        "rotor_inertia": _over(np.diag(home.rotor_inertia), found.rotor_inertias.diagonal(axis1=1, axis2=2)),
        "linkage_inertia": np.diag(home.linkage_inertia).tolist(),
        "margins": [list(home.margins), np.min([posture.margins for posture in found.postures], axis=0).tolist()],
    }
    for name, limits in (("effort", effort), ("speed", speed)):
        try:
            facts[name] = _limits(found, name, limits)
        except InvalidInputError as error:
            facts[name] = str(error)
    return facts


def _limits(found: Survey, name: str, limits: Array | None) -> dict[str, Any]:
    """Polytopes at the reference and over the range: what each joint has alone, and the largest boxes."""

    def polytope(posture: Posture) -> Polytope:
        return posture.torque_polytope(effort=limits) if name == "effort" else posture.speed_polytope(speed=limits)

    here, all_of_them = polytope(found.transmission.reference), [polytope(posture) for posture in found.postures]
    around, box = here.bounds, here.largest_box()
    shape = np.maximum(box, 1e-300)  # all that is in every one of them: how large a part of the first one's box
    common = min(float((each.largest_box(shape) / shape).min()) for each in (here, *all_of_them))
    return {
        "alone": _over(around[1], np.array([each.bounds[1] for each in all_of_them])),
        "share": here.volume / float(np.prod(around[1] - around[0])),
        "box": box.tolist(),
        "box_sampled": (common * box).tolist(),
    }


def _over(here: Array, everywhere: Array) -> dict[str, list[float]]:
    """At the reference, and least and largest over the range."""
    return {
        "reference": here.tolist(),
        "least": everywhere.min(axis=0).tolist(),
        "most": everywhere.max(axis=0).tolist(),
    }


def _compared(found: Survey, frequencies: Sequence[float]) -> Iterator[dict[str, Any]]:
    """A swing over a sixth of what is reached either way, about its middle, by each shortcut."""
    transmission = found.transmission
    reached = np.array([posture.q_joint for posture in found.postures])
    low, high = reached.min(axis=0), reached.max(axis=0)
    for frequency in frequencies:
        swing = Swing(transmission, (high - low) / 6.0, frequency, 0.5 * (low + high))
        for shortcut in SHORTCUTS:
            yield {"frequency": frequency} | compare(transmission, swing, shortcut, samples=81).as_json()


def _in_words(facts: dict[str, Any]) -> Iterator[str]:
    yield f"{facts['name']}: {', '.join(facts['motors'])} → {', '.join(facts['joints'])}"
    missed = f", {facts['missed']} not reached" if facts["missed"] else ""
    yield f"at the reference, and from … to over {facts['postures']} postures of the joints' range{missed}"
    for row, motor in zip(facts["jacobian"], facts["motors"], strict=True):
        terms = " ".join(f"{x:+.4g} {joint}" for x, joint in zip(row, facts["joints"], strict=True))
        yield f"  rate of {motor:<16} {terms}"
    rows = [("motors' rate per rate of", facts["axis_ratios"], "")]
    rows.append(("rotor inertia felt at", facts["rotor_inertia"], "kg m²"))
    if isinstance(facts["effort"], dict):
        rows.append(("largest effort alone of", facts["effort"]["alone"], "N m"))
    if isinstance(facts["speed"], dict):
        rows.append(("largest speed alone of", facts["speed"]["alone"], "rad/s"))
    for what, over, unit in rows:
        for k, joint in enumerate(facts["joints"]):
            here, least, most = (over[key][k] for key in ("reference", "least", "most"))
            yield f"  {what} {joint:<12} {here:.4g}  ({least:.4g} … {most:.4g}) {unit}".rstrip()
    for side, here, least in zip(("joints'", "motors'"), *facts["margins"], strict=True):
        yield f"  1/κ(ψ) in the {side} coordinates {here:.3g}  (least {least:.3g})"
    for name in ("effort", "speed"):
        told = facts[name]
        if isinstance(told, str):
            yield f"  {told}"
            continue
        box, common = (" × ".join(f"{x:.4g}" for x in told[key]) for key in ("box", "box_sampled"))
        share = f"{100 * told['share']:.0f} % of the box around it"
        yield f"  {name}: {share}; largest box inside ±({box}), in all sampled ±({common})"
    for row in facts.get("shortcuts", ()):
        part = f"{100 * row['torque_error']:.1f} % of the effort is missing"
        yield f"  {row['shortcut']:<18} at {row['frequency']:g} Hz: {part}"
    if "written" in facts:
        yield f"wrote {facts['written']}"
