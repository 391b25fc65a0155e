"""`ccpin transmission --identify`: lengths and anchors of a linkage from a table of measured angles."""

from __future__ import annotations

import argparse
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import shtab

from ccpin.arrays import Array
from ccpin.cli.command import complete, positive
from ccpin.cli.progress import busy
from ccpin.errors import InvalidInputError
from ccpin.transmission.identifying_geometry import identify_geometry
from ccpin.transmission.transmission import Transmission


def add_identify(parser: Any) -> None:
    """Its options."""
    measured = "geometry from measured pairs: a table with a column for each motor's joint and each joint, in rad"
    complete(parser.add_argument("--identify", type=Path, metavar="PAIRS.csv", help=measured), shtab.FILE)
    parser.add_argument("--degrees", action="store_true", help="the table's angles are in degrees")
    spread = "standard deviation of the table's angles (default 0.02)"
    parser.add_argument("--noise", type=positive, default=0.02, metavar="DEG", help=spread)
    named = "joints, closures (or one end, CLOSURE/A) or single numbers (origin:JOINT/x)"
    parser.add_argument("--unknown", nargs="+", metavar="NAME", help=f"what to identify: {named}; default all")
    parser.add_argument("--known", nargs="+", default=(), metavar="NAME", help="what of that is right in the file")
    parser.add_argument("--offsets", nargs="+", default=(), metavar="JOINT", help="encoders mounted off")


def identify(transmission: Transmission, options: argparse.Namespace) -> None:
    """Print what is found, and write the mechanism with it where --out says."""
    from ccpin.mechanism.loading.loader import load as load_mechanism

    turns = [unit == "rad" for side in (transmission.motor_side, transmission.joint_side) for unit in side.units]
    table = _table(options.identify, (*transmission.motors, *transmission.joints))
    table = np.where(np.array(turns) & options.degrees, np.radians(table), table)
    motors, joints = np.split(table, 2, axis=1)
    noise = float(np.radians(options.noise))
    with busy(options.json, "fitting"):
        found = identify_geometry(
            transmission, motors, joints, motor_noise=noise, joint_noise=noise,
            parameters=options.unknown, known=options.known, offsets=options.offsets,
        )  # fmt: skip
    if options.out is not None:
        load_mechanism(found.description).save(options.out)
    if not options.json:
        print(found, *([f"wrote {options.out}"] if options.out else []), sep="\n")
        return
    spreads = [float(x) if np.isfinite(x) else None for x in found.standard_deviations]
    rows = zip(found.parameters, found.units, found.stated.tolist(), found.values.tolist(), spreads, strict=True)
    names = ("name", "unit", "stated", "value", "standard_deviation")
    facts: dict[str, Any] = {
        "numbers": [dict(zip(names, row, strict=True)) for row in rows],
        "unobservable": found.unobservable,
    }
    facts |= {"pairs": len(motors), "rank": found.rank, "condition": found.condition, "misfit": found.misfit}
    facts |= {"residual_rms": found.residual_rms.tolist(), "written": options.out and str(options.out)}
    print(json.dumps(facts, indent=2))


def _table(path: Path, names: tuple[str, ...]) -> Array:
    """The columns of those names, of shape (N, names).

    Raises:
        InvalidInputError: It cannot be read, a column is not there, or an entry is no number.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            header, *rows = csv.reader(file, skipinitialspace=True)
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidInputError(f"{path} is no table: {error}") from None
    if lacking := [name for name in names if name not in header]:
        raise InvalidInputError(f"{path} has no column '{lacking[0]}'; its header names {', '.join(names)}")
    places = [header.index(name) for name in names]
    try:
        found = [[float(row[place]) for place in places] for row in rows]
    except (IndexError, ValueError) as error:
        raise InvalidInputError(f"{path}: {error}") from None
    return np.array(found).reshape(-1, len(names))
