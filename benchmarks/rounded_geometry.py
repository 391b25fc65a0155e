"""What becomes of mechanisms whose files are rounded: mobility, closure, σ and dynamics against the exact geometry.

Run from the project's root: ``python -m benchmarks.rounded_geometry [files]``. Every mechanism is turned as a whole
by a random rotation and its positions, angles, axes and lengths are rounded to 4, 5, 6 and 8 decimals.

σ, D and q̈ are compared with those of the exact mechanism at poses all along its motion; "σ" is the part of the poses
reached.
"""

import argparse
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

import ccpin
from tests.support import families
from tests.support.rounded import poses_along, rounded

MODELS = sorted(path.stem for path in (Path(__file__).parents[1] / "models").glob("*.urdf"))
BUILT = ("parallel_bars", "welded_four_bar", "spherical_four_bar", "revolute_delta")
DECIMALS = (4, 5, 6, 8)  # of a file's lengths (m) and angles (rad)


class Comparison(NamedTuple):
    """Largest differences from the exact mechanism over poses: closure, σ (rad or m), D and q̈ (relative)."""

    reached: float
    closure: float
    sigma: float
    inertia: float
    acceleration: float


def compare(exact: ccpin.Mechanism, tried: ccpin.Mechanism, count: int = 12) -> Comparison:
    """Two mechanisms of the same independent joints, at poses of the first."""
    one, other = ccpin.ReducedModel(exact), ccpin.ReducedModel(tried)
    generator = np.random.default_rng(1)
    found, poses = [], poses_along(exact, count)
    for pose in poses:
        here = one.at(one.coordinates.alpha(pose), near=pose)
        v, u = generator.standard_normal(exact.n), generator.standard_normal(one.n_actuated)
        try:
            there = other.at(here.q, near=pose)
        except ccpin.CcpinError:
            continue
        inertia, a = here.terms(v).D, here.forward_dynamics(v, u)
        found.append(
            (
                np.abs(tried.constraints().residual(there.q_free)).max(),
                np.abs(there.q_free - here.q_free).max(),
                np.abs(there.terms(v).D - inertia).max() / np.abs(inertia).max(),
                np.abs(there.forward_dynamics(v, u) - a).max() / np.abs(a).max(),
            )
        )
    worst = np.max(found, axis=0) if found else np.full(4, np.nan)
    return Comparison(len(found) / len(poses), *(float(x) for x in worst))


def main(paths: list[str]) -> None:
    """Print one line a mechanism and number of decimals."""
    print(
        f"{'mechanism':20}{'dec':>4}{'n':>4}{'misfit':>9}{'change':>9}{'σ':>6}{'closure':>9}{'Δσ':>9}{'ΔD':>9}{'Δq̈':>9}"
    )
    for what in paths or [*MODELS, *BUILT]:
        exact = ccpin.load(getattr(families, what)() if what in BUILT else what)
        name = Path(what).parent.name if Path(what).name.startswith("robot.") else Path(what).stem
        for decimals in DECIMALS:
            print(f"{name:20}{decimals:4}", end="")
            try:
                tried = ccpin.load(rounded(exact.description, decimals), independent=exact.independent)
            except ccpin.CcpinError as error:
                print(f"    {error}")
                continue
            told = " ".join(note for note in tried.notes if note.startswith("geometry repaired"))
            misfit, change = (re.search(rf"{word} (\S+)", told) for word in ("up to", "largest change is"))
            marks = "".join(f"{found[1] if found else '–':>9}" for found in (misfit, change))
            c = compare(exact, tried)
            rest = "".join(f"{x:9.0e}" for x in (c.closure, c.sigma, c.inertia, c.acceleration))
            print(f"{tried.n:4}{marks}{c.reached:6.0%}{rest}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("paths", nargs="*")
    main(parser.parse_args().paths)
