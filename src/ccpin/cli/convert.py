"""`ccpin convert`: a mechanism written in another format, or in its own with the pose and joints settled."""

from __future__ import annotations

import argparse
import json
from typing import Any

import shtab

from ccpin.cli.command import add_command, complete
from ccpin.cli.notes import gathered
from ccpin.cli.options import add_mechanism, load
from ccpin.cli.progress import busy
from ccpin.cli.serial import add_serial, convert_serial, refuse_without_serial
from ccpin.description.formats import FORMATS, LOOPS, MESHES, format_of
from ccpin.errors import InvalidInputError
from ccpin.mechanism.mechanism import Mechanism

_EXAMPLES = """\
example: ccpin convert rpdr --out rpdr.xml --loops tight --check
         ccpin convert four_bar --serial --out serial.urdf"""


def add_convert(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "convert", _EXAMPLES, _convert)
    add_mechanism(parser)
    written = "the file to write; .urdf, .sdf, .xml or .yaml"
    complete(parser.add_argument("--out", required=True, metavar="FILE", help=written), shtab.FILE)
    parser.add_argument("--to", choices=tuple(FORMATS), help="the format, where the suffix does not tell it")
    held = "how softly MuJoCo is to hold the loops (.xml): as the file says, or as tightly as it can"
    parser.add_argument("--loops", choices=LOOPS, default="as_stated", help=held)
    placed = "whether mesh files are copied into a folder beside the file, or kept where they are (default copied)"
    parser.add_argument("--meshes", choices=MESHES, default="copied", help=placed)
    ran = "run the .xml in MuJoCo for a second beside the reduced model: how far loops open and joints go astray"
    parser.add_argument("--check", action="store_true", help=ran)
    add_serial(parser)


def _convert(options: argparse.Namespace) -> int:
    if options.serial:
        return convert_serial(options)
    refuse_without_serial(options)
    mechanism = load(options)
    wanted = options.to or format_of(options.out)
    if options.check and wanted != "mjcf":
        raise InvalidInputError(
            "--check runs the file in MuJoCo, which wants MJCF: --to mjcf, or a name that ends in .xml"
        )
    with busy(options.json, "writing"):
        notes = mechanism.save(options.out, options.to, loops=options.loops, meshes=options.meshes)
    if wanted == "toolbox":
        notes = ("its robot.urdf is written beside it", *notes)
    checked = _checked(mechanism, options) if options.check else None
    if options.json:
        said = {"written": options.out, "n": mechanism.n, "notes": notes} | ({"mujoco": checked[1]} if checked else {})
        print(json.dumps(said))
    else:
        print(f"{options.out} written: {mechanism.name}, n = {mechanism.n}, closed at its reference")
        print(*(f"note: {note}" for note in gathered(notes)), sep="\n", end="\n" if notes else "")
        if checked is not None:
            print(f"in MuJoCo, u held: {checked[0]}")
    return 0


def _checked(mechanism: Mechanism, options: argparse.Namespace) -> tuple[str, dict[str, float]]:
    """What a run in MuJoCo came to, in words and numbers."""
    from ccpin.simulation.studies.mujoco_runs import run_in_mujoco

    with busy(options.json, "running"):
        run = run_in_mujoco(mechanism, options.out)
    return str(run), {"gap": run.gap, "turned": run.turned, "slid": run.slid, "seconds": run.seconds}
