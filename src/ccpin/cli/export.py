"""`ccpin export`: quantities of the reduced model, recorded as one program and written in another language."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete, count, judged
from ccpin.cli.laws import TRACKING, add_gains, law_of
from ccpin.cli.options import add_mechanism, add_vector, load, region, vector
from ccpin.cli.progress import busy
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.programs.exporting import TARGETS, export
from ccpin.programs.recordings import record
from ccpin.programs.sine_cosine import PRECISIONS

_EXAMPLES = """\
example: ccpin export rpdr --what forward_dynamics --out firmware
         ccpin export rpdr --what sigma torque --given near --precision float --goal-deg -90 -100 --out firmware
         ccpin export rpdr --what sigma torque --given near --law computed_torque --out firmware
         ccpin export rpdr --target json --what mass gravity --name rpdr_terms --out firmware
         ccpin export rpdr --what mass --lower-deg -92 -92 --upper-deg -88 -88 --save mass.npz --out firmware"""


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
    add_vector(
        parser, "goal", "the set point of torque and lyapunov, about which gains are chosen (default: the reference)"
    )
    laws = (
        "the law of torque: PD with gravity at the goal (simple, the default) or at q (full); or one whose reference "
        "q_d, v_d, a_d is an input: PD with gravity at q (online), PD+, computed torque; its efforts are not clipped "
        "to the motors' limits"
    )
    parser.add_argument("--law", choices=("simple", "full", *TRACKING), default="simple", help=laws)
    add_gains(parser)
    moves = "the set point of simple and full is an input, too: q_d, and of simple its gravity g_d"
    parser.add_argument("--moving", action="store_true", help=moves)
    add_vector(parser, "lower", "lower corner of a box of q: what it computes there is proved, all else refused")
    add_vector(parser, "upper", "upper corner of that box")
    within = "of a box: bounds of the other inputs' absolute values, as v=1 u=2,2.5"
    parser.add_argument("--bounds", nargs="+", metavar="NAME=NUMBERS", default=(), help=within)
    cut = "of a box: into how many cells it is cut at most (default 4096)"
    parser.add_argument("--max-cells", type=count, default=4096, metavar="N", help=cut)
    kept = "of a box: also write the certificate, which `ccpin verify` replays (.json, else npz)"
    complete(parser.add_argument("--save", type=Path, metavar="FILE", help=kept), shtab.FILE)
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
            moving=options.moving or (law is not None and options.law in TRACKING),
        )
    box, bounds = region(options, mechanism), _bounds(options.bounds)
    if box is None and (bounds or options.save):
        raise InvalidInputError("--bounds and --save are of a box of q: give --lower and --upper")
    if box is not None:
        from ccpin.validated import certify_program  # with python-flint

        with busy(options.json, "proving"):
            format, most = options.precision, options.max_cells
            certificate = certify_program(program, box, bounds=bounds, formats=(format,), max_cells=most)
        if certificate.verdict != "proven":
            verdict: dict[str, Any] = {"written": [], "verdict": certificate.verdict, "reason": certificate.reason}
            words = f"undecided, nothing is written: {certificate.reason}"
            print(json.dumps(verdict, indent=2) if options.json else words)
            return judged(certificate.verdict)
        program = certificate.guarded()
        if options.save is not None:
            certificate.save(options.save)
    with busy(options.json, "writing"):
        files = export(program, options.out, options.target, name=options.name, format=options.precision)
    ports = {
        side: [port._asdict() for port in group]
        for side, group in (("inputs", program.inputs), ("outputs", program.outputs))
    }
    if options.json:
        told: dict[str, Any] = {
            "written": list(map(str, files)),
            "digest": program.digest,
            "operations": program.operations,
        }
        told |= {"statement": None if program.region is None else program.region.statement, "notes": program.notes}
        print(json.dumps(told | ports, indent=2))
        return 0
    reads, gives = (", ".join(port.name for port in group) for group in (program.inputs, program.outputs))
    print(f"{program.name}: {reads} ↦ {gives}, {sum(program.operations.values())} operations")
    print(*program.notes, sep="\n", end="\n" if program.notes else "")
    if program.region is not None:
        print(program.region.statement)
    print(f"wrote {', '.join(map(str, [*files, *([options.save] if options.save else [])]))}")
    return 0


def _bounds(words: Sequence[str]) -> dict[str, Any]:
    """Bounds by name, of ``name=number,number`` each; one number for all of an input's.

    Raises:
        InvalidInputError: One is written otherwise.
    """
    found: dict[str, Any] = {}
    for word in words:
        name, _, written = word.partition("=")
        try:
            numbers = [float(each) for each in written.split(",")]
        except ValueError:
            raise InvalidInputError(f"--bounds: '{word}' is not name=number, as in v=1 or u=2,2.5") from None
        found[name] = numbers if len(numbers) > 1 else numbers[0]
    return found
