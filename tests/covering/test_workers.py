"""How the sheets' work is done, stopped, spread, kept and saved: none of it changes what is found."""

import signal
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.domain import SheetAtlas, certify_sheets, scalar_coordinates_at
from ccpin.errors import InvalidInputError
from tests.oracles import rpdr as five_bar
from tests.support.long_cases import later

TORUS = (np.full(2, -np.pi), np.full(2, np.pi))


def arrays(atlas):
    """All numbers of an atlas."""
    return (*atlas.boxes, *atlas.tree.cells, *atlas.members, *atlas.glued, atlas.count, *atlas.left, *atlas.ranges)


def same(one, other):
    """Whether two are the same, bit for bit."""
    pairs = zip(arrays(one), arrays(other), strict=True)
    return one.complete == other.complete and all(np.array_equal(a, b) for a, b in pairs)


def wrong(atlas):
    """How many of 20,000 points are counted otherwise than the closed form has them."""
    q = np.random.default_rng(5).uniform(-np.pi, np.pi, (20_000, 2))
    counted = atlas.number_of_solutions(q)
    reach = np.hypot(*five_bar.elbow_offset(q.T)) / (five_bar.A3 + five_bar.A4)
    return int(np.count_nonzero((counted >= 0) & (counted != np.where(reach < 1.0, 2, 0))))


@pytest.fixture(scope="module")
def told():
    """What progress was told while `torus` was made."""
    return []


@pytest.fixture(scope="module")
def torus(rpdr, told):
    """The five-bar's sheets, roughly."""
    return certify_sheets(rpdr, TORUS, max_depth=5, progress=told.append)


@pytest.mark.slow
def test_workers_and_checkpoints_do_not_change_the_sheets(rpdr, torus, tmp_path):
    """Two threads, a process and a folder of chunks give the same, bit for bit; a second call finds the chunks."""
    assert same(torus, certify_sheets(rpdr, TORUS, max_depth=5, workers=2))
    with ProcessPoolExecutor(1) as pool:
        assert same(torus, certify_sheets(rpdr, TORUS, max_depth=5, executor=pool, checkpoint=tmp_path))
    kept = {file.name: file.stat().st_mtime_ns for file in tmp_path.iterdir()}
    assert len(kept) > 5
    assert same(torus, certify_sheets(rpdr, TORUS, max_depth=5, checkpoint=tmp_path))
    assert {file.name: file.stat().st_mtime_ns for file in tmp_path.iterdir()} == kept


@pytest.mark.parametrize("suffix", ["npz", "json"])
def test_what_is_loaded_is_what_was_saved(torus, rpdr, tmp_path, suffix):
    """In both forms, with what follows from it; files of another kind and damaged ones are refused."""
    path = tmp_path / f"sheets.{suffix}"
    torus.save(path)
    back = SheetAtlas.load(path)
    assert same(torus, back)
    assert [sheet.area for sheet in back.sheets] == [sheet.area for sheet in torus.sheets]
    assert np.all(back.verify())
    assert back.fingerprint == torus.fingerprint
    assert back.is_about(rpdr)
    assert not back.is_about(ccpin.load("planar_3rrr"))
    with pytest.raises(InvalidInputError, match="the format is 'ccpin-sheets-2', not 'ccpin-atlas"):
        domain.Atlas.load(path)
    path.write_bytes(path.read_bytes()[:5000])
    with pytest.raises(InvalidInputError, match="cannot be read"):
        SheetAtlas.load(path)


def test_progress_is_told(torus, told):
    """First of the search, then of boxes; the last share is that of the atlas."""
    assert told[0].boxes == 0 < told[0].waiting
    assert told[-1].boxes == len(torus.boxes.kappa)
    assert told[-1].certified == pytest.approx(torus.certified_fraction)


@pytest.mark.parametrize("depth", later(5, 6))
@pytest.mark.parametrize("share", later(0.02, 0.5))
def test_an_end_by_the_clock_keeps_what_is_proved(rpdr, share, depth):
    """Wherever it ends, nothing that is counted is wrong, all boxes hold, and the rest is undecided."""
    start = time.perf_counter()
    certify_sheets(rpdr, TORUS, max_depth=depth)
    most = share * (time.perf_counter() - start)
    start = time.perf_counter()
    atlas = certify_sheets(rpdr, TORUS, max_depth=depth, seconds=most)
    assert not atlas.complete
    assert time.perf_counter() - start < most + 30.0
    assert "interrupted" in repr(atlas)
    assert np.all(atlas.verify())
    assert wrong(atlas) == 0
    assert atlas.counted_fraction + atlas.singular_fraction + atlas.undecided_fraction == pytest.approx(1.0, abs=1e-12)


@pytest.mark.slow
def test_half_of_the_time_is_for_boxes(rpdr):
    """A search that would not end leaves time to count and certify what it found."""
    atlas = certify_sheets(rpdr, TORUS, max_depth=14, budget=100_000_000, seconds=8.0)
    assert not atlas.complete
    assert atlas.counted_fraction > 0.0
    assert atlas.certified_fraction > 0.0
    assert wrong(atlas) == 0


PROGRAM = """
import os, signal, sys, numpy as np, ccpin
from ccpin.domain import certify_sheets
waves = []
def stop(progress):
    waves.append(progress)
    if {when}:
        os.kill(os.getpid(), signal.{signal})
whole = np.full(2, np.pi)
atlas = certify_sheets(ccpin.load("rpdr"), (-whole, whole), max_depth=5, checkpoint=sys.argv[1], progress=stop)
atlas.save(sys.argv[2])
"""


@pytest.mark.slow
@pytest.mark.parametrize("when", ["len(waves) == 3", "progress.boxes > 300"])
def test_ctrl_c_and_kill(rpdr, torus, tmp_path, when):
    """Ctrl-C in the search or among the boxes keeps what is proved; after a kill the chunks are found again."""
    chunks, saved = tmp_path / "chunks", tmp_path / "sheets.npz"
    program = [sys.executable, "-c", PROGRAM.format(when=when, signal="SIGKILL"), str(chunks), str(saved)]
    assert subprocess.run(program, check=False).returncode == -signal.SIGKILL
    assert not saved.exists()
    kept = {file.name for file in chunks.iterdir()}
    assert kept
    program[2] = PROGRAM.format(when=when, signal="SIGINT")
    assert subprocess.run(program, check=False).returncode == 0
    atlas = SheetAtlas.load(saved)
    assert not atlas.complete
    assert wrong(atlas) == 0
    assert (len(atlas.boxes.kappa) > 0) == (when == "progress.boxes > 300")
    assert 10 * len(atlas.sheets) < max(1, len(atlas.boxes.kappa))
    assert same(torus, certify_sheets(rpdr, TORUS, max_depth=5, checkpoint=chunks))
    assert kept < {file.name for file in chunks.iterdir()}


@pytest.mark.parametrize("seconds", later(0.7, 1.5))
def test_an_exhaustive_search_for_empty_cells_ends_in_time(seconds):
    """`certify(exhaustive=True)` looks at the clock (and at Ctrl-C) while it searches, for minutes at this depth."""
    mechanism = ccpin.load("planar_3rrr")
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    start = time.perf_counter()
    atlas = domain.certify(mechanism, q0, max_depth=4, exhaustive=True, resolution=0.1, seconds=seconds)
    assert time.perf_counter() - start < 60.0
    assert not atlas.complete
    assert len(atlas.boxes.kappa)


def test_wrong_arguments_of_the_work_are_named(rpdr):
    """Seconds that are none, fewer workers than one."""
    for arguments in ({"seconds": 0.0}, {"seconds": "long"}, {"workers": 0}, {"budget": 0}):
        with pytest.raises(InvalidInputError):
            certify_sheets(rpdr, TORUS, **arguments)
