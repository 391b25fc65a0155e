"""`ccpin convert --serial`: the serial robot that stands for a linkage, and beside it the map back to the motors."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np

from ccpin.cli.command import positive
from ccpin.cli.options import load
from ccpin.cli.progress import busy
from ccpin.cli.transmission import each_of, with_rotors
from ccpin.errors import InvalidInputError

_ALONE = ("joints", "motors", "rotor", "effort", "speed", "at", "within")  # options that mean nothing without --serial


def add_serial(parser: argparse.ArgumentParser) -> None:
    """The options."""
    group = parser.add_argument_group("a serial robot in the place of the linkage")
    told = "write the robot without its linkage, whose mass, rotor inertia and limits go to links and joints"
    group.add_argument("--serial", action="store_true", help=f"{told}; beside it OUT_motors.json, back to the motors")
    group.add_argument("--joints", nargs="+", metavar="JOINT", help="the serial robot's (default: where evident)")
    group.add_argument("--motors", nargs="+", metavar="JOINT", help="the joints driven (default: the file's motors)")
    behind = "behind the gear, one number or one each"
    group.add_argument("--rotor", nargs="+", type=positive, metavar="KGM2", help=f"rotor inertia {behind}")
    group.add_argument("--effort", nargs="+", type=positive, metavar="NM", help=f"limits of the motors {behind}")
    group.add_argument("--speed", nargs="+", type=positive, metavar="RAD/S", help=f"limits of the motors {behind}")
    met = "joints' displacements at which D is the mechanism's, rad or m (default: fitted over the range)"
    group.add_argument("--at", nargs="+", type=float, metavar="Q", help=met)
    ends = "the range: all joints' lower displacements, then all upper ones (default: as far as all is reached)"
    group.add_argument("--within", nargs="+", type=float, metavar="Q", help=ends)


def refuse_without_serial(options: argparse.Namespace) -> None:
    """Raise where an option of a serial robot is used without it.

    Raises:
        InvalidInputError: One is.
    """
    used = [f"--{name}" for name in _ALONE if getattr(options, name) is not None]
    if used:
        raise InvalidInputError(f"{', '.join(used)}: about a serial robot; give --serial too")


def convert_serial(options: argparse.Namespace) -> int:
    """Write the serial robot and the map back, and say by how much the robot is not the mechanism."""
    from ccpin.transmission import Transmission, serial_robot

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
        robot = serial_robot(
            transmission, region, at=options.at, effort=each_of(options.effort), speed=each_of(options.speed)
        )
    notes = robot.save(options.out, options.to, meshes=options.meshes)
    beside = Path(options.out).with_name(f"{Path(options.out).stem}_motors.json")
    with busy(options.json, "recording the map"):
        robot.motor_map.save(beside)
    if options.json:
        print(json.dumps({"written": options.out, "motors": str(beside), "notes": notes} | robot.as_json()))
        return 0
    print(robot, f"{options.out} written; {beside}: from its joints to the motors", sep="\n")
    print(*(f"note: {note}" for note in notes), sep="\n", end="\n" if notes else "")
    return 0
