"""Exported C beside Pinocchio's constraintDynamics: `python -m benchmarks.exported [MODEL …]`.

For each mechanism: CPU seconds that gcc -O2 takes and bytes of code, nanoseconds of q̈ of one state with q′ known (32
states in turn), with σ found by two Newton steps, and their ratios to Pinocchio in one run. Pinocchio has the rods'
idle spins free, as it has no closure that holds them.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np

import ccpin
from benchmarks.firmware import ANKLE, arguments, states
from benchmarks.peers.pinocchio import Pinocchio
from benchmarks.subjects import place
from benchmarks.timing import in_turn
from ccpin import programs

MODELS = ("rpdr", "planar_3rrr", str(ANKLE), "delta", "stewart")
FLAGS = ("-std=c99", "-O2", "-ffp-contract=off")
CALLS, ROUNDS = 2400, 15  # a timed call of C, rounds
MAIN = """#include "{name}.h"
double many(long n, const double (*x)[{reads}]);
double many(long n, const double (*x)[{reads}])
{{
    double total = 0, out[{gives}];
    for (long i = 0; i < n; i++) {{
        const double *const in = x[i % {rows}];
        total += {name}({places});
        for (int k = 0; k < {gives}; k++) total += out[k];
    }}
    return total;
}}
"""


def compiled(program: programs.Program, folder: Path, name: str) -> tuple[Callable[[], object], float, int]:
    """A call of `CALLS` states, CPU seconds of compilation and bytes of code."""
    reads, gives = (sum(port.size for port in ports) for ports in (program.inputs, program.outputs))
    places = ", ".join(arguments(program, "in", "out"))
    rows = np.ascontiguousarray(states(program))
    programs.export(program, folder, name=name)
    told = {"name": name, "reads": reads, "gives": gives, "rows": len(rows), "places": places}
    (folder / f"{name}.c").write_text(MAIN.format(**told))
    began = sum(os.times()[2:4])
    subprocess.run(["gcc", *FLAGS, "-fPIC", "-c", f"{name}.c"], check=True, cwd=folder)
    seconds = sum(os.times()[2:4]) - began
    said = subprocess.run(["size", f"{name}.o"], check=True, cwd=folder, capture_output=True, text=True)
    subprocess.run(["gcc", "-shared", f"{name}.o", "-o", f"{name}.so", "-lm"], check=True, cwd=folder)
    many = ctypes.CDLL(str(folder / f"{name}.so")).many
    many.restype = ctypes.c_double
    return lambda: many(ctypes.c_long(CALLS), ctypes.c_void_p(rows.ctypes.data)), seconds, int(said.stdout.split()[6])


def main(models: list[str]) -> None:
    """A table."""
    print("mechanism       compile s      bytes            ns             over constraintDynamics")
    print("                q′      σ      q′      σ        q′     σ       q′     σ      of (µs)")
    for model in models:
        reduced = ccpin.ReducedModel(ccpin.load(model))
        free = ccpin.ReducedModel(ccpin.load(model, free=["all"]))
        peer = Pinocchio(free.mechanism, place(free))
        with tempfile.TemporaryDirectory() as made:
            calls, costs = {"peer": peer.acceleration}, []
            for given in ("closed", "near"):
                program = programs.record(reduced, "forward_dynamics", given=given)
                calls[given], *cost = compiled(program, Path(made), f"p_{given}")
                costs.append(cost)
            times = in_turn(calls, ROUNDS, 5e-3)
            each = [times[given].seconds / CALLS * 1e9 for given in ("closed", "near")]
            over = [times[given].ratio(times["peer"]) / CALLS for given in ("closed", "near")]
        seconds, size = zip(*costs, strict=True)
        print(
            f"{reduced.mechanism.name:<14}  {seconds[0]:<6.2f}  {seconds[1]:<5.2f}  {size[0]:<6}  {size[1]:<7}"
            f"  {each[0]:<5.0f}  {each[1]:<6.0f}  {over[0]:<5.3f}  {over[1]:<5.3f}  {times['peer'].seconds * 1e6:.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:] or list(MODELS))
