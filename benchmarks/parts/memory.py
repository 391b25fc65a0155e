"""Memory: the highest resident size of a process that loads a model and computes q̈ once, less that of the imports.

Each figure is a process of its own, on Linux: what a process has once taken it does not give back.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measured import NATIVE, Measured, Options, short_name
from benchmarks.subjects import backends, loaded
from ccpin.native import VARIABLE

PART, PEAK, IMPORTS = "memory", "peak, over the imports'", "imports alone"
BEGIN = (
    "import resource, ccpin, numpy as np, pinocchio; from tests.support.families import serial; ccpin.ReducedModel; "
)
WORK = (
    "model = ccpin.ReducedModel(ccpin.load({source})); state = model.at(model.alpha(model.mechanism.q_reference)); "
    "state.forward_dynamics(np.zeros(model.n), np.zeros(model.n_actuated)); "
)
END = "print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))"
"""In kB; `getrusage` would count the parent from before the new program began."""


def measure(options: Options) -> Iterator[Measured]:
    """Megabytes of each model on each backend, and of a long chain on the compiled core."""
    if not Path("/proc/self/status").exists():
        yield Measured(PART, "ccpin and its libraries", IMPORTS, "either", None, "MB", note="measured on Linux only")
        return
    nothing = peak("", NATIVE if NATIVE in backends() else "numpy")
    yield Measured(PART, "ccpin and its libraries", IMPORTS, "either", nothing, "MB")
    for name in options.models:
        if loaded(name) is not None:
            for who in backends():
                used = peak(WORK.format(source=repr(name)), who) - nothing
                yield Measured(PART, short_name(name), PEAK, who, used, "MB")
    for size in options.sizes[-1:]:
        if NATIVE in backends():
            used = peak(WORK.format(source=f"serial({size})"), NATIVE) - nothing
            yield Measured(PART, f"serial, {3 * size} joints", PEAK, NATIVE, used, "MB")


def peak(work: str, who: str) -> float:
    """The highest resident size, in MB, of a new process that does some work on a backend."""
    environment = os.environ | {VARIABLE: who}
    command = [sys.executable, "-c", BEGIN + work + END]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(run.stdout) / 1024.0
