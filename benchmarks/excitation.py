"""Motions that `excitation` finds, beside random Fourier motions: `python -m benchmarks.excitation [MODEL …]`.

Both are within the same box and speeds, over the same time. Told: the condition number of W and the trace of (WᵀW)⁻¹
along the motion found, the share of its limits that it takes, and of so many random sums of five harmonics, each made
as large as its limits let it be, the least condition and the least trace.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import ccpin
from ccpin.identification import excitation
from tests.support.random_motions import least_of_random

MODELS = {
    "rpdr": (0.35, 3.0), "four_bar": (0.4, 3.0), "docs/howto/ankle.urdf": (0.2, 2.0), "planar_3rrr": (0.2, 2.0),
    "stewart": (0.05, 0.3), "delta": (0.3, 3.0),
}  # fmt: skip
"""Half width of the box of q, and speed."""
DURATION = 5.0


def main(arguments: list[str] | None = None) -> None:
    """Print a model's lines each."""
    parser = argparse.ArgumentParser("python -m benchmarks.excitation", description=__doc__)
    parser.add_argument("models", nargs="*", default=list(MODELS), help="installed models' names, or files")
    parser.add_argument("--random", type=int, default=1000)
    parser.add_argument("--starts", type=int, default=200)
    parser.add_argument("--iterations", type=int, default=80)
    asked = parser.parse_args(arguments)
    for name in asked.models:
        told(name, asked.random, asked.starts, asked.iterations)


def told(name: str, count: int, starts: int, iterations: int) -> None:
    """Excite one mechanism both ways."""
    model = ccpin.ReducedModel(ccpin.load(name))
    half, speed = MODELS.get(name, (0.15, 2.0))
    middle = model.alpha(model.mechanism.q_reference)
    begin = time.perf_counter()
    found = excitation(
        model, DURATION, lower=middle - half, upper=middle + half, speed=speed, starts=starts, iterations=iterations
    )
    spent = time.perf_counter() - begin
    print(f"{Path(name).stem}: {found.told}; trace {found.trace:.3g}, share of limits {found.share:.3f}; {spent:.0f} s")
    condition, trace, left = least_of_random(model, found.effects, (middle, half, speed), DURATION, count)
    print(
        f"  of {count} random motions, {left} leave Ω: condition {condition:.3g}, trace {trace:.3g}",
        flush=True,
    )


if __name__ == "__main__":
    main()
