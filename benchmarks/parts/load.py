"""Loading: a file read, checked, closed and analysed (families' loads are in `families`), and the import before it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator

import ccpin
from benchmarks.measured import Measured, Options, short_name
from benchmarks.subjects import loaded
from benchmarks.timing import in_turn
from tests.support.families import walker

PART, LOAD, IMPORT = "load", "load", "import ccpin and its first name"
ROUNDS, LEGS = 5, 14  # at most; a walker of as many legs, whose clusters are loaded one by one
WALKERS = {f"walker of {LEGS} legs": walker(LEGS), f"walker of {LEGS} legs, limits": walker(LEGS, limit=0.5)}
IMPORTS = (
    "import time; began = time.process_time(); import ccpin; ccpin.ReducedModel; print(time.process_time() - began)"
)


def measure(options: Options) -> Iterator[Measured]:
    """CPU seconds."""
    run = subprocess.run([sys.executable, "-c", IMPORTS], capture_output=True, text=True, check=True)
    yield Measured(PART, "a new process", IMPORT, "ccpin", float(run.stdout))
    calls = {name: lambda n=name: ccpin.load(n) for name in options.models if loaded(name) is not None}
    if options.deep:
        calls |= {name: lambda w=walker: ccpin.load(w) for name, walker in WALKERS.items()}
    for name, timing in in_turn(calls, min(ROUNDS, options.rounds), 0.0).items():
        yield Measured(PART, short_name(name), LOAD, "ccpin", timing.seconds)
