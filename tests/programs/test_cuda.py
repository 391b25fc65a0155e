"""The GPU's text: the C target's numbers by the host's compiler, and SASS without spills by NVRTC where it is."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import CcpinError, InvalidInputError
from ccpin.programs import cuda
from ccpin.programs.compiling import NoCompilerError
from ccpin.programs.lanes import CompiledProgram

HOST = """#include <math.h>
static long long thread_;
#define DEVICE inline
#define KERNEL
#define THREAD thread_
"""
LOOP = """
void all(long long n, {arguments}, int *status)
{{
    for (thread_ = 0; thread_ < n; thread_++) program_many(n, {names}, status);
}}
"""


@pytest.fixture(scope="module", params=["rpdr", "docs/howto/ankle.urdf"])
def program(request):
    """Q̈ at a known q′."""
    return programs.record(ccpin.ReducedModel(ccpin.load(request.param)), "forward_dynamics")


def hosted(program, folder, format):
    """The kernel's body as the host's compiler has it."""
    kind = {"double": "double", "float": "float"}[format]
    ins, outs = len(program.inputs), len(program.outputs)
    names = [*(f"in{k}" for k in range(ins)), *(f"out{k}" for k in range(outs))]
    arguments = ", ".join(f"{'const ' if name.startswith('in') else ''}{kind} *{name}" for name in names)
    text = HOST + cuda.source(program, format) + LOOP.format(arguments=arguments, names=", ".join(names))
    (folder / "host.c").write_text(text)
    command = [shutil.which("cc") or "gcc", "-std=c99", "-O1", "-ffp-contract=off", "-shared", "-fPIC"]
    subprocess.run([*command, "-o", str(folder / "host.so"), str(folder / "host.c"), "-lm"], check=True)
    return ctypes.CDLL(str(folder / "host.so")).all


@pytest.mark.parametrize("format", ["double", "float"])
def test_the_body_gives_the_lanes_bits(program, format, tmp_path):
    """One state a thread, arrays entry by entry: what the CPU's vectors give, bit for bit."""
    try:
        lanes = CompiledProgram(program, format)
    except NoCompilerError as error:
        pytest.skip(str(error))
    rng, ends = np.random.default_rng(0), np.cumsum([port.size for port in program.inputs])[:-1]
    rows = np.array(program.example) + 0.05 * rng.normal(size=(37, len(program.example)))
    inputs = [np.ascontiguousarray(part, dtype=lanes._type) for part in np.split(rows, ends, axis=1)]
    wanted, wanted_status = lanes(*inputs)
    columns = [np.ascontiguousarray(part.T) for part in inputs]
    found, status = np.empty(wanted.shape[::-1], lanes._type), np.empty(37, np.int32)
    pointers = [ctypes.c_void_p(array.ctypes.data) for array in (*columns, found, status)]
    hosted(program, tmp_path, format)(ctypes.c_longlong(37), *pointers)
    np.testing.assert_array_equal(found.T, wanted)
    np.testing.assert_array_equal(status, wanted_status)


@pytest.mark.parametrize("format", ["double", "float"])
def test_a_gpu_gives_the_lanes_bits(program, format):
    """All of them, refused states too, and PyTorch's tensors there give those of a processor."""
    cupy = pytest.importorskip("cupy", reason="a GPU's arrays are CuPy's")
    try:
        kernel = cuda.CudaProgram(program, format)
    except CcpinError as error:
        pytest.skip(str(error))
    lanes, ends = CompiledProgram(program, format), np.cumsum([port.size for port in program.inputs])[:-1]
    rows = np.array(program.example) + 0.05 * np.random.default_rng(0).normal(size=(1000, len(program.example)))
    inputs = [np.ascontiguousarray(part, dtype=lanes._type) for part in np.split(rows, ends, axis=1)]
    inputs[0][7] = np.nan
    for found, wanted in zip(kernel(*(cupy.asarray(part.T) for part in inputs)), lanes(*inputs), strict=True):
        np.testing.assert_array_equal(cupy.asnumpy(found).T, wanted)
    assert kernel.registers <= 255
    with pytest.raises(InvalidInputError, match="must be"):
        kernel(*(cupy.asarray(part) for part in inputs))
    torch = pytest.importorskip("torch", reason="PyTorch's tensors are handed over")
    function = programs.as_function(program, "torch")
    tensors = [torch.tensor(part) for part in inputs]
    on_gpu = function(*(tensor.cuda() for tensor in tensors))["forward_dynamics"].cpu()
    np.testing.assert_array_equal(on_gpu.numpy(), function(*tensors)["forward_dynamics"].numpy())


@pytest.fixture
def there():
    """Skip where NVRTC is not installed."""
    try:
        cuda.nvrtc()
    except CcpinError as error:
        pytest.skip(str(error))


def test_sass_without_spills(program, there):
    """Registers of a thread suffice, in single precision too, and nothing is fused."""
    for format in ("double", "float"):
        made = cuda.compiled(program, "sm_90", format)
        assert made.binary[:4] == b"\x7fELF"
        assert made.registers <= 255
        if "rpdr" in program.name:
            assert made.spilled == 0
    ptx = cuda.compiled(program, "compute_90").binary.decode()
    assert cuda.NAME in ptx
    assert "mul.rn.f64" in ptx or "mul.f64" in ptx
    assert "fma.rn.f64" not in ptx


def test_what_nvrtc_refuses_is_told(program, there):
    """An architecture that is none."""
    with pytest.raises(CcpinError, match="NVRTC"):
        cuda.compiled(program, "sm_11")


def test_wrong_targets(program):
    """Neither SASS nor PTX; a format that is none."""
    with pytest.raises(InvalidInputError, match="target"):
        cuda.compiled(program, "gfx90a")
    with pytest.raises(InvalidInputError, match="format"):
        cuda.source(program, "half")


def test_without_nvrtc_or_cupy(program, monkeypatch):
    """The extras that bring them are named."""

    def missing(_):
        raise OSError

    monkeypatch.setattr(ctypes, "CDLL", missing)
    with pytest.raises(CcpinError, match="cuda12"):
        cuda.nvrtc()
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    with pytest.raises(CcpinError, match="CuPy"):
        cuda.CudaProgram(program)
