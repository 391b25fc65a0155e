"""`ccpin export`: quantities of the reduced model, recorded as one program and written in another language."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete, count
from ccpin.cli.laws import add_law, law_of
from ccpin.cli.options import add_mechanism, add_vector, load, vector
from ccpin.cli.progress import busy
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.programs.exporting import TARGETS, export
from ccpin.programs.recordings import record
from ccpin.programs.sine_cosine import PRECISIONS

_EXAMPLES = """\
example: ccpin export rpdr --what forward_dynamics --out firmware
         ccpin export rpdr --what sigma torque --given near --precision float --goal-deg -90 -100 --out firmware
         ccpin export rpdr --target json --what mass gravity --name rpdr_terms --out firmware"""


def add_export(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "export", _EXAMPLES, _export)
    add_mechanism(parser)
    names = "what is computed, as ccpin.programs.record names it: forward_dynamics, rho, mass, gravity, torque, sigma …"
    parser.add_argument("--what", nargs="+", required=True, metavar="NAME", help=names)
    parser.add_argument("--target", choices=tuple(TARGETS), default="c", help="the language (default c)")
    known = "q′ is given closed, or q and a closed configuration near by, from which sigma(q) is found (default closed)"
    parser.add_argument("--given", choices=("closed", "near"), default="closed", help=known)
    parser.add_argument("--steps", type=count, default=2, metavar="N", help="Newton steps of sigma (default 2)")
    also = "also the derivatives by these of q, v, u, a"
    parser.add_argument("--derivatives", nargs="+", default=(), metavar="BY", help=also)
    parser.add_argument("--precision", choices=tuple(PRECISIONS), default="double", help="of C's arithmetic")
    parser.add_argument("--name", metavar="NAME", help="of function and files (default: of mechanism and what)")
    add_vector(parser, "goal", "the set point of torque and lyapunov (default: the reference)")
    add_law(parser)
    written = "the folder to write to; it is made where it is absent"
    complete(parser.add_argument("--out", type=Path, required=True, metavar="DIR", help=written), shtab.DIRECTORY)


def _export(options: argparse.Namespace) -> int:
    mechanism = load(options)
    model = ReducedModel(mechanism)
    law, goal = None, vector(options, "goal", mechanism)
    if {"torque", "lyapunov"} & set(options.what):
        law = law_of(
            model, options, model.alpha(mechanism.q_reference) if goal is None else goal, mechanism.q_reference
        )
    with busy(options.json, "recording"):
        program = record(
            model,
            options.what,
            given=options.given,
            steps=options.steps,
            derivatives=tuple(options.derivatives),
            law=law,
        )
        files = export(program, options.out, options.target, name=options.name, format=options.precision)
    ports = {
        side: [port._asdict() for port in group]
        for side, group in (("inputs", program.inputs), ("outputs", program.outputs))
    }
    if options.json:
        told = {"written": list(map(str, files)), "digest": program.digest, "operations": program.operations}
        print(json.dumps(told | ports, indent=2))
        return 0
    reads, gives = (", ".join(port.name for port in group) for group in (program.inputs, program.outputs))
    print(f"{program.name}: {reads} ↦ {gives}, {sum(program.operations.values())} operations")
    print(f"wrote {', '.join(map(str, files))}")
    return 0
