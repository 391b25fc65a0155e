"""`ccpin convert --serial`: the serial robot in the place of a linkage, and the maps to the motors and back."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from ccpin.cli.command import count
from ccpin.cli.options import load
from ccpin.cli.progress import busy
from ccpin.cli.transmission import add_sides, each_of, with_rotors
from ccpin.errors import InvalidInputError
from ccpin.programs.exporting import export
from ccpin.programs.sine_cosine import PRECISIONS, Format
from ccpin.transmission.serial_robots import SerialRobot, serial_robot
from ccpin.transmission.transmission import Transmission

_ALONE = ("joints", "motors", "rotor", "effort", "speed", "at", "within", "prove", "precision")  # with --serial only
_CELLS = 1024


def add_serial(parser: argparse.ArgumentParser) -> None:
    """The options."""
    group = parser.add_argument_group("a serial robot in the place of the linkage")
    told = "write the robot without its linkage, whose mass, rotor inertia and limits go to links and joints"
    maps = "beside it in OUT_maps, as C and as JSON, what leads from its joints to the motors and back"
    group.add_argument("--serial", action="store_true", help=f"{told}; {maps}")
    add_sides(group)
    met = "joints' displacements at which D is the mechanism's, rad or m (default: fitted over the range)"
    group.add_argument("--at", nargs="+", type=float, metavar="Q", help=met)
    ends = "the range: all joints' lower displacements, then all upper ones (default: as far as all is reached)"
    group.add_argument("--within", nargs="+", type=float, metavar="Q", help=ends)
    cells = f"prove limits and differences over the range, cut into N cells at most (default {_CELLS}); else of samples"
    group.add_argument("--prove", nargs="?", type=count, const=_CELLS, metavar="N", help=cells)
    group.add_argument("--precision", choices=tuple(PRECISIONS), help="of the maps as C (default double)")


def refuse_without_serial(options: argparse.Namespace) -> None:
    """Raise where an option of a serial robot is used without it.

    Raises:
        InvalidInputError: One is.
    """
    used = [f"--{name}" for name in _ALONE if getattr(options, name) is not None]
    if used:
        raise InvalidInputError(f"{', '.join(used)}: about a serial robot; give --serial too")


def convert_serial(options: argparse.Namespace) -> int:
    """Write the serial robot and the maps, and say by how much the robot is not the mechanism."""
    if options.check or options.loops != "as_stated":
        raise InvalidInputError("--check and --loops are about loops: a serial robot has none")
    transmission = Transmission(load(options), options.joints, options.motors)
    if options.rotor is not None:
        transmission = with_rotors(transmission, options.rotor)
    region = None
    if options.within is not None:
        if len(options.within) != 2 * transmission.n:
            raise InvalidInputError(f"--within takes {2 * transmission.n} numbers, of {', '.join(transmission.joints)}")
        lower, upper = np.array(options.within).reshape(2, -1)
        region = lower, upper
    with busy(options.json, "putting the linkage where it belongs"):
        effort, speed = each_of(options.effort), each_of(options.speed)
        robot = serial_robot(
            transmission, region, at=options.at, effort=effort, speed=speed, max_cells=options.prove or 0
        )
    notes = robot.save(options.out, options.to, meshes=options.meshes)
    with busy(options.json, "recording the maps"):
        maps = _maps(robot, Path(options.out), options.precision or "double")
    if options.json:
        print(json.dumps({"written": options.out, "maps": list(map(str, maps)), "notes": notes} | robot.as_json()))
        return 0
    written = f"wrote {options.out}, and the maps to the motors and back:"
    print(robot, written, *(f"  {each}" for each in maps), sep="\n")
    print(*(f"note: {note}" for note in notes), sep="\n", end="\n" if notes else "")
    return 0


def _maps(robot: SerialRobot, out: Path, precision: Format) -> list[Path]:
    """What leads to the motors and back, as C and as JSON, in a folder beside the robot's file."""
    folder = out.with_name(f"{out.stem}_maps")
    return [
        path
        for program in (robot.to_motors, robot.to_joints)
        for target in ("c", "json")
        for path in export(program, folder, target, format=precision)
    ]
