"""How many calls and files of ccpin's own four walks pass: a load, the terms at one state on either backend, a box.

Python calls are counted by `sys.setprofile`; a generator counts each time it is resumed. What each walk needs is
imported by a first, uncounted walk, so that imports do not count. The file with the most calls is named.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

import numpy as np

import ccpin
from benchmarks.measured import Measured, Options
from benchmarks.subjects import models_of

PART, CALLS, FILES = "walks", "Python calls", "files"
SOURCE = Path(ccpin.__file__).resolve().parent
Q, V = np.array([-2.0, -1.4]), np.array([0.5, -0.3])
REGION = ((-2.01, -1.7), (-1.7, -1.39))  # lower, upper


def measure(options: Options) -> Iterator[Measured]:
    """Calls and files of each walk."""
    rpdr = ccpin.load("rpdr")
    walks: dict[tuple[str, str], Callable[[], object]] = {
        ("load('rpdr')", "ccpin"): lambda: ccpin.load("rpdr"),
        ("certify a box", "ccpin"): lambda: ccpin.domain.certify(rpdr, Q, REGION, max_depth=0),
    }
    for who, model in models_of(rpdr).items():
        walks["at(q).terms(v)", who] = lambda m=model: m.at(Q).terms(V)
    for (subject, who), walk in walks.items():
        counts = calls_by_file(walk)
        file, most = counts.most_common(1)[0]
        yield Measured(PART, subject, CALLS, who, counts.total(), "", note=f"most in {file}: {most}")
        yield Measured(PART, subject, FILES, who, len(counts), "")


def calls_by_file(walk: Callable[[], object]) -> Counter[str]:
    """The calls of functions written in src/ccpin that a walk makes, by file."""
    walk()
    counts: Counter[str] = Counter()
    files = {str(path): str(path.relative_to(SOURCE)) for path in SOURCE.rglob("*.py")}

    def count(frame: FrameType, event: str, _: object) -> None:
        if event == "call" and frame.f_code.co_filename in files:
            counts[files[frame.f_code.co_filename]] += 1

    before = sys.getprofile()
    sys.setprofile(count)
    try:
        walk()
    finally:
        sys.setprofile(before)
    return counts
