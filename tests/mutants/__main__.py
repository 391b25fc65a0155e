"""Which changes to what theorems rest on no test would notice: ``python -m tests.mutants [--only proof/newton]``."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import Counter

os.environ["CCPIN_BACKEND"] = "numpy"  # before ccpin is imported: the compiled core would hide what is changed here
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.mutants.running import outcomes_of
from tests.mutants.table import ROOMS, mutants_of


def main(arguments: list[str]) -> int:
    """Run the table and list what survives; 1 where something does, 2 where tests fail with nothing changed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("--only", default="", help="modules whose name contains this")
    parser.add_argument("--processes", type=int, default=2)
    options = parser.parse_args(arguments)
    begun, counts = time.monotonic(), Counter[str]()
    for room in ROOMS:
        if options.only not in room.module:
            continue
        mutants = list(mutants_of(room))
        tried = [mutant.change for mutant in mutants if not mutant.reason]
        same, *found = outcomes_of(room.module, [None, *tried], room.tests, options.processes)
        if same != "survives":
            _say(f"{room.module}: its tests fail with nothing changed")
            return 2
        for change, outcome in zip(tried, found, strict=True):
            if outcome == "survives":
                _say(f"{room.module}:{change.line} {change.place}: {change.what}\n    {change.text}")
        counts.update(found)
        counts["all"] += len(mutants)
        counts["sharpness only"] += len(mutants) - len(tried)
    _say(
        f"{counts['all']} mutants: {counts['killed'] + counts['too long']} killed ({counts['too long']} by time), "
        f"{counts['sharpness only']} sharpness only, {counts['survives']} survive; {time.monotonic() - begun:.0f} s"
    )
    return int(counts["survives"] > 0)


def _say(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
