"""Programs in lanes beside the compiled core: `python -m benchmarks.program_agreement [MODEL …]`.

q̈, u, D, C, g, ρ and σ at random closed states about the reference, where y is given 1e-6 from σ(q): the largest
difference of a state's entries over the largest of them, and that over the condition number of ψ_q′, times that of D
where it is divided by. (The largest is no less than the median state's; of σ than 1, and of forces than a thousandth of
D's, at q̇ and q̈ of about 1.) States whose ψ_q′ has a reciprocal condition number below 1e-3 are told apart. Where the
difference is largest both are held against the same arithmetic in 200 bits (python-flint). `--slopes`: derivatives of q̈
in lanes beside the core's, complex steps, CasADi's, JAX's and PyTorch's.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import ccpin
from tests.support.lanes_and_core import NAMED, SINGULAR, STATES, compared, drawn, slopes, states


def told(name: str, model: ccpin.ReducedModel, count: int, sloped: bool) -> None:
    """Print one model's lines."""
    held = states(model, count)
    singular, least = held.kappa * SINGULAR > 1.0, 1.0 / held.kappa.max()
    differences, refused = compared(model, held)
    print(
        f"{name}: {count} states within ±{held.spread:g}, rcond ≥ {least:.1e}, {singular.sum()} below 1e-3; "
        f"{refused} refused"
    )
    for each in differences:
        exact = (
            "" if each.exact is None else f"   there, from exact: lanes {each.exact[0]:.0e}, core {each.exact[1]:.0e}"
        )
        apart = f"   below 1e-3: {each.apart:.0e}" if singular.any() else ""
        print(f"  {each.name:17s}{each.largest:9.1e}   over cond {each.over:8.1e}{exact}{apart}", flush=True)
    if sloped:
        print(
            "  slopes beside the lanes', over cond: "
            + ", ".join(f"{who} {off:.0e}" for who, off in slopes(model, held).items())
        )


def main(arguments: list[str] | None = None) -> None:
    """Print all."""
    parser = argparse.ArgumentParser("python -m benchmarks.program_agreement", description=__doc__)
    parser.add_argument("models", nargs="*", default=list(NAMED), help="installed models' names, or files")
    parser.add_argument("--states", type=int, default=STATES)
    parser.add_argument(
        "--random", type=int, default=0, metavar="K", help="also K random mechanisms, as many states in all"
    )
    parser.add_argument("--slopes", action="store_true")
    asked = parser.parse_args(arguments)
    for name in asked.models:
        told(Path(name).stem, ccpin.ReducedModel(ccpin.load(name)), asked.states, asked.slopes)
    for k, model in enumerate(drawn(asked.random) if asked.random else ()):
        told(f"random {k}", model, max(1, asked.states // asked.random), asked.slopes)


if __name__ == "__main__":
    main()
