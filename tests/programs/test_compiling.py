"""The compiler and the cache: what is planted, cut short or somebody else's is not loaded; bad compilers are told."""

import multiprocessing
import os
import stat
from concurrent.futures import ProcessPoolExecutor
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin import programs
from ccpin.errors import CcpinError
from ccpin.programs import compiling
from ccpin.programs.certified_region import CertifiedRegion
from ccpin.programs.compiling import DIGEST, LIBRARY, NoCompilerError, compiler
from ccpin.programs.instructions import Kind
from ccpin.programs.lanes import CompiledProgram, Width, _made_of, source
from ccpin.programs.program import Port
from tests.support.long_cases import later

try:
    FOUND = compiler()[0]
except NoCompilerError as error:
    pytest.skip(str(error), allow_module_level=True)


@pytest.fixture(scope="module")
def program():
    """A small one."""
    return programs.record(ccpin.ReducedModel(ccpin.load("four_bar")), "rho")


@pytest.fixture
def cache(monkeypatch, tmp_path):
    """A cache of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    return tmp_path / "ccpin" / "programs"


@pytest.fixture
def forbidden(monkeypatch):
    """Call it, and nothing is compiled any more."""

    def forbid():
        def refuse(*_):
            raise AssertionError("compiled again")

        monkeypatch.setattr(compiling, "_compile", refuse)

    return forbid


def example(program):
    """The example's inputs."""
    return np.split(np.array(program.example), np.cumsum([port.size for port in program.inputs])[:-1])


def right(program):
    """Whether the compiled program gives NumPy's numbers."""
    inputs = example(program)
    wanted = program(**dict(zip((port.name for port in program.inputs), inputs, strict=True)))
    return np.allclose(CompiledProgram(program)(*inputs)[0][0], wanted["rho"], rtol=1e-12, atol=1e-12)


def script(folder, text):
    """A program that stands for a compiler."""
    path = folder / "compiler"
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return str(path)


def kept(cache):
    """Folders of libraries in the cache."""
    return sorted(path for path in cache.iterdir() if path.is_dir())


def test_it_is_compiled_once(program, cache, forbidden):
    """The folder and all in it is the user's alone; the second time nothing is compiled."""
    assert right(program)
    (folder,) = kept(cache)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700
    assert {path.name for path in folder.iterdir()} == {LIBRARY, DIGEST}
    assert all(not path.stat().st_mode & 0o022 for path in (folder, *folder.iterdir()))
    forbidden()
    assert right(program)


def test_an_open_folder_is_closed(program, cache):
    """Mode 777 becomes 700 before anything is put there."""
    cache.mkdir(parents=True)
    cache.chmod(0o777)
    assert right(program)
    assert stat.S_IMODE(cache.stat().st_mode) == 0o700


@pytest.mark.parametrize("damage", ["planted", "link", "open", *later("told", "cut", "no digest", "file")])
def test_what_is_not_what_was_compiled_is_not_loaded(program, cache, damage):
    """It is compiled anew in its place: a library cut short or replaced, a link, one that others can write."""
    assert right(program)
    (folder,) = kept(cache)
    library = folder / LIBRARY
    whole = library.read_bytes()
    if damage in ("cut", "planted"):
        library.unlink()  # it is in use: another file takes its place
        library.write_bytes(whole[: len(whole) // 2] if damage == "cut" else b"not what was compiled")
    elif damage == "told":
        (folder / DIGEST).write_bytes(b"\xff\xfe")
    elif damage == "link":
        library.rename(cache.parent / "elsewhere.so")
        library.symlink_to(cache.parent / "elsewhere.so")
    elif damage == "open":
        library.chmod(0o777)
    elif damage == "no digest":
        (folder / DIGEST).unlink()
    else:
        for path in folder.iterdir():
            path.unlink()
        folder.rmdir()
        folder.write_text("a file")
    assert right(program)
    assert kept(cache) == [folder]
    assert compiling._is_own(folder)
    assert not library.is_symlink()


def test_somebody_elses_folder_or_file(program, cache, monkeypatch):
    """The folder is refused; a library of somebody else's in it is not loaded."""
    assert right(program)
    (folder,) = kept(cache)
    me = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: me + 1)
    assert not compiling._is_own(folder)
    with pytest.raises(CcpinError, match="somebody else"):
        CompiledProgram(program)


def test_a_folder_that_is_a_link_or_cannot_be_made(program, cache, tmp_path):
    """Both are refused."""
    (tmp_path / "real").mkdir()
    cache.parent.mkdir()
    cache.symlink_to(tmp_path / "real")
    with pytest.raises(CcpinError, match="is a link"):
        CompiledProgram(program)
    cache.unlink()
    cache.write_text("")
    with pytest.raises(CcpinError, match="no folder"):
        CompiledProgram(program)


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("kill -9 $$", "killed by signal 9"),
        ("echo 'no such flag' >&2; exit 1", "no such flag"),
        ("exit 0", "does not load"),
        ('for word; do case "$before" in -o) echo hello > "$word";; esac; before=$word; done', "does not load"),
        (f'exec {FOUND} "$@" -Dmany=other', "does not load"),
    ],
)
def test_hostile_compilers(program, cache, monkeypatch, tmp_path, text, told):
    """Killed, failing, lying, or of something else: an error says what, and the cache stays empty."""
    monkeypatch.setenv("CC", script(tmp_path, text))
    with pytest.raises(NoCompilerError, match=told):
        CompiledProgram(program)
    assert list(cache.iterdir()) == []


def test_a_compiler_that_computes_something_else(program, cache, monkeypatch, tmp_path):
    """The example does not come out: a coefficient of the sine is another."""
    swap = 'for word; do case "$word" in *.c) sed -i "s/0[.]16666/0.17777/g" "$word";; esac; done; '
    monkeypatch.setenv("CC", script(tmp_path, f'{swap}exec {FOUND} "$@"'))
    with pytest.raises(NoCompilerError, match="something else"):
        CompiledProgram(program)
    assert list(cache.iterdir()) == []


def test_what_cc_may_be(program, cache, monkeypatch):
    """Words after the compiler are its own; looser arithmetic among them is taken back; nonsense is told."""
    monkeypatch.setenv("CC", f"{FOUND} -Ofast -ffast-math -march=native")
    loose = CompiledProgram(program)(*example(program))[0]
    monkeypatch.delenv("CC")
    np.testing.assert_array_equal(loose, CompiledProgram(program)(*example(program))[0])
    assert len(kept(cache)) == 2
    for words, told in (("/no/such/cc", "no program"), ("gcc '", "no command"), ("cc; touch /tmp/x", "no program")):
        monkeypatch.setenv("CC", words)
        with pytest.raises(NoCompilerError, match=told):
            compiler()


def test_no_compiler_at_all(monkeypatch):
    """A model's batches are then the core's, and `backend` says so."""
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(NoCompilerError, match="no C compiler"):
        compiler()
    model = ccpin.ReducedModel(ccpin.load("four_bar"))
    own = programs.compiled(model)
    assert own.backend.name == model.backend.name
    assert "no C compiler" in own.backend.reason
    Q = model.alpha(model.mechanism.q_reference) + np.linspace(-0.05, 0.05, 5)[:, None]
    np.testing.assert_array_equal(own.sigma_many(Q), model.sigma_many(Q))


def _together(path: str, folder: str) -> bool:
    os.environ["XDG_CACHE_HOME"] = folder
    return bool(right(programs.Program.load(path)))


def test_two_processes_at_once(program, tmp_path):
    """Both get what is right, and one library is kept."""
    program.save(tmp_path / "program.json")
    with ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        jobs = [pool.submit(_together, str(tmp_path / "program.json"), str(tmp_path)) for _ in range(4)]
        assert all(job.result() for job in jobs)
    assert len(kept(Path(tmp_path) / "ccpin" / "programs")) == 1


def test_all_that_decides_the_text_decides_the_library(program, tmp_path):
    """A constant, an order, a check, a format or a width of its own: another library; a loaded program has the same."""
    n = program.code.inputs
    first = next(item for item in program.code.instructions if item.kind == Kind.SCALE)
    changed = tuple(
        item._replace(constant=-item.constant) if item is first else item for item in program.code.instructions
    )
    others = [
        replace(program, code=program.code._replace(instructions=changed)),
        replace(program, code=program.code._replace(outputs=program.code.outputs[::-1])),
        replace(program, pivots=tuple(pivot._replace(scale=2.0 * pivot.scale) for pivot in program.pivots)),
        replace(program, corrections=(program.code.outputs[0],)),
        replace(program, corrections=(program.code.outputs[0],), tolerance=1.0),
        replace(program, outputs=(*program.outputs, Port("more", (0,), "", ()))),
        replace(program, region=CertifiedRegion((-1.0,) * n, (1.0,) * n, ("double", "float"), "")),
        replace(program, region=CertifiedRegion((-1.0,) * n, (1.5,) * n, ("double", "float"), "")),
    ]
    deciding = {"inputs", "outputs", "code", "pivots", "corrections", "tolerance", "region"}
    assert {field.name for field in fields(program)} == deciding | {"name", "example", "around", "notes", "source"}
    wide, narrow = Width("avx512", (), 64), Width("sse2", (), 32)
    keys = [_made_of(each, "double", wide) for each in (program, *others)]
    keys += [_made_of(program, "float", wide), _made_of(program, "double", narrow)]
    assert len(set(keys)) == len(keys)
    texts = [source(each, "double", wide) for each in (program, *others)]
    assert len(set(texts)) == len(texts)
    program.save(tmp_path / "program.json")
    again = programs.Program.load(tmp_path / "program.json")
    assert _made_of(again, "double", wide) == keys[0]
    assert source(again, "double", wide) == texts[0]
