"""One program, the same numbers to the last bit: C, lanes of every width this machine has, NEON in qemu, NumPy."""

import shutil
import subprocess

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.programs.lanes import CompiledProgram, Width, source
from ccpin.programs.lanes import width as widest
from ccpin.programs.same_bits import c_answers
from ccpin.programs.sine_cosine import PRECISIONS
from tests.support.exported import compiler, exported
from tests.support.long_cases import later
from tests.support.places import ROOT

ROWS = 10_000
MECHANISMS = ("rpdr", str(ROOT / "docs" / "howto" / "ankle.urdf"))
WIDTHS = {
    "sse2": Width("sse2", (), 32),
    "avx2": Width("avx2", ("-mavx2",), 32),
    "avx512": Width("avx512", ("-mavx512f", "-mavx512dq", "-mavx512vl", "-mprefer-vector-width=512"), 64),
}
FORMATS = pytest.mark.parametrize("format", ["double", "float"])


of_each = pytest.mark.parametrize("asked", later(*MECHANISMS), ids=["rpdr", "ankle"], indirect=True)


@pytest.fixture(scope="module")
def asked(request):
    """A program that finds σ, and rows of inputs about its closed states, a few hostile ones among them."""
    model = ccpin.ReducedModel(ccpin.load(request.param))
    program = programs.record(model, ["sigma", "forward_dynamics"], given="near")
    rng, known = np.random.default_rng(0), np.array([program.example, *program.around])
    rows = known[rng.integers(0, len(known), ROWS)] + rng.uniform(-0.004, 0.004, (ROWS, known.shape[1]))
    rows[::97] += rng.uniform(-3.0, 3.0, rows[::97].shape)
    rows[5, 0], rows[6, 1], rows[7, 2] = np.nan, np.inf, 1e9
    return program, rows


def same(found, status, wanted):
    """Equal numbers, wherever they can be trusted, and equal statuses."""
    np.testing.assert_array_equal(status, wanted.status)
    np.testing.assert_array_equal(found[status == 0], wanted.outputs[status == 0])
    assert {0, 1, 2} == set(status.tolist())
    assert (status == 0).sum() > 0.9 * ROWS


@pytest.mark.parametrize(
    ("asked", "format"),
    [(MECHANISMS[0], "float"), (MECHANISMS[1], "double")]
    + [pytest.param(*case, marks=pytest.mark.slow) for case in ((MECHANISMS[0], "double"), (MECHANISMS[1], "float"))],
    ids=["rpdr-float", "ankle-double", "rpdr-double", "ankle-float"],
    indirect=["asked"],
)
def test_c_has_numpy_s_bits(asked, format, tmp_path):
    program, rows = asked
    same(*exported(program, tmp_path, format)(rows), c_answers(program, rows, PRECISIONS[format]))


@pytest.mark.parametrize(
    ("name", "format"),
    [("sse2", "double"), ("avx2", "float"), ("avx512", "double")]
    + [
        pytest.param(*case, marks=pytest.mark.slow)
        for case in (("sse2", "float"), ("avx2", "double"), ("avx512", "float"))
    ],
)
@of_each
def test_lanes_have_the_same(asked, name, format, tmp_path, monkeypatch):
    """Of each width that this processor runs."""
    compiler()
    if widest().name not in list(WIDTHS)[list(WIDTHS).index(name) :]:
        pytest.skip(f"this processor has no {name}")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    program, rows = asked
    ends = np.cumsum([port.size for port in program.inputs])[:-1]
    *found, status = CompiledProgram(program, format, WIDTHS[name])(*np.split(rows, ends, axis=1))
    wide = np.hstack([table.reshape(ROWS, -1) for table in found])
    same(wide, status, c_answers(program, rows, PRECISIONS[format]))


MAIN = """
#include <stdio.h>
#include <stdlib.h>
int main(void)
{{
    const long n = {rows};
    S *const in = malloc(sizeof(S) * (size_t)(n * {reads})), *const out = malloc(sizeof(S) * (size_t)(n * {gives}));
    int *const status = malloc(sizeof(int) * (size_t)n);
    if (fread(in, sizeof(S) * {reads}, (size_t)n, stdin) != (size_t)n) return 1;
    void *const tables[] = {{{tables}}};
    const long steps[] = {{{steps}}};
    many(0, n, tables, steps, status);
    fwrite(out, sizeof(S) * {gives}, (size_t)n, stdout);
    fwrite(status, sizeof(int), (size_t)n, stdout);
    return 0;
}}
"""


@FORMATS
@of_each
def test_neon_has_the_same(asked, format, tmp_path):
    """Debian's gcc-aarch64-linux-gnu and qemu-user run it."""
    for tool in ("aarch64-linux-gnu-gcc", "qemu-aarch64"):
        if shutil.which(tool) is None:
            pytest.skip(f"{tool} is not here (Debian: gcc-aarch64-linux-gnu, libc6-dev-arm64-cross, qemu-user)")
    program, rows = asked
    kind = PRECISIONS[format].type
    sizes = {"in": [p.size for p in program.inputs], "out": [p.size for p in program.outputs]}
    tables, steps = [], []
    for word, ports in sizes.items():
        for k in range(len(ports)):
            tables.append(f"{word} + {sum(ports[:k])}")
            steps += [str(sum(ports)), "1"]
    reads, gives = (sum(ports) for ports in sizes.values())
    told = {"rows": ROWS, "reads": reads, "gives": gives, "tables": ", ".join(tables), "steps": ", ".join(steps)}
    (tmp_path / "neon.c").write_text(source(program, format, Width("neon", (), 32)) + MAIN.format(**told))
    flags = ["-std=gnu99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math", "-Wno-psabi", "-static"]
    made = [*flags, str(tmp_path / "neon.c"), "-o", str(tmp_path / "neon"), "-lm"]
    subprocess.run(["aarch64-linux-gnu-gcc", *made], check=True)
    given = rows.astype(kind).tobytes()
    done = subprocess.run(["qemu-aarch64", str(tmp_path / "neon")], input=given, capture_output=True, check=True)
    found = np.frombuffer(done.stdout[: -4 * ROWS], dtype=kind).reshape(ROWS, gives)
    status = np.frombuffer(done.stdout[-4 * ROWS :], dtype=np.int32)
    same(found, status, c_answers(program, rows, PRECISIONS[format]))


def test_what_is_no_angle_has_one_status(tmp_path, monkeypatch):
    """NaN, infinities and angles from 1e5 rad on, in any input: NumPy's, C's, the lanes' and the bits' are the same."""
    compiler()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    model = ccpin.ReducedModel(ccpin.load("slider_crank"))
    program = programs.record(model, ["sigma", "v_free"], given="near", steps=1)
    wrong = (np.nan, np.inf, -np.inf, 1e6, -1e6, 1e5, -1e5, np.nextafter(1e5, 0.0), 1e200)
    example = np.array(program.example)
    rows = np.tile(example, (len(example), len(wrong), 1))
    for k in range(len(example)):
        rows[k, :, k] = wrong
    rows = np.vstack([rows.reshape(-1, len(example)), example])
    given = np.split(rows, np.cumsum([port.size for port in program.inputs])[:-1], axis=1)
    status = program(**dict(zip((port.name for port in program.inputs), given, strict=True))).status
    angles = [k for k, name in enumerate((*program.inputs[0].entries, *program.inputs[1].entries)) if name != "slider"]
    by_input = status[:-1].reshape(len(example), len(wrong))
    assert (by_input[angles, :7] == 1).all()
    assert (by_input[angles, 7] != 1).any()
    assert status[-1] == 0
    np.testing.assert_array_equal(status, exported(program, tmp_path)(rows)[1])
    np.testing.assert_array_equal(status, programs.compiled(program)(*given)[-1])
    np.testing.assert_array_equal(status, c_answers(program, rows, PRECISIONS["double"]).status)
    for k in range(len(rows)):
        one = {port.name: table[k] for port, table in zip(program.inputs, given, strict=True)}
        assert program(**one).status == status[k]
