"""A core built on a new Linux loads on one from 2018 on, and its results are those of the newer functions."""

import contextlib
import ctypes
import platform
import re
import resource
import sys
from pathlib import Path

import numpy as np
import pytest

NEWEST = {"GLIBC": (2, 28), "GLIBCXX": (3, 4, 25), "CXXABI": (1, 3, 11)}  # of AlmaLinux 8: what manylinux_2_28 promises
BASE = {"x86_64": b"GLIBC_2.2.5", "aarch64": b"GLIBC_2.17"}
RENEWED = {"exp": b"GLIBC_2.29", "pow": b"GLIBC_2.29", "hypot": b"GLIBC_2.35"}

linux = pytest.mark.skipif(sys.platform != "linux", reason="versions of symbols are Linux's")


@linux
def test_no_newer_symbol_is_asked_for():
    """No version the core names is newer than manylinux_2_28 has."""
    core = pytest.importorskip("ccpin.native._core")
    named = re.findall(rb"\0(GLIBC|GLIBCXX|CXXABI)_([\d.]+)(?=\0)", Path(core.__file__).read_bytes())
    assert {name.decode() for name, _ in named} == set(NEWEST)
    asked = {name: max(version(number) for other, number in named if other == name) for name, _ in named}
    assert {name: found for name, found in asked.items() if found > NEWEST[name.decode()]} == {}


def version(number):
    return tuple(int(part) for part in number.split(b"."))


@linux
@pytest.mark.parametrize("name", RENEWED)
def test_older_versions_compute_the_same(name):
    """To the last bit, over all sizes of numbers, infinities, NaN and powers that overflow or vanish."""
    older, newer = (found(name, each) for each in (BASE.get(platform.machine(), b""), RENEWED[name]))
    if older is None or newer is None:
        pytest.skip(f"this libm has not both versions of {name}")
    rng = np.random.default_rng(0)
    special = [0.0, -0.0, 1.0, -1.0, 2.0, -3.0, 0.5, 5e-324, -2e-310, 1.8e308, np.inf, -np.inf, np.nan]
    pairs = [(x, y) for x in special for y in special]
    pairs += np.exp(rng.uniform(-700, 700, (4000, 2))).tolist() + rng.normal(size=(4000, 2)).tolist()
    pairs += np.column_stack([np.exp(rng.uniform(-30, 5, 8000)), rng.choice([-1 / 5, -1 / 8, 0.2, 3.7], 8000)]).tolist()
    values = np.array([(older(x, y), newer(x, y)) for x, y in pairs])
    assert np.array_equal(*values.T, equal_nan=True)
    assert np.array_equal(*np.signbit(values[~np.isnan(values).any(axis=1)]).T)
    assert np.isfinite(values).all(axis=1).sum() > 10000


def found(name, wanted):
    """A function of two numbers (`exp` takes the first) in a version, ``None`` where libm has no such version."""
    libm = ctypes.CDLL("libm.so.6")
    look = ctypes.CDLL(None).dlvsym
    look.restype, look.argtypes = ctypes.c_void_p, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_char_p)
    address = look(libm._handle, name.encode(), wanted)
    return address and ctypes.CFUNCTYPE(ctypes.c_double, ctypes.c_double, ctypes.c_double)(address)


@pytest.mark.slow
@linux
def test_what_is_thrown_is_freed():
    """Exceptions of the core are counted down to nothing (`native/older_libstdcxx.cpp`)."""
    core = pytest.importorskip("ccpin.native._core")

    def refused(times):
        for _ in range(times):
            with contextlib.suppress(Exception):
                core.Kernel({})
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize()

    before = refused(1000)
    assert refused(100_000) - before < 2**20  # each takes more than a hundred bytes until it is freed
