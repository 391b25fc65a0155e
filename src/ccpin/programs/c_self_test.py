"""A file that tests an exported header: closed states, and what was computed of them here."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ccpin.arrays import Array
from ccpin.programs.c_code import literal
from ccpin.programs.c_export import parameters
from ccpin.programs.program import Program, windows
from ccpin.programs.same_bits import c_answers
from ccpin.programs.sine_cosine import Precision

STATES = 24  # at which NAME_test.c tests
AWAY = 0.02  # of the way from y to the example's: where a test starts Newton's steps from
TOLERANCE = {"double": 1e-9, "float": 1e-3}  # of an output's largest entry, where a compiler fuses or reorders


def self_test(program: Program, name: str, precision: Precision) -> str:
    """The text of NAME_test.c: states, what was computed of them here, and how much of it comes out."""
    held = states(program, precision)
    found = c_answers(program, held, precision)
    outputs = np.where((found.status == 0)[:, None] & np.isfinite(found.outputs), found.outputs, 0)
    names = parameters(program, name)[len(program.inputs) :]
    gives = zip(names, program.outputs, windows(program.outputs), strict=True)
    filled = [(word, port.size, window.start) for word, port, window in gives if port.size]
    arguments = [f"states[n] + {window.start}" for window in windows(program.inputs) if window.stop > window.start]
    arguments += [word for word, _, _ in filled]
    calls = [f"{precision.name} {word}[{size}];" for word, size, _ in filled]
    checks = [f"wrong += differs({word}, wanted[n] + {first}, {size}, &same);" for word, size, first in filled]
    given, kind, within = ", ".join(arguments), precision.name, f"{TOLERANCE[precision.name]:g}"
    return f"""/* Tests {name}.h at {len(held)} states: ends with 0 where all is as computed, and prints what is not. */
#include <stdio.h>
#include "{name}.h"

{_table("states", held, precision)}
{_table("wanted", outputs, precision)}
static const int codes[{len(held)}] = {{{", ".join(map(str, found.status.tolist()))}}};

/* Whether an output is off by more than {within} of its largest entry; *same stays 1 while all is the same number. */
static int differs(const {kind} found[], const {kind} expected[], int size, int *same)
{{
    double largest = 0, off = 0;
    for (int k = 0; k < size; k++) {{
        const double here = fabs((double)expected[k]), away = fabs((double)found[k] - (double)expected[k]);
        largest = here > largest ? here : largest;
        off = away <= off ? off : away;
        *same = *same && away <= 0;
    }}
    return !(off <= {within} * largest);
}}

int main(void)
{{
    int failures = 0, exact = 0;
    for (int n = 0; n < {len(held)}; n++) {{
        int wrong = 0, same = 1;
        {" ".join(calls)}
        const int code = {name}({given});
        if (code != codes[n]) {{
            wrong = 1;
            same = 0;
        }} else if (code == {name}_OK) {{
            {" ".join(checks) or "wrong = 0;"}
        }}
        if (wrong) {{
            printf("{name}: state %d comes out wrong (status %d, expected %d)\\n", n, code, codes[n]);
            failures++;
        }}
        exact += same;
    }}
    printf("{name}: %d of {len(held)} states wrong, %d the same to the last bit\\n", failures, exact);
    return failures != 0;
}}
"""


def states(program: Program, precision: Precision) -> NDArray[Any]:
    """Inputs at which the exported file is tested, of shape (N, inputs), in the format."""
    rows = _starts(program).astype(precision.type)
    if program.region is None:
        return rows
    lower, upper = program.region.ends(precision)
    first = np.clip(rows[0], lower, upper)
    beyond = [np.nextafter(lower, -np.inf), np.nextafter(upper, np.inf), np.full_like(first, np.nan)]
    outside = [np.where(each, end, first) for each in np.eye(len(first), dtype=np.bool_) for end in beyond]
    return np.vstack([np.clip(rows, lower, upper), *outside])


def _starts(program: Program) -> Array:
    """States in the region if there is one, of shape (N, inputs): closed, or with y off where σ is found."""
    rows = np.array([program.example, *program.around[: STATES - 1]], dtype=np.float64)
    if not program.corrections:
        return rows
    for port, window in zip(program.inputs, windows(program.inputs), strict=True):
        if port.name == "y":
            rows[:, window] += AWAY * (rows[0, window] - rows[:, window])
    return rows


def _table(word: str, rows: Array, precision: Precision) -> str:
    """A constant table of numbers; of one column where there are none."""
    wide = rows if rows.shape[1] else np.zeros((len(rows), 1))

    def line(row: Sequence[float]) -> str:
        told = ("NAN" if math.isnan(value) else literal(value, precision).strip("()") for value in row)
        return "{" + ", ".join(told) + "}"

    lines = ",\n    ".join(line(row) for row in wide.tolist())
    return f"static const {precision.name} {word}[{len(wide)}][{wide.shape[1]}] = {{\n    {lines}\n}};"
