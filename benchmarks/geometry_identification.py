"""``python -m benchmarks.geometry_identification [LINKAGE …]``: do confidence intervals of identified geometries hold?

Of each linkage many true geometries are drawn about the file's, 40 pairs of each are computed in closed form and get
errors of 0.02° on both sides, and the geometry is identified from the file's. Of the 95 % intervals 95 % are to hold
the true number: over 1,000 runs, pooled over numbers, 93 to 97 % (numbers of one run are not independent; the share of
one number has a standard deviation of 0.7 %). Beside it CPU time a run, and per number its share, the mean error in
standard deviations (0, of deviation 0.03), and the standard deviation predicted.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from tests.support.measured_pairs import INSIDE, LINKAGES, simulated


def main() -> None:
    """Print a table a linkage."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("linkages", nargs="*", metavar="LINKAGE", default=list(LINKAGES), help=", ".join(LINKAGES))
    parser.add_argument("--runs", type=int, default=1000)
    asked = parser.parse_args()
    for name in asked.linkages:
        linkage, start = LINKAGES[name](), time.process_time()
        errors, deviations, misfits = map(np.array, zip(*simulated(linkage, asked.runs), strict=True))
        spent, held = (time.process_time() - start) / asked.runs, np.abs(errors) < INSIDE
        print(
            f"{name}: {100 * held.mean():.2f} % of {held.size} intervals hold the true number; "
            f"misfit {misfits.mean():.3f}; {1e3 * spent:.0f} ms of CPU a run"
        )
        rows = zip(linkage.numbers, held.mean(axis=0), errors.mean(axis=0), deviations.mean(axis=0), strict=True)
        for number, share, mean, deviation in rows:
            print(f"  {number:26} {100 * share:5.1f} %  mean {mean:+.2f}  ± {deviation:.2e}")


if __name__ == "__main__":
    main()
