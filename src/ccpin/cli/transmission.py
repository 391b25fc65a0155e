"""`ccpin transmission`: from motors to joints through the closed chain: ratios, rotor inertia, limits, shortcuts."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
import shtab

from ccpin.arrays import Array, one_each
from ccpin.cli.command import add_command, complete, positive
from ccpin.cli.measured_pairs import add_identify, identify
from ccpin.cli.options import add_mechanism, load
from ccpin.cli.progress import busy
from ccpin.errors import InvalidInputError
from ccpin.transmission.limits_search import FORMS
from ccpin.transmission.motor_limits import LimitsCertificate, certify_limits
from ccpin.transmission.polytopes import Polytope
from ccpin.transmission.posture import Posture
from ccpin.transmission.ros2_package import export_ros2
from ccpin.transmission.shortcuts import SHORTCUTS, compare
from ccpin.transmission.surveys import Survey, survey
from ccpin.transmission.swing import Swing
from ccpin.transmission.transmission import Transmission

_CELLS = 1024  # into which a region is cut to prove limits over it
_EXAMPLES = """\
example: ccpin transmission four_bar
         ccpin transmission four_bar --rotor 2e-4 --shortcuts 1 4 --out limits.png
         ccpin transmission rpdr --joints joint3 joint4 --effort 10 --speed 20
         ccpin transmission four_bar --effort 10 --speed 20 --within 0.2
         ccpin transmission four_bar --ros2 four_bar_linkage --maintainer 'Ada <ada@lab.org>'"""


def add_transmission(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "transmission", _EXAMPLES, _transmission)
    add_mechanism(parser)
    add_sides(parser)
    within = "prove limits of efforts and speeds over joints so far from the reference, one number or one each"
    parser.add_argument("--within", nargs="+", type=positive, metavar="RAD", help=within)
    swing = "frequencies of swings over a third of the range along which shortcuts are compared"
    parser.add_argument("--shortcuts", nargs="+", type=positive, metavar="HZ", help=swing)
    add_identify(parser)
    written = (
        "draw limits of effort and speed as a picture (.png, .pdf, .svg), or write a page with sliders (.html); "
        "with --identify the mechanism found (.urdf, .sdf, .xml)"
    )
    complete(parser.add_argument("--out", type=Path, metavar="FILE", help=written), shtab.FILE)
    package = "write a ROS 2 package into this folder: a transmission plugin of ros2_control, with a test"
    complete(parser.add_argument("--ros2", type=Path, metavar="DIR", help=package), shtab.DIRECTORY)
    parser.add_argument("--ros2-name", metavar="NAME", help="of that package (default: of the mechanism)")
    parser.add_argument(
        "--maintainer", default="", metavar="'NAME <ADDRESS>'", help="of that package; it has to have one"
    )
    parser.add_argument(
        "--license", default="Proprietary", metavar="SPDX", help="of that package (default Proprietary)"
    )


def _transmission(options: argparse.Namespace) -> int:
    mechanism = load(options)
    transmission = Transmission(mechanism, options.joints, options.motors)
    if options.identify is not None:
        identify(transmission, options)
        return 0
    if options.rotor is not None:
        transmission = with_rotors(transmission, options.rotor)
    effort, speed = each_of(options.effort), each_of(options.speed)
    with busy(options.json, "postures over the range"):
        found = survey(transmission)
        facts = _facts(found, effort, speed)
    if options.shortcuts:
        with busy(options.json, "shortcuts along swings"):
            facts["shortcuts"] = list(_compared(found, options.shortcuts))
    proved = list[LimitsCertificate]()
    if (within := each_of(options.within)) is not None:
        with busy(options.json, "limits proved"):
            far = one_each(within, "--within", len(transmission.joints))
            facts["proved"], proved = _proved(transmission, far, effort, speed)
            facts["within"] = far.tolist()
    if options.out is not None:
        with busy(options.json, "drawing"):
            _draw(found, options.out, list(_in_words(facts)), effort, speed, proved)
        facts["written"] = str(options.out)
    if options.ros2 is not None:
        with busy(options.json, "recording"):
            own = {"maintainer": options.maintainer, "license": options.license, "name": options.ros2_name}
            facts["ros2"] = list(map(str, export_ros2(transmission, options.ros2, **own)))
    print(json.dumps(facts, indent=2) if options.json else "\n".join(_in_words(facts)))
    return 0


def _proved(
    transmission: Transmission, far: Array, effort: Array | None, speed: Array | None
) -> tuple[list[dict[str, Any]], list[LimitsCertificate]]:
    """Boxes and ellipsoids over a region about the reference, as numbers and as certificates."""
    home, told, found = transmission.reference.q_joint, list[dict[str, Any]](), list[LimitsCertificate]()
    given: tuple[tuple[Literal["effort", "speed"], Array | None, Array | None], ...]
    given = ("effort", effort, None), ("speed", None, speed)
    for of, most, fastest in given:
        for form in FORMS:
            row: dict[str, Any] = {"of": of, "form": form}
            try:
                made = certify_limits(
                    transmission, (home - far, home + far), of, form=form, effort=most, speed=fastest, max_cells=_CELLS
                )
                found.append(made)
                row |= {"verdict": made.verdict, "reason": made.reason, "size": made.size.tolist()}
            except InvalidInputError as error:
                row |= {"verdict": "undecided", "reason": str(error)}
            told.append(row)
    return told, found


def _draw(
    found: Survey,
    out: Path,
    words: Sequence[str],
    effort: Array | None,
    speed: Array | None,
    proved: Sequence[LimitsCertificate],
) -> None:
    """A page or a picture, by the file's ending."""
    from ccpin import plotting
    from ccpin.files import write_text
    from ccpin.transmission.limits_page import transmission_page
    from ccpin.transmission.pictures import plot_limits

    if out.suffix != ".html":
        plotting.save(plot_limits(found.transmission, effort=effort, speed=speed, proved=proved), out)
        return
    page = transmission_page(found, words, effort=effort, speed=speed, proved=proved)
    write_text(out, page)


def add_sides(parser: Any) -> None:
    """The options that say which joints and motors there are, and what the motors are like."""
    parser.add_argument("--joints", nargs="+", metavar="JOINT", help="the serial robot's (default: where evident)")
    parser.add_argument("--motors", nargs="+", metavar="JOINT", help="the joints driven (default: the file's motors)")
    behind = "behind the gear, one number or one each"
    parser.add_argument("--effort", nargs="+", type=positive, metavar="NM", help=f"limits of the motors {behind}")
    parser.add_argument("--speed", nargs="+", type=positive, metavar="RAD/S", help=f"limits of the motors {behind}")
    parser.add_argument("--rotor", nargs="+", type=positive, metavar="KGM2", help=f"rotor inertia {behind}")


def each_of(given: Sequence[float] | None) -> Array | None:
    """One number for all, or one each."""
    return None if given is None else np.array(given[0] if len(given) == 1 else given)


def with_rotors(transmission: Transmission, rotors: Sequence[float]) -> Transmission:
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
    if "within" in facts:
        yield f"  at all postures within ±({' × '.join(f'{x:.4g}' for x in facts['within'])}) of the reference:"
    for row in facts.get("proved", ()):
        yield f"  {row['verdict']}: {row['reason']}"
    for row in facts.get("shortcuts", ()):
        part = f"{100 * row['torque_error']:.1f} % of the effort is missing"
        yield f"  {row['shortcut']:<18} at {row['frequency']:g} Hz: {part}"
    if "written" in facts:
        yield f"wrote {facts['written']}"
    if "ros2" in facts:
        yield f"wrote {len(facts['ros2'])} files of a ROS 2 package, of which nothing is proved"
