"""Time to load families of mechanisms, and the exponent in the number of joints that fits it.

Run from the project's root: ``python -m benchmarks.load_cost``. CPU seconds, the least of several loads; the exponent
is fitted to the sizes from 24 joints on.
"""

import argparse
import time

import numpy as np

import ccpin
from ccpin.description import MechanismDescription
from tests.support.families import parallel, serial, walker

SIZES = (1, 2, 4, 8, 16, 32, 64, 133)


def seconds(description: MechanismDescription, loads: int) -> float:
    """The least CPU time of several loads."""
    times = []
    for _ in range(loads):
        start = time.process_time()
        ccpin.load(description)
        times.append(time.process_time() - start)
    return min(times)


def main(loads: int = 3) -> None:
    """Print one line a mechanism and one exponent a family."""
    print(f"{'mechanism':14}{'joints':>8}{'load, s':>10}")
    for family in (serial, parallel):
        joints, times = np.array([3 * n for n in SIZES]), []
        for n in SIZES:
            description = family(n)
            times.append(seconds(description, loads))
            print(f"{description.name:14}{len(description.joints):8}{times[-1]:10.4f}")
        large = joints >= 24
        exponent = np.polyfit(np.log(joints[large]), np.log(np.array(times)[large]), 1)[0]
        print(f"{family.__name__}: exponent {exponent:.2f}")
    for description in (walker(14), walker(14, limit=0.5)):
        print(f"{description.name:14}{len(description.joints):8}{seconds(description, loads):10.4f}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--loads", type=int, default=3)
    main(parser.parse_args().loads)
