"""How many calls and files of ccpin's own three walks pass: a load, the terms at one state, a certified box.

Python calls are counted by `sys.setprofile`; a generator counts each time it is resumed. What each walk needs is
imported by a first, uncounted walk, so that imports do not count. To count in another tree, put its src on PYTHONPATH.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

import ccpin

SOURCE = Path(ccpin.__file__).resolve().parent
Q, V = (-2.0, -1.4), (0.5, -0.3)
REGION = ((-2.01, -1.7), (-1.7, -1.39))  # symmetric: the same box as (lower, upper) and as rows of (lower, upper)


def calls_by_file(walk: Callable[[], object]) -> Counter[str]:
    """The calls of functions written in src/ccpin that a walk makes, by file."""
    walk()
    counts: Counter[str] = Counter()
    files = {str(path): str(path.relative_to(SOURCE)) for path in SOURCE.rglob("*.py")}

    def count(frame: object, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename in files:
            counts[files[frame.f_code.co_filename]] += 1

    sys.setprofile(count)
    try:
        walk()
    finally:
        sys.setprofile(None)
    return counts


def terms(model: ccpin.ReducedModel) -> object:
    """D, C and g at one state, through a State where the tree has it."""
    q, v = np.array(Q), np.array(V)
    return model.at(q).terms(v) if hasattr(model, "at") else model.terms(q, v)


def main(path: str = "rpdr", rows: int = 12) -> None:
    """Print calls and files of each walk, and the files with the most calls."""
    rpdr = ccpin.load("rpdr")
    model = ccpin.ReducedModel(rpdr)
    walks: dict[str, Callable[[], object]] = {
        f"load({path!r})": lambda: ccpin.load(path),
        "at(q).terms(v)": lambda: terms(model),
        "certify a box": lambda: ccpin.domain.certify(rpdr, np.array(Q), np.array(REGION), max_depth=0),
    }
    print(f"{'walk':24}{'calls':>9}{'files':>7}")
    for name, walk in walks.items():
        counts = calls_by_file(walk)
        print(f"{name:24}{counts.total():9}{len(counts):7}")
        for file, calls in counts.most_common(rows):
            print(f"  {file:40}{calls:9}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("path", nargs="?", default="rpdr", help="what to load in the first walk")
    parser.add_argument("--rows", type=int, default=12, help="how many files to list for each walk")
    options = parser.parse_args()
    main(options.path, options.rows)
