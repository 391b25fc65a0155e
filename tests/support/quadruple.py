"""Programs as C in __float128 with libquadmath's sine and cosine, beside the exported C of a format: what is it off by?

The text is written here once more, of the recorded instructions with their rationals: nothing is folded, nothing of
`ccpin.programs.c_code` is in it.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ccpin import programs
from ccpin.programs.instructions import Instruction, Kind
from ccpin.programs.program import Port, windows
from ccpin.programs.program_sources import assembled
from ccpin.programs.sine_cosine import PRECISIONS, Format

BITS = 113  # of __float128
PARTS = 3  # doubles that hold one
COMPILER, FLAGS = "gcc", ("-std=gnu99", "-O1", "-ffp-contract=off", "-fPIC", "-shared")
OPERATIONS = {
    Kind.ADD: "t[{a}] + t[{b}]", Kind.SUBTRACT: "t[{a}] - t[{b}]", Kind.MULTIPLY: "t[{a}] * t[{b}]",
    Kind.SCALE: "{c} * t[{a}]", Kind.CONSTANT: "{c}", Kind.SINE: "sinq(t[{a}])", Kind.COSINE: "cosq(t[{a}])",
    Kind.RECIPROCAL: "1 / t[{a}]", Kind.ROOT: "sqrtq(t[{a}])", Kind.ANGLE: "atan2q(t[{a}], t[{b}])",
}  # fmt: skip
TEXT = """#include <quadmath.h>
#include "{name}.h"
typedef {format} S;
typedef __float128 Q;
static void exactly(const Q in[], Q out[])
{{
    Q t[{size}];
    for (int k = 0; k < {reads}; k++) t[k] = in[k];
    {lines}
}}
void run(long n, const S (*x)[{reads}], S (*out)[{gives}], int *status)
{{
    for (long i = 0; i < n; i++) {{
        const S *const in = x[i];
        S *const to = out[i];
        status[i] = {name}({places});
    }}
}}
void compare(long n, const S (*x)[{reads}], const double *y, const S (*out)[{gives}], double (*off)[{gives}],
             double (*exact)[{gives}][{parts}])
{{
    for (long i = 0; i < n; i++) {{
        Q in[{reads}], to[{gives}];
        for (int k = 0; k < {reads}; k++) in[k] = x[i][k];
        for (int k = 0; y && k < {m}; k++) in[{first} + k] = y[i * {m} + k];
        exactly(in, to);
        for (int k = 0; k < {gives}; k++) {{
            off[i][k] = (double)fabsq(out[i][k] - to[k]) * (1 + 0x1p-52);
            for (int j = 0; j < {parts}; j++) {{
                exact[i][k][j] = (double)to[k];
                to[k] -= exact[i][k][j];
            }}
        }}
    }}
}}
"""


class Beside(NamedTuple):
    """What comparison finds.

    Attributes:
        outputs, status: Of the exported C, of shape (N, outputs) and (N,).
        off: |outputs − exact ones|, rounded up.
        exact: The exact ones as sums of doubles, of shape (N, outputs, 3).
    """

    outputs: np.ndarray
    status: np.ndarray
    off: np.ndarray
    exact: np.ndarray


def absent() -> str:
    """Why there is no __float128 here; nothing where there is."""
    if shutil.which(COMPILER) is None:
        return f"no {COMPILER}"
    with tempfile.TemporaryDirectory() as made:
        trial = "#include <quadmath.h>\n__float128 f(__float128 x) { return sinq(x); }\n"
        command = [COMPILER, *FLAGS, "-x", "c", "-", "-o", "trial.so", "-lquadmath"]
        done = subprocess.run(command, check=False, cwd=made, input=trial, text=True, capture_output=True)
        return "" if done.returncode == 0 else f"{COMPILER} has no __float128 and libquadmath"


def literal(value: Fraction) -> str:
    """The number of `BITS` bits nearest to a rational, in hexadecimals."""
    exponent = value.numerator.bit_length() - value.denominator.bit_length() - BITS
    exponent += abs(value) >= Fraction(2) ** (BITS + exponent)
    rounded = round(value / Fraction(2) ** exponent)
    return f"({'-' if rounded < 0 else ''}0x{abs(rounded):x}p{exponent}Q)"


def _written(item: Instruction) -> str:
    constant = "" if item.constant is None else literal(item.constant)
    return OPERATIONS[item.kind].format(a=item.a, b=item.b, c=constant)


class Quadruple:
    """A program's exported C in a format and its exact values at the exact σ(q), or at the y given where that is read.

    Args:
        program: The program; GAIN is not among its operations.
        format: Of the exported C.
    """

    def __init__(self, program: programs.Program, format: Format) -> None:
        source = program.source
        assert source is not None
        self.program, self.type = program, PRECISIONS[format].type
        # from y that is σ(q) to a double's rounding, one Newton step and one with the same matrix end beyond 113 bits
        self.code = assembled(source._replace(steps=min(source.steps, 1))).code
        self._reads, self._gives = (sum(p.size for p in ports) for ports in (program.inputs, program.outputs))
        lines = [f"t[{item.target}] = {_written(item)};" for item in self.code.instructions]
        lines += [f"out[{k}] = t[{number}];" for k, number in enumerate(self.code.outputs)]
        with tempfile.TemporaryDirectory() as made:
            programs.export(program, made, name="exported", format=format)
            text = TEXT.format(
                name="exported", format=format, size=self.code.size, reads=self._reads, gives=self._gives, parts=PARTS,
                places=", ".join([*_places("in", program.inputs), *_places("to", program.outputs)]),
                lines="\n    ".join(lines), first=program.inputs[0].size, m=program.inputs[1].size,
            )  # fmt: skip
            (Path(made) / "beside.c").write_text(text)
            command = [COMPILER, *FLAGS, "beside.c", "-o", "beside.so", "-lquadmath", "-lm"]
            subprocess.run(command, check=True, cwd=made)
            self._library = ctypes.CDLL(str(Path(made) / "beside.so"))

    def run(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs and status of the exported C at inputs of shape (N, inputs)."""
        x = np.ascontiguousarray(x, dtype=self.type)
        out, status = np.empty((len(x), self._gives), dtype=self.type), np.empty(len(x), dtype=np.int32)
        self._library.run(ctypes.c_long(len(x)), *map(_place, (x, out, status)))
        return out, status

    def beside(self, x: np.ndarray, y: np.ndarray) -> Beside:
        """The exported C at inputs beside exact values, of which σ(q) is y to a double's rounding."""
        x, y = np.ascontiguousarray(x, dtype=self.type), np.ascontiguousarray(y, dtype=np.float64)
        out, status = self.run(x)
        off, exact = np.empty((len(x), self._gives)), np.empty((len(x), self._gives, PARTS))
        near = _place(y) if self.program.corrections else None
        self._library.compare(ctypes.c_long(len(x)), _place(x), near, *map(_place, (out, off, exact)))
        return Beside(out, status, off, exact)


def _places(word: str, ports: tuple[Port, ...]) -> list[str]:
    """Where each port that is not empty begins in an array of all."""
    return [f"{word} + {window.start}" for port, window in zip(ports, windows(ports), strict=True) if port.size]


def _place(table: np.ndarray) -> ctypes.c_void_p:
    return ctypes.c_void_p(table.ctypes.data)
