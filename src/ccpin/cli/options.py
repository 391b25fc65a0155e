"""The options commands share: the mechanism, vectors with their twins in degrees, and the bench as it is."""

from __future__ import annotations

import argparse
import sys
from typing import Any, get_args

import numpy as np
import shtab

from ccpin.arrays import Array
from ccpin.cli.command import MECHANISM, complete, index, nonnegative, positive
from ccpin.cli.progress import busy
from ccpin.control.sampling import Sampling
from ccpin.description import FORMATS, read_description
from ccpin.description.model import MechanismDescription
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.errors import InvalidInputError
from ccpin.mechanism.loading.loader import load as load_mechanism
from ccpin.mechanism.mechanism import Mechanism
from ccpin.simulation.plant.limits import Effort, Limits, Position, Velocity
from ccpin.simulation.plant.motors import MotorModel

_WISHES = ("independent", "actuated", "locked", "free", "geometry_tolerance", "floating_base")
_READING = ("format", "model", "include_root", "xacro")
"""What `ccpin.load` and `read_description` call as the options are called."""
_TURN, _DEGREES = 2 * np.pi, 720.0
"""An angle larger than the one and no larger than the other may be one in degrees."""
_SAMPLED = (
    *("encoder_counts", "velocity_cutoff_hz", "saturation", "delay_samples", "encoder_noise"),
    *("motor_lag", "motor_rate"),
)
"""What means something in a sampled loop only."""


def add_mechanism(parser: argparse.ArgumentParser, optional: bool = False) -> None:
    """The mechanism and what overrides its file."""
    what = "a file (URDF with loops, SDF, robot.yaml, MJCF) or an installed model's name"
    complete(parser.add_argument("mechanism", help=what, nargs="?" if optional else None), MECHANISM)
    parser.add_argument("--independent", nargs="+", metavar="JOINT", help="independent joints, in the order of q")
    parser.add_argument("--actuated", nargs="+", metavar="JOINT", help="actuated joints, in the order of u")
    still = "joints, or components as ball:rx, to hold still at the reference"
    parser.add_argument("--locked", nargs="+", metavar="JOINT", default=(), help=still)
    idle = "spins that move nothing but themselves (a rod between balls) to leave free, or all"
    parser.add_argument("--free", nargs="+", metavar="JOINT", default=(), help=idle)
    near = "the pose to close near: one of the file's by name, or joint=value … in rad and m"
    parser.add_argument("--reference", nargs="+", metavar="POSE", help=near)
    wide = "error of the file's lengths and angles, relative to a loop's size (default 1e-5)"
    parser.add_argument("--geometry-tolerance", type=nonnegative, metavar="PART", help=wide)
    parser.add_argument("--floating-base", action="store_true", help="free the root link")
    parser.add_argument("--format", choices=tuple(FORMATS), help="instead of telling it from the content")
    parser.add_argument("--model", metavar="NAME", help="which model of an SDF file, where it holds several")
    below = "folder an SDF or MJCF file may include from (its own)"
    complete(parser.add_argument("--include-root", metavar="DIR", help=below), shtab.DIRECTORY)
    parser.add_argument("--xacro", action="store_true", help="expand xacro, a program, in a file of another name too")
    parser.add_argument("--xacro-arg", nargs="+", metavar="NAME:=VALUE", default=[], help="arguments of a xacro file")
    parser.add_argument("--json", action="store_true", help="print machine-readable JSON (SI units, radians)")


def load(options: argparse.Namespace) -> Mechanism:
    """The mechanism the options name."""
    with busy(options.json, f"loading {options.mechanism}"):
        return load_mechanism(options.mechanism, **wishes(options), **_reading(options))


def described(options: argparse.Namespace) -> MechanismDescription:
    """What the file says, before anything is assembled."""
    return read_description(options.mechanism, **_reading(options))


def wishes(options: argparse.Namespace) -> dict[str, Any]:
    """What the options say of joints and pose, as `ccpin.load` takes it."""
    stated = {name: value for name in _WISHES if (value := getattr(options, name)) is not None}
    return {"reference": _pose(options.reference), **stated}


def mechanism_words(options: argparse.Namespace) -> list[str]:
    """The mechanism and what overrides its file, as they are written on a command line."""
    words = [options.mechanism]
    for name in ("reference", *_WISHES, *_READING, "xacro_arg"):
        value = getattr(options, name)
        if value is True:
            words.append(_spelt(name))
        elif value not in (None, False, (), []):
            words += [_spelt(name), *(value if isinstance(value, list) else [str(value)])]
    return words


def _reading(options: argparse.Namespace) -> dict[str, Any]:
    stated = {name: value for name in _READING if (value := getattr(options, name)) is not None}
    return {"xacro_arguments": _xacro_arguments(options.xacro_arg), **stated}


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


def vector(options: argparse.Namespace, name: str, mechanism: Mechanism, scalar: bool = False) -> Array | None:
    """A vector option in SI units, from whichever of its two spellings was used; ``None`` where neither was.

    It has one number a velocity where `scalar` says so, else as many as q has.

    Raises:
        InvalidInputError: There are too few or too many numbers, or degrees are given where an independent coordinate
            is no plain angle.
    """
    plain, degrees = getattr(options, name), getattr(options, f"{name}_deg")
    if degrees is None:
        if plain is not None:
            wanted = mechanism.n if scalar else mechanism.parametrization().coordinates.nq
            _counted(f"--{name}", plain, wanted, mechanism)
            _hint_at_degrees(options, name, plain, mechanism)
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
    _counted(f"--{name}-deg", degrees, mechanism.n, mechanism)
    return np.asarray(np.radians(degrees), dtype=np.float64)


def region(options: argparse.Namespace, mechanism: Mechanism) -> tuple[Array, Array] | None:
    """The corners of a region of q, of --lower and --upper; ``None`` where there is none.

    Raises:
        InvalidInputError: There is one alone.
    """
    lower, upper = (vector(options, name, mechanism, scalar=True) for name in ("lower", "upper"))
    if (lower is None) != (upper is None):
        raise InvalidInputError("a region needs both its corners, --lower and --upper (or --lower-deg and --upper-deg)")
    return None if lower is None or upper is None else (lower, upper)


def _hint_at_degrees(options: argparse.Namespace, name: str, values: list[float], mechanism: Mechanism) -> None:
    """Say that angles beyond a turn look like degrees: a note, as a joint may turn often.

    Raises:
        InvalidInputError: As radians they are outside the joints' limits, as degrees within them.
    """
    joints = [mechanism.tree.joint(mechanism.tree.split(each)[0]) for each in mechanism.independent]
    if len(values) != len(joints) or not all(joint.kind.angle for joint in joints):
        return
    if not _TURN < max(map(abs, values)) <= _DEGREES:
        return
    written = " ".join(f"{value:g}" for value in values)
    told = f"--{name} {written} is in radians: did you mean degrees, --{name}-deg {written}?"
    lower, upper = (limits[[joint.q.start for joint in joints]] for limits in mechanism.position_limits)
    as_radians, as_degrees = ((lower <= q) & (q <= upper) for q in (np.array(values), np.radians(values)))
    if as_degrees.all() and not as_radians.all():
        raise InvalidInputError(f"{told} In radians it is outside the joint limits")
    print(f"ccpin: note: {told}", file=sys.stderr)


def _counted(option: str, values: list[float], wanted: int, mechanism: Mechanism) -> None:
    if len(values) != wanted:
        what = f"takes {wanted} number{'s' if wanted != 1 else ''}, of {', '.join(mechanism.independent)}"
        raise InvalidInputError(f"{option} {what}, not {len(values)}")


def add_bench(parser: argparse.ArgumentParser) -> None:
    """What makes a simulated bench a real one: friction, sampling, encoders, filter, delay, limits, motors."""
    bench = parser.add_argument_group("the bench as it is", "each off by default but the motors' limits of effort")
    bench.add_argument(
        "--friction-coulomb",
        nargs="+",
        type=nonnegative,
        metavar="F",
        help="level, N m or N: one for each independent joint, or one for all of them (default: what the file states)",
    )
    bench.add_argument(
        "--friction-viscous", nargs="+", type=nonnegative, metavar="B", help="N m s/rad or N s/m, of the same joints"
    )
    bench.add_argument("--sample-rate", type=positive, metavar="HZ", help="run the law as a sampled loop")
    bench.add_argument("--encoder-counts", nargs="+", type=positive, metavar="N", help="counts per turn (or metre)")
    bench.add_argument("--velocity-cutoff-hz", type=positive, metavar="HZ", help="low-pass filter of the velocity")
    bench.add_argument("--saturation", nargs="+", type=positive, metavar="U", help="largest effort, one or one a motor")
    bench.add_argument("--delay-samples", type=index, default=0, metavar="K", help="samples from encoder to effort")
    bench.add_argument("--encoder-noise", nargs="+", type=nonnegative, metavar="S", help="standard deviation, rad or m")
    bench.add_argument("--seed", type=index, default=0, metavar="N", help="of the noise")
    for name, words in (("position", Position), ("velocity", Velocity), ("effort", Effort)):
        usual = getattr(Limits(), name)
        bench.add_argument(f"--{name}-limits", choices=get_args(words), default=usual, help=f"default {usual}")
    bench.add_argument(
        "--motor-lag", type=nonnegative, default=0.0, metavar="S", help="time constant of the current loops"
    )
    bench.add_argument(
        "--motor-rate", type=positive, default=np.inf, metavar="R", help="fastest change of an effort a second"
    )


def bench_settings(options: argparse.Namespace, model: ReducedModel) -> dict[str, Any]:
    """The `friction`, `sampling`, `limits` and `motors` arguments of `simulate`.

    Raises:
        InvalidInputError: An option of the sampled loop without --sample-rate, or one of a wrong length.
    """
    settings: dict[str, Any] = {
        "limits": Limits(options.position_limits, options.velocity_limits, options.effort_limits),
        "motors": MotorModel(lag=options.motor_lag, rate=options.motor_rate),
    }
    levels = [each(options, name, model.n) for name in ("friction_coulomb", "friction_viscous")]
    if any(level is not None for level in levels):
        settings["friction"] = tuple((0.0,) * model.n if level is None else level for level in levels)
    if options.sample_rate is None:
        wanted = [_spelt(name) for name in _SAMPLED if getattr(options, name) not in (None, 0, 0.0, np.inf)]
        if wanted:
            raise InvalidInputError(f"{', '.join(wanted)}: needs a sampled loop; give its --sample-rate too")
        return settings
    settings["sampling"] = Sampling(
        1.0 / options.sample_rate,
        encoder_counts=each(options, "encoder_counts", model.n),
        velocity_cutoff=options.velocity_cutoff_hz,
        saturation=each(options, "saturation", model.n_actuated),
        delay=options.delay_samples,
        encoder_noise=each(options, "encoder_noise", model.n) or 0.0,
        seed=options.seed,
    )
    return settings


def each(options: argparse.Namespace, name: str, n: int) -> tuple[float, ...] | None:
    """The numbers of an option that takes one or n, as n; ``None`` where it was not used.

    Raises:
        InvalidInputError: There are others than one or n.
    """
    values: list[float] | None = getattr(options, name)
    if values is None:
        return None
    if len(values) not in (1, n):
        raise InvalidInputError(f"{_spelt(name)} takes one number or {n}, not {len(values)}")
    return tuple(values if len(values) == n else values * n)


def _spelt(name: str) -> str:
    return f"--{name.replace('_', '-')}"
