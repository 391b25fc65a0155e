"""Programs in lanes: NumPy's numbers, the same bits in every lane and width, whatever the strides, rows and threads."""

import os
import pickle
import platform
import signal
import threading
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import InvalidInputError
from ccpin.programs import lanes
from ccpin.programs.compiling import NoCompilerError, compiler
from ccpin.programs.lanes import CompiledProgram, InNumPy, Width, width
from ccpin.programs.program import Port, Program
from ccpin.programs.same_bits import c_answers
from ccpin.programs.sine_cosine import PRECISIONS
from ccpin.programs.tape import Tape

try:
    compiler()
except NoCompilerError as error:
    pytest.skip(str(error), allow_module_level=True)

ANKLE = "docs/howto/ankle.urdf"


@pytest.fixture(scope="module")
def program():
    """Q̈ of the five-bar at a known q′."""
    return programs.record(ccpin.ReducedModel(ccpin.load("rpdr")), "forward_dynamics")


@pytest.fixture(scope="module")
def inputs(program):
    """Rows about the example: y is no root there, which arithmetic does not mind."""
    around = np.split(np.array(program.example), np.cumsum([port.size for port in program.inputs])[:-1])
    rng = np.random.default_rng(3)
    return [part + 0.1 * rng.normal(size=(1003, len(part))) for part in around]


def test_numpys_numbers(program, inputs):
    """To rounding, with its status."""
    found, status = programs.compiled(program)(*inputs)
    wanted = program(**dict(zip((port.name for port in program.inputs), inputs, strict=True)))
    np.testing.assert_allclose(found, wanted["forward_dynamics"], rtol=1e-11, atol=1e-12)
    np.testing.assert_array_equal(status, wanted.status)


def test_single_precision(program, inputs):
    """To its own rounding, given and giving its own type."""
    found, _ = programs.compiled(program, "float")(*inputs)
    wanted, _ = programs.compiled(program)(*inputs)
    assert found.dtype == np.float32
    assert np.median(np.abs(found - wanted).max(axis=1) / np.abs(wanted).max(axis=1)) < 1e-6


def test_bits_depend_on_no_strides_rows_or_threads(program, inputs):
    """Columns, backwards, one row for all, one by one and three threads: bit for bit."""
    run = CompiledProgram(program)
    found, status = run(*inputs)
    by_column, _ = run(*(np.asfortranarray(each) for each in inputs))
    backwards, _ = run(*(each[::-1] for each in inputs))
    many, many_status = run(*(np.tile(each, (9, 1)) for each in inputs), threads=3)
    np.testing.assert_array_equal(found, by_column)
    np.testing.assert_array_equal(found, backwards[::-1])
    np.testing.assert_array_equal(np.tile(found, (9, 1)), many)
    np.testing.assert_array_equal(np.tile(status, 9), many_status)
    for row in (0, 5, 1002):
        np.testing.assert_array_equal(run(*(each[row] for each in inputs))[0], found[[row]])
    one = [inputs[0][0], *inputs[1:]]
    np.testing.assert_array_equal(run(*one)[0], run(np.tile(inputs[0][0], (1003, 1)), *inputs[1:])[0])


@pytest.mark.skipif(platform.machine() != "x86_64", reason="widths of x86-64")
def test_bits_are_the_same_on_every_width(program, inputs):
    """Two lanes of SSE2, four of AVX2, eight of AVX-512, as far as there are such."""
    found, _ = CompiledProgram(program)(*inputs)
    for vectors in (Width("sse2", (), 16), Width("sse2", (), 32), Width("avx2", ("-mavx2",), 32)):
        if vectors.name == "avx2" and width().name not in ("avx2", "avx512"):
            continue
        np.testing.assert_array_equal(CompiledProgram(program, "double", vectors)(*inputs)[0], found)


def test_a_program_of_many_pieces():
    """The ankle's q̈ is the core's at closed states."""
    model = ccpin.ReducedModel(ccpin.load(ANKLE))
    q = model.alpha(model.mechanism.q_reference)
    rng = np.random.default_rng(2)
    compiled = programs.compiled(model)
    Q, V, U = q + 0.05 * rng.uniform(-1, 1, (60, 2)), rng.normal(size=(60, 2)), rng.normal(size=(60, 2))
    found = compiled.forward_dynamics_many(Q, V, U)
    wanted = model.forward_dynamics_many(Q, V, U)
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-11 * np.abs(wanted).max())


def test_a_state_that_divides_by_nothing_is_refused():
    """Status 1 where a pivot vanishes, and only there: the four-bar's coupler in line with its rocker."""
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    program = programs.record(model, "rho")
    q, y = np.split(np.array(program.example), [1])
    flat = np.zeros_like(y)
    _, status = CompiledProgram(program)(np.tile(q, (3, 1)), np.array([y, flat, y]))
    assert list(status) == [0, program(q=q, y=flat).status, 0]


@pytest.mark.parametrize(("format", "most"), [("double", 1e-6), ("float", 2.0**-16)])
def test_a_correction_counts_as_small_up_to_its_bound(format, most):
    """Status 2 beyond the program's tolerance, or the format's rounding where that is more, in lanes and in NumPy."""
    tape, port = Tape(1), Port("x", (1,), "rad", ("x",))
    code = tape.code([tape.inputs[0] * 2])
    told = Program("twice", (port,), (port._replace(name="y"),), code, corrections=(0,), tolerance=1e-6)
    x = most * np.array([[0.999], [1.001], [-0.999], [-1.001], [np.nan]])
    _, status = CompiledProgram(told, format)(x)
    assert list(status) == [0, 2, 0, 2, 2]
    assert list(c_answers(told, x, PRECISIONS[format]).status) == list(status)


def test_wrong_inputs(program, inputs):
    """Too few, and of other shapes."""
    run = CompiledProgram(program)
    with pytest.raises(InvalidInputError, match="3 inputs for q, y, v, u"):
        run(*inputs[:3])
    with pytest.raises(InvalidInputError, match="u must be of shape"):
        run(*inputs[:3], inputs[3][:7])
    with pytest.raises(InvalidInputError, match="format"):
        programs.compiled(program, "half")
    for none in ("rpdr", None):
        with pytest.raises(InvalidInputError, match="program must be"):
            CompiledProgram(none)


NONE = {
    "complex numbers": lambda u: u * (1 + 1e-9j),
    "texts": lambda u: u.astype(str),
    "dates": lambda u: np.zeros(u.shape, dtype="datetime64[s]"),
    "objects": lambda u: [[object()] * u.shape[1]] * len(u),
    "ragged rows": lambda u: [[1.0], *u[1:].tolist()],
    "nothing": lambda u: None,
    "names": lambda u: {"u": u},
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("way", NONE)
@pytest.mark.parametrize("format", ["double", "float"])
def test_what_is_no_number_is_refused(program, inputs, way, format):
    """In lanes, and in NumPy where there is no compiler."""
    wrong = [*inputs[:3], NONE[way](inputs[3])]
    for run in (CompiledProgram(program, format), InNumPy(program)):
        with pytest.raises(InvalidInputError, match="u "):
            run(*wrong)


@pytest.mark.parametrize("threads", [0, -1, 1.0, True, "2", None, 2**70])
def test_threads_are_a_whole_number(program, inputs, threads):
    for run in (CompiledProgram(program), InNumPy(program)):
        with pytest.raises(InvalidInputError, match="threads = "):
            run(*inputs, threads=threads)


def test_more_threads_than_processors_are_as_many_as_these(program, inputs, monkeypatch):
    """A hundred million do not start; one processor's starts none."""
    run, wide = CompiledProgram(program), [np.tile(each, (9, 1)) for each in inputs]
    wanted = run(*wide)
    asked = list[object]()

    class Watched(ThreadPoolExecutor):
        def submit(self, fn, /, *args, **kwargs):
            asked.append(fn)
            return super().submit(fn, *args, **kwargs)

    pool = Watched(2)
    monkeypatch.setattr(lanes, "_helpers", lambda: pool)
    for processors in (1, 3, None):
        monkeypatch.setattr(lanes.os, "cpu_count", lambda processors=processors: processors)
        for found, due in zip(run(*wide, threads=10**8), wanted, strict=True):
            np.testing.assert_array_equal(found, due)
    assert len(asked) == 2
    pool.shutdown()


def test_threads_wait_for_the_next_call(program, inputs):
    """No call starts one where another waits."""
    run, wide = CompiledProgram(program), [np.tile(each, (9, 1)) for each in inputs]
    known = set[int | None]()
    for _ in range(20):
        run(*wide, threads=2)
        known |= {thread.ident for thread in threading.enumerate() if thread.name.startswith("ccpin-lanes")}
    assert 1 <= len(known) <= (os.cpu_count() or 1)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_a_fork_has_threads_of_its_own(program, inputs):
    """Those that wait stay behind: a child that relied on them would wait for ever."""
    run, wide = CompiledProgram(program), [np.tile(each, (9, 1)) for each in inputs]
    wanted = run(*wide, threads=2)
    child = os.fork()
    if not child:
        signal.alarm(60)
        found = run(*wide, threads=2)
        os._exit(not all(np.array_equal(a, b) for a, b in zip(found, wanted, strict=True)))
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.parametrize("format", ["double", "float"])
def test_memory_may_lie_as_it_likes(program, inputs, format):
    """Fields of packed records, odd offsets, the other byte order, whole numbers, lists, read-only: the same bits."""
    run = CompiledProgram(program, format)
    wanted, _ = run(*inputs)
    kind = wanted.dtype
    table = inputs[0].astype(kind)
    records = np.zeros(
        len(table), dtype=[("first", "i4" if format == "double" else "i2"), ("q", kind, table.shape[1:])]
    )
    records["q"] = table
    shifted = np.zeros(table.nbytes + 1, dtype=np.uint8)[1:].view(kind).reshape(table.shape)
    shifted[:] = table
    frozen = table.copy()
    frozen.flags.writeable = False
    for q in (records["q"], shifted, table.astype(kind.newbyteorder()), table.tolist(), table.astype(object), frozen):
        np.testing.assert_array_equal(run(q, *inputs[1:])[0], wanted)
    np.testing.assert_array_equal(run(*np.round(inputs).astype(np.int16))[0], run(*np.round(inputs))[0])


def test_a_pickle_is_compiled_where_it_is_read(program, inputs):
    """Or found in the cache; with its format and vectors."""
    for run in (CompiledProgram(program, "float", Width("sse2", (), 16)), InNumPy(program)):
        again = pickle.loads(pickle.dumps(run))
        assert again.program.digest == program.digest
        for found, wanted in zip(again(*inputs), run(*inputs), strict=True):
            assert found.dtype == wanted.dtype
            np.testing.assert_array_equal(found, wanted)
    assert again.__class__ is InNumPy


def test_threads_may_share_a_compiled_program(program, inputs):
    """Eight at once, each on two threads: the bits of one."""
    run, wide = CompiledProgram(program), [np.tile(each, (5, 1)) for each in inputs]
    shifted = [[np.roll(each, k, axis=0) for each in wide] for k in range(8)]
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda rows: run(*rows, threads=2), shifted))
    for rows, found in zip(shifted, answers, strict=True):
        for one, wanted in zip(found, run(*rows), strict=True):
            np.testing.assert_array_equal(one, wanted)
