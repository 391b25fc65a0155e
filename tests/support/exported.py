"""Exported C: compiled, loaded as a function of arrays, run; and states of a mechanism as its numbers."""

import ctypes
import shutil
import subprocess
from itertools import islice

import numpy as np
import pytest

from ccpin.programs import configuration, export
from ccpin.programs.c_export import parameters
from ccpin.programs.sine_cosine import PRECISIONS
from tests.support.closed import closed_near

STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-pedantic", "-Werror", "-ffp-contract=off")


def compiler(name="gcc"):
    """Its path; the test is skipped where there is none."""
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"there is no {name} here")
    return found


def self_tested(program, folder, format="double", name=None):
    """What the exported test says, compiled with every warning an error; it ends with 0."""
    _, test = export(program, folder, name=name, format=format)
    made = folder / f"{test.stem}_run"
    subprocess.run([compiler(), *STRICT, str(test), "-o", str(made), "-lm"], check=True)
    done = subprocess.run([str(made)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    return done.stdout


def exported(program, folder, format="double", name="exported"):
    """The exported function over rows of all inputs side by side: outputs side by side, and the status."""
    header, _ = export(program, folder, name=name, format=format)
    kind, sizes = PRECISIONS[format], [port.size for port in (*program.inputs, *program.outputs)]
    reads, gives = sum(sizes[: len(program.inputs)]), sum(sizes[len(program.inputs) :])
    starts = [sum(sizes[:k]) - (reads if k >= len(program.inputs) else 0) for k in range(len(sizes))]
    places = [
        f"{'x' if k < len(program.inputs) else 'out'} + {starts[k]}"
        for k in range(len(parameters(program, name)))
        if sizes[k]
    ]
    text = f"""#include "{header.name}"
void many(long n, const {kind.name} *x, {kind.name} *out, int *status);
void many(long n, const {kind.name} *x, {kind.name} *out, int *status)
{{
    for (long i = 0; i < n; i++, x += {reads}, out += {gives}) status[i] = {name}({", ".join(places)});
}}
"""
    source, library = folder / f"{name}_many.c", folder / f"{name}_many.so"
    source.write_text(text)
    subprocess.run([compiler(), *STRICT, "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True)
    many = ctypes.CDLL(str(library)).many
    many.restype = None

    def run(rows):
        given = np.ascontiguousarray(rows, dtype=kind.type)
        out, status = np.empty((len(given), gives), dtype=kind.type), np.empty(len(given), dtype=np.int32)
        many(ctypes.c_long(len(given)), *(ctypes.c_void_p(a.ctypes.data) for a in (given, out, status)))
        return out, status

    return run


def closed_states(model, count, seed=0, spread=0.15):
    """Closed states near the reference, with q and y of each side by side, of shape (count, q and y)."""
    states = list(islice(closed_near(model, np.random.default_rng(seed), spread), count))
    return states, np.array([np.concatenate([*configuration(state).values()]) for state in states])
