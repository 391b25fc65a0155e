"""`ccpin identify`: the constants of a mechanism from its logs, as a table, a description and a page."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete, positive
from ccpin.cli.options import add_mechanism, load
from ccpin.cli.progress import busy
from ccpin.description.formats import format_written, write_description
from ccpin.description.names import choices
from ccpin.dynamics.changed_constants import with_constants
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.files import write_text
from ccpin.identification.estimates.consistency import consistent
from ccpin.identification.estimates.estimate import Estimate
from ccpin.identification.estimates.estimation import identify
from ccpin.identification.estimates.explained_efforts import told_of_motion
from ccpin.identification.estimates.stribeck_friction import StribeckFriction
from ccpin.identification.logs.log import Log
from ccpin.identification.logs.smoothing import smoothed

_EXAMPLES = """\
example: ccpin identify rpdr --logs run1.csv run2.csv --out learnt.urdf --report learnt.html
         ccpin identify rpdr --logs run.mcap --kinds inertia friction
         ccpin identify rpdr --logs run.csv --stribeck --report learnt.html
         ccpin identify rpdr --logs a.csv --columns q_joint1=q1 q_joint2=q2 u_joint1=i1 u_joint2=i2 --units q=deg u=0.35
         ccpin identify rpdr --logs run.csv --motors 10% --prior inertia=5%
         ccpin identify rpdr --logs run.csv loaded.csv --motors --added loaded.csv mass:link3=0.5 mx:link3=0.1"""


_SIZES = ("found", "stated", "measured", "coulomb")
_LATE = 4.0  # standard deviations of a delay that are told
_CHAINED = 0.2  # of an autocorrelation that is told: noise of encoders brings about less where that of efforts shows


def add_identify(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "identify", _EXAMPLES, _identify)
    add_mechanism(parser)
    files = ".csv, .parquet, .npz, .mat, .mcap, .db3, .bag or rosbag2 folders"
    complete(parser.add_argument("--logs", nargs="+", type=Path, required=True, metavar="LOG", help=files), shtab.FILE)
    ours = "which of a file's columns q_JOINT, v_JOINT, u_JOINT are; others are then left out"
    parser.add_argument("--columns", nargs="+", metavar="OURS=THEIRS", help=ours)
    units = "in which unit columns, or all of q, v, u, are: deg, rev, mm, rpm, deg/s, N mm …, or a factor"
    parser.add_argument("--units", nargs="+", metavar="NAME=UNIT", default=(), help=units)
    parser.add_argument("--time", metavar="NAME", help="the column of times (default t, time or tout)")
    known = "standard deviations of columns where they are known, SI units"
    parser.add_argument("--noise", nargs="+", metavar="NAME=NUMBER", default=(), help=known)
    kinds = "parameters to find (default: inertia armature damping friction, and springs where there are any)"
    parser.add_argument("--kinds", nargs="+", metavar="KIND", help=kinds)
    parser.add_argument("--spacing", type=positive, metavar="S", help="between knots of the motions' splines")
    beforehand = "how well constants are known, by kind or name: deviations in their units, or shares such as mass=5%%"
    parser.add_argument("--prior", nargs="+", metavar="NAME=NUMBER", default=(), help=beforehand)
    parser.add_argument("--plain", action="store_true", help="count all efforts, also those that are grossly off")
    parser.add_argument("--align", action="store_true", help="set the clocks of efforts right where they are late")
    falls = "look for friction that falls from a breakaway level with speed, of these joints or of all"
    parser.add_argument("--stribeck", nargs="*", metavar="JOINT", help=falls)
    drives = "find factors of motors' efforts, known to a share (10%%), or to one each (JOINT=10%%), or not known"
    parser.add_argument("--motors", nargs="*", metavar="SHARE", help=drives)
    more = "constants known to be larger in one of the logs, such as those of a load: mass:link3=0.5 (again for others)"
    parser.add_argument("--added", nargs="+", action="append", metavar=("LOG", "NAME=NUMBER"), default=[], help=more)
    written = "write the mechanism with consistent constants there"
    complete(parser.add_argument("--out", type=Path, metavar="FILE", help=written), shtab.FILE)
    page = "write a page with values, deviations and what is left there"
    complete(parser.add_argument("--report", type=Path, metavar="FILE", help=page), shtab.FILE)


def _identify(options: argparse.Namespace) -> int:
    model = ReducedModel(load(options))
    if options.out:
        format_written(options.out)
    columns = dict(_pairs(options.columns, "--columns")) if options.columns else None
    units = {name: _number(unit) for name, unit in _pairs(options.units, "--units")}
    noise = {name: _number(level) for name, level in _pairs(options.noise, "--noise")}
    prior = {name: _number(size) for name, size in _pairs(options.prior, "--prior")}
    smoothing: dict[str, Any] = {"spacing": options.spacing, "noise": noise}
    stribeck = options.stribeck if options.stribeck else options.stribeck is not None
    logs = [Log.read(path, columns=columns, units=units, time=options.time) for path in options.logs]
    with busy(options.json, "motions behind the logs, and constants"):
        asked = {"kinds": options.kinds, "prior": prior, "robust": not options.plain, "align": options.align}
        asked |= {"stribeck": stribeck, "motors": _motors(options.motors), "added": _added(options.logs, options.added)}
        estimate = identify(model, logs, **asked, **smoothing)
        chosen = consistent(estimate.model, estimate) if options.out or options.report else estimate.parameters
    written = []
    if options.out:
        notes = write_description(with_constants(estimate.model, chosen), options.out)
        written.append(str(options.out))
    if options.report:
        from ccpin.identification.estimates.constants_page import estimate_page

        told = []
        for log, late, added in zip(logs, estimate.delays, estimate.added, strict=True):
            on_time = log.delayed({"u": late.taken}) if late.taken else log
            motion = smoothed(estimate.motors.corrected(on_time), model, **smoothing)
            before = told_of_motion(model, model.parameters.plus(added), motion)
            told.append((log.source, before, told_of_motion(estimate.model, chosen.plus(added), motion)))
        page = estimate_page(estimate, chosen, told)
        write_text(options.report, page)
        written.append(str(options.report))
    if options.json:
        print(json.dumps(_told(estimate) | {"written": written}, indent=2))
        return 0
    print(f"{estimate!r}\n{estimate.table()}")
    for path, added in zip(options.logs, estimate.added, strict=True):
        print("".join(f"in {path} {value:g} was added to {name}\n" for name, value in added.items()), end="")
    for each in estimate.held_out:
        missed, files = (", ".join(f"{x:.3g}" for x in sizes) for sizes in (each.found, each.stated))
        without = "" if each.coulomb is None else f"; without Stribeck's {', '.join(f'{x:.3g}' for x in each.coulomb)}"
        print(f"held out, {each.where}: missed {missed} N m or N (RMS); by the file's constants {files}{without}")
    for late in estimate.delays:
        if abs(late.seconds) > _LATE * late.deviation:
            put = f"set right by {1e3 * late.taken:.3g} ms" if options.align else "--align sets it right"
            print(f"efforts of {late.log} are {1e3 * late.seconds:.3g} ± {1e3 * late.deviation:.2g} ms late; {put}")
    for name, chained in zip(model.coordinates.names, estimate.autocorrelation, strict=True):
        if chained > _CHAINED:
            print(
                f"residuals at {name} are correlated from sample to sample (autocorrelation {chained:.2g}), which "
                "deviations count: noise of efforts is coloured, or small beside that of encoders, or the file's "
                "lengths, encoders' zeros or friction are wrong"
            )
    if estimate.outliers:
        print(f"left out, as efforts are grossly off: {len(estimate.outliers)} of the samples (--report names them)")
    print("".join(f"wrote {path}\n" for path in written), end="")
    if options.out:
        print("".join(f"not in the file: {note}\n" for note in notes), end="")
    return 0


def _told(estimate: Estimate) -> dict[str, Any]:
    """As JSON has it."""
    numbers = zip(estimate.values.tolist(), estimate.deviations.tolist(), estimate.stated.tolist(), strict=True)
    fields = ("combination", "unit", "value", "deviation", "stated")
    rows = zip(estimate.combinations, estimate.units, numbers, strict=True)
    found = [dict(zip(fields, (name, unit, *rest), strict=True)) for name, unit, rest in rows]
    samples = dict(zip(("counted", "left_out"), estimate.samples, strict=True))
    unseen = [
        {"where": each.where, "samples": each.samples}
        | {key: size.tolist() for key in _SIZES if (size := getattr(each, key)) is not None}
        for each in estimate.held_out
    ]
    delays = [
        each._asdict() | {"deviation": each.deviation if each.deviation < float("inf") else None}
        for each in estimate.delays
    ]
    of_k = (estimate.motors.names, estimate.motors.values.tolist(), estimate.motors.deviations.tolist())
    return {
        "found": found,
        "autocorrelation": estimate.autocorrelation.tolist(),
        "stribeck": [_friction(each) for each in estimate.stribeck],
        "motors": [dict(zip(("motor", "k", "deviation"), each, strict=True)) for each in zip(*of_k, strict=True)],
        "added": list(estimate.added),
        "samples": samples,
        "outliers": [each._asdict() for each in estimate.outliers],
        "held_out": unseen,
        "delays": delays,
    }


def _friction(found: StribeckFriction) -> dict[str, Any]:
    """As JSON has it: no number that is none."""
    told: dict[str, Any] = {"joint": found.joint, "gain": found.gain, "due": found.due, "reason": found.reason}
    if not found.reason:
        told |= dict(zip(("coulomb", "breakaway", "speed"), found.values.tolist(), strict=True))
        told |= {"deviations": found.deviations.tolist(), "interval": list(found.interval)}
    return told


def _motors(given: Sequence[str] | None) -> bool | str | float | dict[str, str | float | None]:
    """As `identify` takes it."""
    if not given:
        return given is not None
    if len(given) == 1 and "=" not in given[0]:
        return _number(given[0])
    return {name: _number(size) for name, size in _pairs(given, "--motors")}


def _added(logs: Sequence[Path], given: Sequence[Sequence[str]]) -> list[dict[str, Any]]:
    """Of each log, as `identify` takes it."""
    told: dict[Path, dict[str, Any]] = {path: {} for path in logs}
    for log, *constants in given:
        if Path(log) not in told:
            raise InvalidInputError(f"--added: '{log}' is none of --logs; {choices(log, map(str, logs))}")
        told[Path(log)] |= {name: _number(value) for name, value in _pairs(constants, "--added")}
    return [told[path] for path in logs]


def _pairs(given: Sequence[str], option: str) -> list[tuple[str, str]]:
    pairs = [tuple(each.split("=", 1)) for each in given]
    if wrong := [each for each, pair in zip(given, pairs, strict=True) if len(pair) != 2 or not all(pair)]:
        raise InvalidInputError(f"{option}: '{wrong[0]}' must be NAME=VALUE")
    return [(pair[0], pair[1]) for pair in pairs]


def _number(unit: str) -> str | float:
    try:
        return float(unit)
    except ValueError:
        return unit
