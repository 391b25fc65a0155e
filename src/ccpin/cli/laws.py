"""The law of a set point, as options say it."""

from __future__ import annotations

import argparse

from ccpin.arrays import Array
from ccpin.cli.command import positive
from ccpin.cli.options import each
from ccpin.control import ControlLaw, PDFullGravity, PDSimpleGravity, local_gains
from ccpin.control.control_law import NoTorque
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError


def add_law(parser: argparse.ArgumentParser) -> None:
    """Which law, and its gains."""
    parser.add_argument("--law", choices=("simple", "full", "none"), default="simple", help="gravity compensation")
    parser.add_argument(
        "--kp",
        nargs="+",
        type=positive,
        metavar="K",
        help="proportional gains: n, or one where all q are angles or all lengths (default: for 10 rad/s at the goal)",
    )
    parser.add_argument("--kv", nargs="+", type=positive, metavar="K", help="velocity gains, alike (default: critical)")


def law_of(model: ReducedModel, options: argparse.Namespace, goal: Array, q_free: Array) -> ControlLaw:
    """The law to a goal, σ(goal) near q_free.

    Raises:
        InvalidInputError: One kind of gains without the other.
    """
    if options.law == "none":
        return NoTorque(model)
    law = PDSimpleGravity if options.law == "simple" else PDFullGravity
    if options.kp is None and options.kv is None:
        return law(model, goal, *local_gains(model, goal, near=q_free), q_free)
    if options.kp is None or options.kv is None:
        raise InvalidInputError("--kp and --kv belong together (one for each independent velocity, or one number)")
    return law(model, goal, _gain(options, "kp", model.n), _gain(options, "kv", model.n), q_free)


def _gain(options: argparse.Namespace, name: str, n: int) -> float | tuple[float, ...]:
    """One number as it is, so that its unit is checked; else n."""
    gains = each(options, name, n) or ()
    return gains[0] if len(getattr(options, name)) == 1 else gains
