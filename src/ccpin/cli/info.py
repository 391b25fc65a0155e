"""`ccpin info` and `ccpin modes`: what was loaded, and its assembly modes."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shtab

from ccpin.cli.command import add_command, complete, count, positive
from ccpin.cli.notes import gathered
from ccpin.cli.options import add_mechanism, add_vector, load, vector
from ccpin.cli.progress import busy, progress_bar
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.dynamics.assembly import INTERRUPTED, AssemblyMode, AssemblyModes, ModeSearch, assembly_modes
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.mechanism.mechanism import Mechanism
from ccpin.native import backend

_MODES = """\
example: ccpin modes rpdr --q-deg -100 -80
         ccpin modes rpdr --q-deg -100 -80 --out modes.png"""
_BAR = "{l_bar}{bar}| {n_fmt} of {total_fmt} starts without news, {postfix}"


def add_info(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "info", "example: ccpin info rpdr", _info)
    add_mechanism(parser)


def _info(options: argparse.Namespace) -> None:
    facts = summary(load(options))
    print(json.dumps(facts, indent=2) if options.json else in_words(facts))


def add_modes(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "modes", _MODES, _modes)
    add_mechanism(parser)
    add_vector(parser, "q", "independent coordinates (default: the reference's)")
    parser.add_argument("--budget", type=positive, metavar="S", help="stop after so many seconds (default: no limit)")
    parser.add_argument(
        "--patience", type=count, default=60, metavar="N", help="end after N closed starts without news"
    )
    parser.add_argument("--limit", type=count, default=2000, metavar="N", help="stop after N starts (default 2000)")
    written = "draw the modes, one panel each, as a picture (.png, .pdf, .svg)"
    complete(parser.add_argument("--out", type=Path, metavar="FILE", help=written), shtab.FILE)


def _modes(options: argparse.Namespace) -> int:
    mechanism = load(options)
    model = ReducedModel(mechanism)
    q = vector(options, "q", mechanism)
    with progress_bar(options.json, options.patience, _BAR, _searched) as progress:
        found = assembly_modes(
            model,
            model.alpha(mechanism.q_reference) if q is None else q,
            patience=options.patience,
            limit=options.limit,
            budget=options.budget,
            progress=progress,
        )
    drawn = options.out is not None and bool(found.modes)
    if drawn:
        with busy(options.json, "drawing"):
            _draw_modes(mechanism, found, options.out)
    if options.json:
        modes = [mode._asdict() | {"q_free": mode.q_free.tolist()} for mode in found.modes]
        print(json.dumps(found._asdict() | {"modes": modes}, indent=2))
    else:
        print("\n".join([*_modes_in_words(found, mechanism.tree.names), *([f"wrote {options.out}"] if drawn else [])]))
    return 130 if found.reason.startswith(INTERRUPTED) else 0


def _draw_modes(mechanism: Mechanism, found: AssemblyModes, out: Path) -> None:
    """Each mode in a panel of its own, with its number above it."""
    from ccpin import plotting
    from ccpin.plotting.motion import plot_configuration_panels

    panels = [(f"mode {k}{_which(mode)}", [mode.q_free]) for k, mode in enumerate(found.modes, start=1)]
    title = f"{mechanism.title}: assembly modes found over one q"
    plotting.save(plot_configuration_panels(mechanism, panels, ["mode"], title), out)


def _which(mode: AssemblyMode) -> str:
    return (", the reference's" if mode.is_reference else "") + ("" if mode.within_limits else ", outside the limits")


def _modes_in_words(found: AssemblyModes, joints: Sequence[str]) -> Iterator[str]:
    count = len(found.modes)
    if not count and not found.singular:
        yield f"no closed configuration found: {found.reason} (`ccpin domain FILE --sheets` proves where none is)"
        return
    yield f"{count} assembly mode{'s' if count != 1 else ''} found: {found.reason}"
    if count:
        yield f"q′ in rad and m, of {', '.join(joints)}"
    if found.singular:
        yield f"{found.singular} starts ended at singular configurations, which belong to no mode"
    for k, mode in enumerate(found.modes, start=1):
        yield f"mode {k}{_which(mode)}: sign det ψ_q′ = {mode.sign:+d}, 1/κ = {mode.rcond:.3g}, from {mode.hits} starts"
        yield f"  q′ = {np.array2string(mode.q_free, precision=6, separator=', ')}"


def _searched(search: ModeSearch) -> tuple[float, str]:
    return search.quiet, f"{search.modes} modes from {search.starts} starts"


def summary(mechanism: Mechanism) -> dict[str, Any]:
    """A JSON-ready summary: sizes, rank, mobility, joints, closure error and conditioning at the reference.

    The assembly mode is told by the reference configuration and the sign of det ψ_q′ there (0 where redundant rows
    make ψ_q′ tall), which is constant along a branch.
    """
    parametrization = mechanism.parametrization()
    constraints = parametrization.constraints
    factor = parametrization.at(mechanism.q_reference).factor
    residual = constraints.residual(mechanism.q_reference)
    model, mobility = mechanism.tree.model, mechanism.mobility
    joints = [
        {"name": joint.name, "type": joint.kind.name, "reference": mechanism.q_reference[joint.q].tolist()}
        for joint in mechanism.tree.joints
    ]
    rows = constraints.row_slices()
    return {
        "name": mechanism.name,
        "source": mechanism.description.source,
        "n_free": mechanism.n_free,
        "nq": mechanism.nq,
        "constraint_rows": mobility.rows,
        "constraint_rank": mobility.rank,
        "mobility": mobility.mobility,
        "idle_mobilities": list(mobility.idle),
        "locked": list(mechanism.locked),
        "independent": list(mechanism.independent),
        "actuated": list(mechanism.actuated),
        "joints": joints,
        "closures": [
            {
                "name": loop.closure.name,
                "type": loop.closure.kind,
                "links": [loop.closure.link_a, loop.closure.link_b],
                "rows": loop.size,
                "planar": loop.normal is not None,
            }
            for loop in constraints.loops
        ],
        "couplings": [coupling.name for coupling in mechanism.couplings],
        "closure_error": float(np.linalg.norm(residual)),
        "closure_error_by_loop": {name: float(np.linalg.norm(residual[window])) for name, window in rows.items()},
        "rcond": factor.rcond,
        "assembly_mode": {"sign_det_psi": factor.sign, "q_free": mechanism.q_reference.tolist()},
        "forces": _forces(mechanism),
        "mass": float(sum(model.inertias[j].mass for j in range(1, model.njoints))),
        "notes": list(mechanism.notes),
        "backend": backend()._asdict(),
    }


def _forces(mechanism: Mechanism) -> dict[str, list[str]]:
    """Gears, springs, dampers and dry friction, each as ``joint number`` in N, m, rad, s."""
    motors = dict.fromkeys(f"{m.joint} {m.gear:g}" for m in mechanism.motors.each if m.gear != 1.0)
    words = {"springs": "stiffness", "dampers": "damping", "dry friction": "friction"}
    stated = {
        word: [f"{j.name} {value:g}" for j in mechanism.tree.joints if (value := getattr(j.stated, field))]
        for word, field in words.items()
    }
    return {"gears": list(motors), **stated}


def in_words(facts: dict[str, Any]) -> str:
    """The summary as text for a terminal."""
    closures = [
        f"  {c['name']}: {c['type']}, {c['links'][0]} – {c['links'][1]}, {c['rows']} rows"
        + (" (planar loop)" if c["planar"] else "")
        for c in facts["closures"]
    ] + [f"  {name}: coupling, 1 row" for name in facts["couplings"]]
    sign = {1: "det ψ_q′ > 0", -1: "det ψ_q′ < 0", 0: "redundant rows, no determinant"}
    lines = [
        f"{facts['name']}  ({facts['source'] or 'built in Python'})",
        f"free system     n′ = {facts['n_free']} velocities, {facts['nq']} configuration numbers, "
        f"{len(facts['joints'])} joints, {facts['mass']:.4g} kg moving",
        f"constraints     {facts['constraint_rows']} rows of rank {facts['constraint_rank']}",
        *closures,
        f"mobility        n = n′ − rank = {facts['mobility']}",
        *(f"  idle: {sentence}" for sentence in facts["idle_mobilities"]),
        *([f"locked          {', '.join(facts['locked'])}"] if facts["locked"] else []),
        f"independent     {', '.join(facts['independent'])}",
        f"actuated        {', '.join(facts['actuated'])}",
        *(f"{word:<16}{', '.join(values)}" for word, values in facts["forces"].items() if values),
        f"closure error   {facts['closure_error']:.1e} at the reference",
        f"conditioning    1/κ(ψ_q′) = {facts['rcond']:.3g} at the reference",
        f"assembly mode   {sign[facts['assembly_mode']['sign_det_psi']]}, reference:",
        *(f"  {joint['name']}: {_value(joint)}" for joint in facts["joints"]),
        f"computed by     {facts['backend']['name']}: {facts['backend']['reason']}",
        *(f"note: {note}" for note in gathered(facts["notes"])),
    ]
    return "\n".join(lines)


def _value(joint: dict[str, Any]) -> str:
    values, kind = joint["reference"], JOINT_KINDS[joint["type"]]
    if kind.nv == 1:
        value = float(kind.theta(np.array(values), np.eye(3))[0])
        return f"{value:.6g} m" if kind.sliding else f"{np.degrees(value):.4f}°"
    return "(" + ", ".join(f"{value:.6g}" for value in values) + ")"
