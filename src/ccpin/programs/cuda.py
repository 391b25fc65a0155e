"""Programs as CUDA: the C target's arithmetic, one state a thread, arrays entry by entry (extras `cuda12`, `cuda13`).

NVRTC, which pip brings, compiles without a driver or a GPU: to PTX, and to SASS with the registers and spills that
`ptxas` tells. Nothing is fused (`--fmad=false`), and SASS is what is loaded: PTX of a newer NVRTC than the driver is
refused. `CudaProgram` launches it through CuPy where there is a GPU.
"""

from __future__ import annotations

import ctypes
import re
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from ccpin.arrays import choice
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs.c_code import kernel_of, scalar_macros
from ccpin.programs.program import Port, Program
from ccpin.programs.sine_cosine import PRECISIONS, Format

_CACHING = 12, 9  # the first version that keeps what it compiled, without its words, where there is a driver
_OPTIONS = ("--fmad=false", "--ftz=false", "--prec-div=true", "--prec-sqrt=true", "--std=c++14")
_PLACES = ("cuda_nvrtc", "cu13", "cu12")  # folders of `nvidia` where wheels put the library
_LOCAL_BYTES, _REGISTERS = 3, 4  # of CUDA's CUfunction_attribute
THREADS = 128  # a block
NAME = "program_many"


class Compiled(NamedTuple):
    """What NVRTC made.

    Attributes:
        binary: PTX (text) or SASS (an ELF file), by what was asked for.
        registers: Of a thread; ``None`` with PTX.
        spilled: Bytes that a thread stores for want of registers; ``None`` with PTX.
        log: The compiler's own words.
    """

    binary: bytes
    registers: int | None
    spilled: int | None
    log: str

    def __repr__(self) -> str:
        return f"Compiled({len(self.binary)} bytes, registers={self.registers}, spilled={self.spilled})"


def source(program: Program, format: Format = "double") -> str:
    """The CUDA text, which a C compiler takes as well where it knows `__device__`, `__global__` and `THREAD`.

    The kernel is `program_many(n, inputs …, outputs …, status)` with entry k of state i at k n + i of each array.
    """
    precision = PRECISIONS[choice(format, "format", tuple(PRECISIONS))]
    count = max(1, len(program.code.instructions))
    body = kernel_of(program, "program", precision, count).kernel.replace("static inline", "static DEVICE")
    ins = [f"const S *in{k}" for k, _ in enumerate(program.inputs)]
    outs = [f"S *out{k}" for k, _ in enumerate(program.outputs)]
    reads = _moved("x[{place}] = in{port}[{entry} * n + i];", program.inputs)
    writes = _moved("out{port}[{entry} * n + i] = out[{place}];", program.outputs)
    sizes = (max(1, sum(port.size for port in group)) for group in (program.inputs, program.outputs))
    lines = [
        "const long long i = THREAD;",
        "if (i >= n) { return; }",
        "R x[{}], out[{}];".format(*sizes),
        *reads,
        "status[i] = program_kernel(x, out);",
        *writes,
    ]
    head = f"KERNEL void {NAME}({', '.join(['long long n', *ins, *outs, 'int *status'])})"
    return "\n".join([_HEAD, scalar_macros(precision), body, head, "{", *(f"    {line}" for line in lines), "}", ""])


_HEAD = """#ifdef __CUDACC_RTC__
#define DEVICE __device__ __forceinline__
#define KERNEL extern "C" __global__
#define THREAD ((long long)blockIdx.x * blockDim.x + threadIdx.x)
#endif"""


def _moved(line: str, ports: Sequence[Port]) -> list[str]:
    """A line for every entry of every port."""
    found = list[str]()
    for number, port in enumerate(ports):
        for entry in range(port.size):
            found.append(line.format(place=len(found), port=number, entry=entry))
    return found


def compiled(program: Program, target: str, format: Format = "double") -> Compiled:
    """The program compiled by NVRTC; no GPU is needed.

    Args:
        program: The program.
        target: `"sm_90"` for SASS of that architecture, `"compute_90"` for PTX.
        format: Of its arithmetic.

    Raises:
        InvalidInputError: Another target.
        CcpinError: NVRTC is not there, or does not know the architecture.
    """
    if not re.fullmatch(r"(sm|compute)_\d{2,3}[af]?", target):
        raise InvalidInputError(f"target {target!r} is neither sm_… (SASS) nor compute_… (PTX)")
    library, major, minor = nvrtc(), ctypes.c_int(), ctypes.c_int()
    _done(library, library.nvrtcVersion(ctypes.byref(major), ctypes.byref(minor)), "")
    anew = ("--no-cache",) if (major.value, minor.value) >= _CACHING else ()
    binary, log = _binary(library, source(program, format), target, anew)
    if target.startswith("compute"):
        return Compiled(binary, None, None, log)
    registers, spilled = (re.findall(word, log) for word in (r"Used (\d+) registers", r"(\d+) bytes spill stores"))
    if not registers:
        raise CcpinError(f"NVRTC tells no registers: {log[:200]}")
    return Compiled(binary, int(registers[-1]), sum(map(int, spilled)), log)


def _binary(library: ctypes.CDLL, text: str, target: str, further: Sequence[str] = ()) -> tuple[bytes, str]:
    """PTX or SASS of a text, and NVRTC's words, none where it was compiled before."""
    handle = ctypes.c_void_p()
    _done(library, library.nvrtcCreateProgram(ctypes.byref(handle), text.encode(), b"program.cu", 0, None, None), "")
    try:
        words = (*_OPTIONS, f"--gpu-architecture={target}", "--ptxas-options=-v", *further)
        options = [word.encode() for word in words]
        array = (ctypes.c_char_p * len(options))(*options)
        code = library.nvrtcCompileProgram(handle, len(options), array)
        log = _text(library, handle, "ProgramLog").decode(errors="replace").strip("\0\n ")
        _done(library, code, log)
        return _text(library, handle, "PTX" if target.startswith("compute") else "CUBIN"), log
    finally:
        library.nvrtcDestroyProgram(ctypes.byref(handle))


def nvrtc() -> ctypes.CDLL:
    """NVRTC, as pip or a CUDA toolkit brings it.

    Raises:
        CcpinError: It is not there.
    """
    found = list[str]()
    spec = find_spec("nvidia")
    for place in spec.submodule_search_locations or [] if spec is not None else []:
        for folder in _PLACES:
            found += map(str, sorted((Path(place) / folder / "lib").glob("libnvrtc.so.*[0-9]"), reverse=True))
    for name in (*found, "libnvrtc.so", "libnvrtc.so.12", "libnvrtc.so.13"):
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise CcpinError("programs as CUDA need NVRTC: pip install 'ccpin[cuda12]' or 'ccpin[cuda13]'")


def _done(library: ctypes.CDLL, code: int, log: str) -> None:
    if code:
        library.nvrtcGetErrorString.restype = ctypes.c_char_p
        raise CcpinError(f"NVRTC: {library.nvrtcGetErrorString(code).decode()} {log[:400]}")


def _text(library: ctypes.CDLL, handle: ctypes.c_void_p, what: str) -> bytes:
    """One of what NVRTC made."""
    size = ctypes.c_size_t()
    _done(library, getattr(library, f"nvrtcGet{what}Size")(handle, ctypes.byref(size)), what)
    held = ctypes.create_string_buffer(size.value)
    _done(library, getattr(library, f"nvrtcGet{what}")(handle, held), what)
    return held.raw


class CudaProgram:
    """A program on the GPU that CuPy has chosen.

    Inputs and outputs are CuPy's arrays, or whatever gives its memory by DLPack, of shape (entries, N): one column a
    state. NVRTC since 12.9 keeps what it compiled for the next process.

    Args:
        program: The program.
        format: Of its arithmetic and of all arrays.

    Attributes:
        registers: Of a thread.
        local_bytes: Of a thread's own memory: what has no register, and what arrays take that are not in any.

    Raises:
        CcpinError: CuPy, NVRTC or a GPU is not there.
    """

    def __init__(self, program: Program, format: Format = "double") -> None:
        try:
            import cupy
        except ImportError:
            raise CcpinError("programs on a GPU need CuPy: pip install 'ccpin[cuda12]' or 'ccpin[cuda13]'") from None
        self.program, self._cupy = program, cupy
        try:
            capability = cupy.cuda.Device().compute_capability
        except cupy.cuda.runtime.CUDARuntimeError as error:
            raise CcpinError(f"there is no GPU: {error}") from None
        binary, _ = _binary(nvrtc(), source(program, format), f"sm_{capability}")
        self._type = cupy.float64 if format == "double" else cupy.float32
        module = cupy.cuda.function.Module()
        module.load(binary)
        self._run = module.get_function(NAME)
        attribute = cupy.cuda.driver.funcGetAttribute
        self.registers = int(attribute(_REGISTERS, self._run.ptr))
        self.local_bytes = int(attribute(_LOCAL_BYTES, self._run.ptr))

    def __call__(self, *inputs: Any) -> tuple[Any, ...]:
        """The outputs, each of shape (entries, N), and the status, (N,).

        Raises:
            InvalidInputError: Arrays of other shapes or of another type.
        """
        cupy, ports = self._cupy, self.program.inputs
        if len(inputs) != len(ports):
            raise InvalidInputError(f"{len(inputs)} inputs for {', '.join(port.name for port in ports)}")
        tables = [cupy.ascontiguousarray(cupy.from_dlpack(table)) for table in inputs]
        count = tables[0].shape[-1] if tables else 1
        for table, port in zip(tables, ports, strict=True):
            if table.shape != (port.size, count) or table.dtype != self._type:
                raise InvalidInputError(f"{port.name} must be {self._type} of shape ({port.size}, {count})")
        outputs = [cupy.empty((port.size, count), self._type) for port in self.program.outputs]
        status = cupy.empty(count, cupy.int32)
        blocks = -(-count // THREADS)
        if count:
            self._run((blocks, 1, 1), (THREADS, 1, 1), (cupy.int64(count), *tables, *outputs, status))
        return (*outputs, status)
