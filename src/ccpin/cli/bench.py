"""The options of `ccpin simulate` that make the simulated bench a real one: friction and the sampled loop."""

from __future__ import annotations

import argparse
from typing import Any

from ccpin.control.sampling import Sampling
from ccpin.errors import InvalidInputError


def add_bench(parser: argparse.ArgumentParser) -> None:
    """Friction, sampling, encoders, filter, saturation and delay; each off by default."""
    bench = parser.add_argument_group("the bench as it is", "each off by default")
    bench.add_argument("--friction-coulomb", nargs="+", type=float, metavar="F", help="N m or N, one or n")
    bench.add_argument("--friction-viscous", nargs="+", type=float, metavar="B", help="N m s/rad or N s/m, one or n")
    bench.add_argument("--sample-rate", type=float, metavar="HZ", help="run the law as a sampled loop")
    bench.add_argument("--encoder-counts", nargs="+", type=float, metavar="N", help="counts per turn (or metre)")
    bench.add_argument("--velocity-cutoff-hz", type=float, metavar="HZ", help="low-pass filter of the velocity")
    bench.add_argument("--saturation", nargs="+", type=float, metavar="U", help="largest effort, one or one a motor")
    bench.add_argument("--delay-samples", type=int, default=0, metavar="K", help="samples from encoder to effort")


def bench_settings(options: argparse.Namespace, n: int) -> dict[str, Any]:
    """The `friction` and `sampling` arguments of `simulate`.

    Raises:
        InvalidInputError: An option of the sampled loop without --sample-rate, or a rate that is not positive.
    """
    settings: dict[str, Any] = {}
    if options.friction_coulomb is not None or options.friction_viscous is not None:
        settings["friction"] = (_each(options.friction_coulomb, n), _each(options.friction_viscous, n))
    sampled = {
        "encoder_counts": _numbers(options.encoder_counts),
        "velocity_cutoff": options.velocity_cutoff_hz,
        "saturation": _numbers(options.saturation),
    }
    if options.sample_rate is None:
        if options.delay_samples or any(value is not None for value in sampled.values()):
            raise InvalidInputError("encoders, velocity filter, saturation and delay belong to --sample-rate")
        return settings
    if not options.sample_rate > 0:
        raise InvalidInputError(f"--sample-rate {options.sample_rate} must be positive")
    settings["sampling"] = Sampling(1.0 / options.sample_rate, delay=options.delay_samples, **sampled)
    return settings


def _each(values: list[float] | None, n: int) -> list[float]:
    """One number for each independent coordinate (0 where none is given)."""
    values = [0.0] if values is None else values
    return values * n if len(values) == 1 else values


def _numbers(values: list[float] | None) -> float | list[float] | None:
    return values[0] if values is not None and len(values) == 1 else values
