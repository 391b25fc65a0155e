"""The options commands share: the mechanism, vectors with their twins in degrees, and the bench as it is."""

from __future__ import annotations

import argparse
from typing import Any, get_args

import numpy as np

from ccpin.arrays import Array
from ccpin.control.sampling import Sampling
from ccpin.description import FORMATS
from ccpin.errors import InvalidInputError
from ccpin.mechanism import load as load_mechanism
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.limits import Effort, Limits, Position, Velocity
from ccpin.simulation.motors import MotorModel


def add_mechanism(parser: argparse.ArgumentParser, optional: bool = False) -> None:
    """The mechanism and what overrides its file."""
    what = "a file (URDF with loops, SDF, robot.yaml, MJCF) or an installed model's name"
    parser.add_argument("mechanism", help=what, nargs="?" if optional else None)
    parser.add_argument("--independent", nargs="+", metavar="JOINT", help="independent joints, in the order of q")
    parser.add_argument("--actuated", nargs="+", metavar="JOINT", help="actuated joints, in the order of u")
    still = "joints, or components as ball:rx, to hold still at the reference"
    parser.add_argument("--locked", nargs="+", metavar="JOINT", default=(), help=still)
    idle = "spins that move nothing but themselves (a rod between balls) to leave free, or all"
    parser.add_argument("--free", nargs="+", metavar="JOINT", default=(), help=idle)
    near = "the pose to close near: one of the file's by name, or joint=value … in rad and m"
    parser.add_argument("--reference", nargs="+", metavar="POSE", help=near)
    wide = "error of the file's lengths and angles, relative to a loop's size (default 1e-5)"
    parser.add_argument("--geometry-tolerance", type=float, metavar="PART", help=wide)
    parser.add_argument("--floating-base", action="store_true", help="free the root link")
    parser.add_argument("--format", choices=FORMATS, help="instead of telling it from the content")
    parser.add_argument("--model", metavar="NAME", help="which model of an SDF file, where it holds several")
    parser.add_argument("--include-root", metavar="DIR", help="folder an SDF or MJCF file may include from (its own)")
    parser.add_argument("--xacro-arg", nargs="+", metavar="NAME:=VALUE", default=[], help="arguments of a xacro file")
    parser.add_argument("--json", action="store_true", help="print machine-readable JSON (SI units, radians)")


def load(options: argparse.Namespace) -> Mechanism:
    """The mechanism the options name."""
    return load_mechanism(
        options.mechanism,
        independent=options.independent,
        actuated=options.actuated,
        locked=options.locked,
        free=options.free,
        reference=_pose(options.reference),
        **({} if options.geometry_tolerance is None else {"geometry_tolerance": options.geometry_tolerance}),
        floating_base=options.floating_base,
        format=options.format,
        model=options.model,
        include_root=options.include_root,
        xacro_arguments=_xacro_arguments(options.xacro_arg),
    )


def _xacro_arguments(written: list[str]) -> dict[str, str]:
    """The arguments by name, of ``name:=value`` each.

    Raises:
        InvalidInputError: One is written otherwise.
    """
    pairs = [argument.partition(":=") for argument in written]
    if any(not (name and sign) for name, sign, _ in pairs):
        raise InvalidInputError(f"--xacro-arg takes name:=value, not {' '.join(written)}")
    return {name: value for name, _, value in pairs}


def _pose(words: list[str] | None) -> str | dict[str, list[float]] | None:
    """What --reference states: one name, or joint=value with commas between the numbers of a joint.

    Raises:
        InvalidInputError: It is neither.
    """
    if words is None or (len(words) == 1 and "=" not in words[0]):
        return words[0] if words else None
    pose: dict[str, list[float]] = {}
    for word in words:
        joint, _, value = word.rpartition("=")
        try:
            pose[joint] = [float(number) for number in value.split(",")]
        except ValueError:
            joint = ""
        if not joint:
            raise InvalidInputError(f"--reference: '{word}' is not joint=value, as in crank=0.5 (rad, m)")
    return pose


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
        joint, component = mechanism.tree.split(coordinate)
        kind = mechanism.tree.joint(joint).kind
        if not kind.angle and not component.startswith("r"):
            raise InvalidInputError(
                f"--{name}-deg is for mechanisms whose independent coordinates are all angles; '{coordinate}' "
                f"({kind.name}) is none: give --{name} in rad and m, a continuous joint as its "
                "cosine and sine"
            )
    return np.asarray(np.radians(degrees), dtype=np.float64)


def add_bench(parser: argparse.ArgumentParser) -> None:
    """What makes a simulated bench a real one: friction, sampling, encoders, filter, delay, limits, motors."""
    bench = parser.add_argument_group("the bench as it is", "each off by default but the motors' limits of effort")
    bench.add_argument("--friction-coulomb", nargs="+", type=float, metavar="F", help="N m or N, one or n")
    bench.add_argument("--friction-viscous", nargs="+", type=float, metavar="B", help="N m s/rad or N s/m, one or n")
    bench.add_argument("--sample-rate", type=float, metavar="HZ", help="run the law as a sampled loop")
    bench.add_argument("--encoder-counts", nargs="+", type=float, metavar="N", help="counts per turn (or metre)")
    bench.add_argument("--velocity-cutoff-hz", type=float, metavar="HZ", help="low-pass filter of the velocity")
    bench.add_argument("--saturation", nargs="+", type=float, metavar="U", help="largest effort, one or one a motor")
    bench.add_argument("--delay-samples", type=int, default=0, metavar="K", help="samples from encoder to effort")
    bench.add_argument("--encoder-noise", nargs="+", type=float, metavar="S", help="standard deviation, rad or m")
    bench.add_argument("--seed", type=int, default=0, metavar="N", help="of the noise")
    for name, words in (("position", Position), ("velocity", Velocity), ("effort", Effort)):
        usual = getattr(Limits(), name)
        bench.add_argument(f"--{name}-limits", choices=get_args(words), default=usual, help=f"default {usual}")
    bench.add_argument("--motor-lag", type=float, default=0.0, metavar="S", help="time constant of the current loops")
    bench.add_argument(
        "--motor-rate", type=float, default=np.inf, metavar="R", help="fastest change of an effort a second"
    )


def bench_settings(options: argparse.Namespace, n: int) -> dict[str, Any]:
    """The `friction`, `sampling`, `limits` and `motors` arguments of `simulate`.

    Raises:
        InvalidInputError: An option of the sampled loop without --sample-rate, or a rate that is not positive.
    """
    settings: dict[str, Any] = {
        "limits": Limits(options.position_limits, options.velocity_limits, options.effort_limits),
        "motors": MotorModel(lag=options.motor_lag, rate=options.motor_rate),
    }
    if options.friction_coulomb is not None or options.friction_viscous is not None:
        levels = (options.friction_coulomb, options.friction_viscous)
        settings["friction"] = tuple([0.0] * n if level is None else each(level, n) for level in levels)
    sampled = {
        "encoder_counts": _numbers(options.encoder_counts),
        "velocity_cutoff": options.velocity_cutoff_hz,
        "saturation": _numbers(options.saturation),
        "encoder_noise": _numbers(options.encoder_noise),
    }
    if options.sample_rate is None:
        if options.delay_samples or any(value is not None for value in sampled.values()):
            raise InvalidInputError("encoders, noise, velocity filter, saturation and delay belong to --sample-rate")
        return settings
    if not options.sample_rate > 0:
        raise InvalidInputError(f"--sample-rate {options.sample_rate} must be positive")
    settings["sampling"] = Sampling(
        1.0 / options.sample_rate,
        delay=options.delay_samples,
        seed=options.seed,
        **{name: value for name, value in sampled.items() if value is not None},
    )
    return settings


def each(values: list[float], n: int) -> list[float]:
    """The numbers of an option that takes one or n, as n."""
    return values * n if len(values) == 1 else values


def _numbers(values: list[float] | None) -> float | list[float] | None:
    return values[0] if values is not None and len(values) == 1 else values
