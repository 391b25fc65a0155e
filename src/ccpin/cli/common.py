"""What the commands share: mechanism and vector options."""

from __future__ import annotations

import argparse

import numpy as np
from numpy.typing import NDArray

import ccpin
from ccpin.errors import InvalidInputError
from ccpin.mechanism import Mechanism

Array = NDArray[np.float64]


def add_mechanism(parser: argparse.ArgumentParser) -> None:
    """The mechanism and what overrides its file."""
    parser.add_argument("mechanism", help="a file (URDF with loops, robot.yaml, MJCF) or an installed model's name")
    parser.add_argument("--independent", nargs="+", metavar="JOINT", help="independent joints, in the order of q")
    parser.add_argument("--actuated", nargs="+", metavar="JOINT", help="actuated joints, in the order of u")
    parser.add_argument("--floating-base", action="store_true", help="free the root link")
    parser.add_argument("--format", choices=("urdf", "mjcf", "toolbox"), help="instead of telling it from the content")
    parser.add_argument("--json", action="store_true", help="print machine-readable JSON (SI units, radians)")


def load(options: argparse.Namespace) -> Mechanism:
    """The mechanism the options name."""
    return ccpin.load(
        options.mechanism,
        independent=options.independent,
        actuated=options.actuated,
        floating_base=options.floating_base,
        format=options.format,
    )


def add_vector(parser: argparse.ArgumentParser, name: str, help_text: str) -> None:
    """A vector option in SI units and its twin in degrees."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(f"--{name}", nargs="+", type=float, metavar="Q", help=f"{help_text}, rad or m")
    group.add_argument(f"--{name}-deg", nargs="+", type=float, metavar="DEG", help=f"{help_text}, degrees")


def vector(options: argparse.Namespace, name: str, mechanism: Mechanism) -> Array | None:
    """A vector option in SI units, from whichever of its two spellings was used; ``None`` where neither was.

    Raises:
        InvalidInputError: Degrees are given where an independent coordinate is no plain angle.
    """
    plain, degrees = getattr(options, name), getattr(options, f"{name}_deg")
    if degrees is None:
        return None if plain is None else np.array(plain, dtype=np.float64)
    for coordinate in mechanism.independent:
        joint, _, component = coordinate.partition(":")
        if mechanism.tree.kinds[joint] != "revolute" and not component.startswith("r"):
            raise InvalidInputError(
                f"--{name}-deg is for mechanisms whose independent coordinates are all angles; '{coordinate}' "
                f"({mechanism.tree.kinds[joint]}) is none: give --{name} in rad and m, a continuous joint as its "
                "cosine and sine"
            )
    return np.asarray(np.radians(degrees), dtype=np.float64)
