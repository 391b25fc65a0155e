"""Programs compiled with the system's compiler, many states at a time: 4 or 8 lanes a vector, threads over rows."""

from __future__ import annotations

import ctypes
import marshal
import os
import platform
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import choice, instance, numbers, whole
from ccpin.errors import InvalidInputError
from ccpin.programs import c_code, certified_region, evaluation, folding, sine_cosine
from ccpin.programs.c_code import kernel_of, lane_macros
from ccpin.programs.compiling import NoCompilerError, loaded
from ccpin.programs.program import Program, windows
from ccpin.programs.sine_cosine import PRECISIONS, Format

PIECE = 600  # operations a function, of vectors; `c_code.PIECE` is of exported C
_CHUNK, _TURNS = 2048, 16  # rows a thread takes at a time, no fewer; turns each has of a large batch
_AGREES = 1e-6  # of the largest output: what a compiler may differ from NumPy at a program's example


class Width(NamedTuple):
    """What this machine's vectors are.

    Attributes:
        name: As the processor calls it.
        flags: What makes the compiler use it.
        bytes: Of a vector.
    """

    name: str
    flags: tuple[str, ...]
    bytes: int


def width() -> Width:
    """The widest vectors that this processor has."""
    if platform.machine() not in ("x86_64", "AMD64"):
        return Width("neon" if platform.machine() in ("aarch64", "arm64") else "generic", (), 32)
    known = _flags_of_processor()
    if {"avx512f", "avx512dq", "avx512vl"} <= known:
        return Width("avx512", ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mprefer-vector-width=512"), 64)
    return Width("avx2", ("-mavx2",), 32) if "avx2" in known else Width("sse2", (), 32)


def _flags_of_processor() -> set[str]:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return set()
    return next((set(line.split(":")[1].split()) for line in lines if line.startswith("flags")), set())


class CompiledProgram:
    """A program in lanes, to be called by any number of threads; a pickle is compiled, or found, where it is read.

    Args:
        program: The program.
        format: Of the arithmetic; a float program takes and gives doubles all the same, in its own precision.
        vectors: Their width, default the widest there is.

    Raises:
        InvalidInputError: It is no program, or another format.
        NoCompilerError: There is no compiler (`CC`, cc, gcc or clang), or it fails.
        CcpinError: The folder for compiled programs is not the user's.
    """

    def __init__(self, program: Program, format: Format = "double", vectors: Width | None = None) -> None:
        self.program, self.format = instance(program, "program", Program), choice(format, "format", tuple(PRECISIONS))
        self._vectors = vectors
        self._type = np.dtype(np.float64 if format == "double" else np.float32)
        wide = vectors or width()
        flags = ("-O2" if len(program.code.instructions) <= PIECE else "-O1", *wide.flags)
        self._use(loaded(lambda: source(program, format, wide), _made_of(program, format, wide), flags, self._examined))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return CompiledProgram, (self.program, self.format, self._vectors)

    def _use(self, library: ctypes.CDLL) -> None:
        self._run = library.many
        self._run.restype = None

    def _examined(self, library: ctypes.CDLL) -> bool:
        """Whether a library gives what NumPy gives at the program's example."""
        program = self.program
        if self.format == "float" or not program.example:
            return True
        self._use(library)
        example, pairs = np.array(program.example), zip(program.inputs, windows(program.inputs), strict=True)
        given = {port.name: example[window].reshape(port.shape) for port, window in pairs}
        wanted, found = program(**given), self(*given.values())
        beside = list(zip(wanted.values(), found, strict=False))
        size = max((float(np.abs(a).max(initial=0.0)) for a, _ in beside), default=0.0)
        close = all(np.allclose(b[0], a, rtol=0.0, atol=_AGREES * size, equal_nan=True) for a, b in beside)
        return close and int(found[-1][0]) == wanted.status

    def __call__(self, *inputs: ArrayLike, threads: int = 1) -> tuple[NDArray[Any], ...]:
        """The outputs, each of shape (N, …), and the status, (N,), at inputs of shape (N, …), or of one row for all.

        Args:
            inputs: In the program's order; they may be of any memory layout.
            threads: Among which rows are divided, no more than there are processors; they wait for the next call.

        Raises:
            InvalidInputError: Inputs too few, of other shapes or no real numbers; no whole number of threads.
        """
        ports, threads = self.program.inputs, min(whole(threads, "threads"), os.cpu_count() or 1)
        if len(inputs) != len(ports):
            raise InvalidInputError(f"{len(inputs)} inputs for {', '.join(port.name for port in ports)}")
        tables = [self._read(value, port.name) for value, port in zip(inputs, ports, strict=True)]
        rows = max((len(t) for t, port in zip(tables, ports, strict=True) if t.ndim > len(port.shape)), default=1)
        flat = list[NDArray[Any]]()
        for table, port in zip(tables, ports, strict=True):
            one = table.shape == port.shape
            if not one and (table.ndim != len(port.shape) + 1 or table.shape[1:] != port.shape or len(table) != rows):
                raise InvalidInputError(f"{port.name} must be of shape {port.shape} or ({rows}, …), not {table.shape}")
            wide = np.broadcast_to(table, (rows, *port.shape)) if one else table
            flat.append(wide.reshape(rows, port.size) if len(port.shape) != 1 else wide)
        found = [np.empty((port.size, rows), dtype=self._type).T for port in self.program.outputs]
        status = np.empty(rows, dtype=np.int32)
        self._fill(flat, found, status, threads)
        shaped = (f.reshape(rows, *port.shape) for f, port in zip(found, self.program.outputs, strict=True))
        return (*shaped, status)

    def _read(self, value: ArrayLike, name: str) -> NDArray[Any]:
        """An input in the format, in steps of whole numbers of it.

        Raises:
            InvalidInputError: It is of something else than real numbers.
        """
        if isinstance(value, np.ndarray) and value.dtype == self._type:
            table = value
        else:
            table = numbers(value, name).astype(self._type, copy=False)
        apart = all(step % self._type.itemsize == 0 for step in table.strides)
        return table if apart and table.flags.aligned else table.copy()  # a field of records, or of a packed file

    def bound(
        self, inputs: list[NDArray[Any]], outputs: list[NDArray[Any]], status: NDArray[Any]
    ) -> Callable[[], None]:
        """What runs it over one row of contiguous arrays of the ports' shapes, which it reads and writes each time."""
        tables = [*inputs, *outputs]
        places = (ctypes.c_void_p * max(len(tables), 1))(*(table.ctypes.data for table in tables))
        steps = (ctypes.c_long * max(2 * len(tables), 1))(*([0, 1] * len(tables)))
        arguments = (ctypes.c_long(0), ctypes.c_long(1), places, steps, ctypes.c_void_p(status.ctypes.data))
        return lambda: self._run(*arguments)

    def _fill(
        self, inputs: list[NDArray[Any]], outputs: list[NDArray[Any]], status: NDArray[Any], threads: int
    ) -> None:
        size, rows = self._type.itemsize, len(status)
        tables = [*inputs, *outputs]
        strides = [s // size for table in tables for s in table.strides]
        places = (ctypes.c_void_p * max(len(tables), 1))(*(table.ctypes.data for table in tables))
        steps, told = (ctypes.c_long * max(len(strides), 1))(*strides), ctypes.c_void_p(status.ctypes.data)

        def some(first: int, last: int) -> None:  # without the interpreter's lock, but for a microsecond
            self._run(ctypes.c_long(first), ctypes.c_long(last), places, steps, told)

        if threads == 1 or rows <= _CHUNK:
            some(0, rows)
            return
        piece = _CHUNK * max(1, rows // (_CHUNK * _TURNS * threads))
        left = list(range(0, rows, piece))

        def work() -> None:
            while left:
                try:
                    first = left.pop()
                except IndexError:
                    return
                some(first, min(first + piece, rows))

        others = [_helpers().submit(work) for _ in range(threads - 1)]
        try:
            work()
        finally:  # what has not begun helps others; what has is waited for, as it writes to these arrays
            left.clear()
            for other in others:
                if not other.cancel():
                    other.result()


@cache
def _helpers() -> ThreadPoolExecutor:
    """Threads that wait for the next call: to start one takes as long as thousands of rows."""
    return ThreadPoolExecutor(os.cpu_count() or 1, "ccpin-lanes")


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_helpers.cache_clear)  # where there are none of these threads


class InNumPy:
    """A program with the calls of a compiled one, where there is no compiler; always in double."""

    def __init__(self, program: Program) -> None:
        self.program = program

    def __call__(self, *inputs: ArrayLike, threads: int = 1) -> tuple[Any, ...]:
        """As `CompiledProgram`'s."""
        whole(threads, "threads")
        names = [port.name for port in self.program.inputs]
        told = self.program(**dict(zip(names, inputs, strict=True)))
        return *told.values(), np.atleast_1d(told.status)


def fastest(program: Program, format: Format = "double") -> CompiledProgram | InNumPy:
    """What runs a program here: lanes, or NumPy where there is no compiler."""
    try:
        return CompiledProgram(program, format)
    except NoCompilerError:
        return InNumPy(program)


def _made_of(program: Program, format: Format, vectors: Width) -> str:
    """A digest of all that decides `source`: the arithmetic, the format, the vectors, and the modules that write it."""
    code = program.code
    lines = [
        (kind, target, a, b, *(() if k is None else (k.numerator, k.denominator)))
        for kind, target, a, b, k in code.instructions
    ]
    sizes = [[port.size for port in ports] for ports in (program.inputs, program.outputs)]
    checks = [(pivot.number, pivot.scale) for pivot in program.pivots], program.corrections, program.tolerance
    region = program.region and [list(map(float, end)) for end in program.region[:2]] + [list(program.region.formats)]
    parts = (code.inputs, lines, code.outputs, sizes, checks, region, format, vectors.bytes, _writers())
    return sha256(marshal.dumps(parts, 2)).hexdigest()  # version 2: of the values alone, not of which are one object


@cache
def _writers() -> bytes:
    """The text of the modules that write C."""
    written = c_code.__file__, certified_region.__file__, evaluation.__file__, folding.__file__, sine_cosine.__file__
    return b"".join(Path(file).read_bytes() for file in (__file__, *written))


def source(program: Program, format: Format, vectors: Width) -> str:
    """The C that is compiled."""
    precision = PRECISIONS[format]
    lanes = vectors.bytes // (8 if format == "double" else 4)
    name = "program"
    text = kernel_of(program, name, precision, PIECE)
    ins, outs = [port.size for port in program.inputs], [port.size for port in program.outputs]
    return "\n".join(
        [
            "#include <math.h>\n#include <string.h>",
            lane_macros(precision, lanes),
            text.kernel,
            _LOAD,
            _many(name, ins, outs),
        ]
    )


_LOAD = """#define EACH _Pragma("GCC unroll 16")
static inline void load(R *to, const S *from, long row, long entry, int size, long left)
{
    if (left < LANES) {
        for (int k = 0; k < size; k++)
            for (int lane = 0; lane < LANES; lane++) to[k][lane] = from[(lane < left ? lane : 0) * row + k * entry];
    } else if (row == 1) {
        for (int k = 0; k < size; k++) memcpy(&to[k], from + k * entry, sizeof(R));
    } else {
        for (int k = 0; k < size; k++) {
            R value;
            EACH
            for (int lane = 0; lane < LANES; lane++) value[lane] = from[lane * row + k * entry];
            to[k] = value;
        }
    }
}
static inline void store(const R *from, S *to, long row, long entry, int size, long left)
{
    if (left < LANES) {
        for (int k = 0; k < size; k++)
            for (int lane = 0; lane < left; lane++) to[lane * row + k * entry] = from[k][lane];
    } else if (row == 1) {
        for (int k = 0; k < size; k++) memcpy(to + k * entry, &from[k], sizeof(R));
    } else {
        for (int k = 0; k < size; k++) {
            EACH
            for (int lane = 0; lane < LANES; lane++) to[lane * row + k * entry] = from[k][lane];
        }
    }
}"""


def _many(name: str, inputs: Sequence[int], outputs: Sequence[int]) -> str:
    """The loop over some rows: `tables` are inputs, then outputs; `steps` how far rows and entries are apart."""

    def moved(word: str, place: str, kind: str, k: int, size: int) -> str:
        row, entry = f"steps[{2 * k}]", f"steps[{2 * k + 1}]"
        return f"{word}({place}, ({kind} *)tables[{k}] + i * {row}, {row}, {entry}, {size}, last - i);"

    starts, ends = ([sum(sizes[:k]) for k in range(len(sizes) + 1)] for sizes in (inputs, outputs))
    loads = [moved("load", f"x + {starts[k]}", "const S", k, size) for k, size in enumerate(inputs)]
    stores = [moved("store", f"out + {ends[k]}", "S", len(inputs) + k, size) for k, size in enumerate(outputs)]
    lines = [
        f"R x[{max(starts[-1], 1)}], out[{max(ends[-1], 1)}];",
        "for (long i = first; i < last; i += LANES) {",
        *(f"    {line}" for line in loads),
        f"    const I code = {name}_kernel(x, out);",
        *(f"    {line}" for line in stores),
        "    for (int lane = 0; lane < LANES && i + lane < last; lane++)",
        "        status[i + lane] = (int)code[lane];",
        "}",
    ]
    return "\n".join(
        [
            "void many(long first, long last, void *const tables[], const long steps[], int status[])",
            "{",
            *(f"    {line}" for line in lines),
            "}",
        ]
    )
