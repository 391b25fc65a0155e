"""`ccpin excite`: a motion along which a mechanism's constants show, as a table for the robot to follow."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, get_args

import shtab

from ccpin.cli.command import add_command, complete, count, positive
from ccpin.cli.options import add_mechanism, add_vector, load, region
from ccpin.cli.progress import busy
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.identification.estimates.exciting_motions import Criterion, excitation
from ccpin.identification.logs.log_files import table_target

_EXAMPLES = """\
example: ccpin excite rpdr --lower-deg -110 -110 --upper-deg -70 -70 --speed 3 --out motion.csv
         ccpin excite slider_crank --lower 0.5 --upper 1.5 --speed 3 --duration 3 --criterion trace --out motion.csv"""


def add_excite(commands: Any) -> None:
    """The command and its options."""
    parser = add_command(commands, "excite", _EXAMPLES, _excite)
    add_mechanism(parser)
    add_vector(parser, "lower", "least coordinates")
    add_vector(parser, "upper", "greatest coordinates")
    parser.add_argument("--speed", type=positive, required=True, metavar="RAD/S", help="of each coordinate, at most")
    parser.add_argument("--effort", type=positive, metavar="NM", help="of each motor, at most (default: any)")
    parser.add_argument("--duration", type=positive, default=5.0, metavar="S", help="seconds (default 5)")
    parser.add_argument("--period", type=positive, default=1e-3, metavar="S", help="of the table (default 0.001)")
    parser.add_argument("--criterion", choices=get_args(Criterion), default="condition", help="what is made small")
    parser.add_argument("--seed", type=count, default=1, metavar="N", help="of the random motions (default 1)")
    table = "write t, q, v, a there (.csv or .parquet)"
    complete(parser.add_argument("--out", type=Path, required=True, metavar="FILE", help=table), shtab.FILE)


def _excite(options: argparse.Namespace) -> int:
    table_target(options.out)
    mechanism = load(options)
    model = ReducedModel(mechanism)
    box = region(options, mechanism)
    if box is None:
        raise InvalidInputError("say where the motion may go: --lower and --upper, or --lower-deg and --upper-deg")
    with busy(options.json, "motions tried"):
        found = excitation(
            model,
            options.duration,
            lower=box[0],
            upper=box[1],
            speed=options.speed,
            effort=options.effort,
            criterion=options.criterion,
            seed=options.seed,
        )
    found.save(options.out, options.period)
    facts = {
        "combinations": found.rank,
        "condition": found.condition,
        "trace": found.trace,
        "share_of_limits": found.share,
        "branch": None if found.path is None else found.path.reason,
        "written": str(options.out),
    }
    print(json.dumps(facts, indent=2) if options.json else f"{found.told}\nwrote {options.out}")
    return 0
