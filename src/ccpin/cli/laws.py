"""A law, as options say it."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.cli.command import positive
from ccpin.cli.options import each
from ccpin.control import (
    ComputedTorque,
    ControlLaw,
    Hold,
    PDFullGravity,
    PDOnlineGravity,
    PDPlus,
    PDSimpleGravity,
    local_gains,
)
from ccpin.control.control_law import NoTorque
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError

TRACKING: dict[str, Callable[..., ControlLaw]] = {
    "online": PDOnlineGravity,
    "pd_plus": PDPlus,
    "computed_torque": ComputedTorque,
}
_RATE = 10.0  # rad/s, of computed torque: K_p = ω², K_v = 2ω


def add_law(parser: argparse.ArgumentParser) -> None:
    """Which law of a set point, and its gains."""
    parser.add_argument("--law", choices=("simple", "full", "none"), default="simple", help="gravity compensation")
    add_gains(parser)


def add_gains(parser: argparse.ArgumentParser) -> None:
    """The gains of a law."""
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
    if (options.kp is None) != (options.kv is None):
        raise InvalidInputError("--kp and --kv belong together (one for each independent velocity, or one number)")
    if options.kp is not None:
        gains: tuple[ArrayLike, ArrayLike] = _gain(options, "kp", model.n), _gain(options, "kv", model.n)
    elif options.law == "computed_torque":
        gains = np.full(model.n, _RATE**2), np.full(model.n, 2 * _RATE)
    else:
        gains = local_gains(model, goal, near=q_free)
    if options.law in TRACKING:
        return TRACKING[options.law](model, Hold(model, goal), *gains, q_free)
    law = PDSimpleGravity if options.law == "simple" else PDFullGravity
    return law(model, goal, *gains, q_free)


def _gain(options: argparse.Namespace, name: str, n: int) -> float | tuple[float, ...]:
    """One number as it is, so that its unit is checked; else n."""
    gains = each(options, name, n) or ()
    return gains[0] if len(getattr(options, name)) == 1 else gains
