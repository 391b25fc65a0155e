"""What is asked of a certificate's work: odd numbers are refused by name, large ones end, and nothing is lost."""

import multiprocessing
import os

import numpy as np
import pytest
from scipy.interpolate import BSpline, PPoly

from ccpin import control, domain, dynamics
from ccpin.arrays import numbers, positive, whole
from ccpin.covering.runner import ChunkStore
from ccpin.domain.closures.system import reading_of
from ccpin.errors import InvalidInputError
from ccpin.work import executor_for

REGION = np.radians([[-112.0, -76.0], [-104.0, -68.0]])
GOAL = np.radians((-108.0, -72.0))
FULL = np.array([[-np.pi, -np.pi], [np.pi, np.pi]])


def test_truth_values_are_no_numbers():
    """``max_depth=True`` was a depth of 1."""
    for check in (whole, positive):
        with pytest.raises(InvalidInputError, match="depth = True"):
            check(True, "depth")


def test_imaginary_parts_are_not_lost():
    """Of an array, and of arrays in a tuple or a list."""
    for value in (np.ones(2) * 1j, (np.ones(2) * 1j, np.ones(2)), [1.0, 2.0j]):
        with pytest.raises(InvalidInputError, match="is not an array of numbers"):
            numbers(value, "q")


@pytest.mark.parametrize(
    "call",
    [
        lambda robot: domain.certify(robot, GOAL, REGION, progress=3),
        lambda robot: domain.certify_sheets(robot, REGION, progress=3),
        lambda robot: domain.certify_singularities(robot, REGION, progress=3),
        lambda robot: domain.singularities(robot, progress=3),
        lambda robot: control.certify_set_point(robot, GOAL, 50.0, 5.0, progress=3),
        lambda robot: dynamics.assembly_modes(robot, GOAL, progress=3),
        lambda robot: domain.design(lambda x: robot, {"a": (1.0, 2.0)}, lambda x: 1.0, progress=3),
    ],
)
def test_progress_is_a_function(rpdr, call):
    """It was called, and a TypeError ended the work."""
    with pytest.raises(InvalidInputError, match="progress must be a function, not int"):
        call(rpdr)


def test_a_time_beyond_all_clocks_is_no_limit(rpdr, capfd):
    """A thread died of an OverflowError, and said so."""
    assert domain.certify(rpdr, GOAL, REGION, seconds=1e12).complete
    assert capfd.readouterr().err == ""


def test_work_that_would_fill_the_memory_ends_at_its_budget(rpdr):
    """What was proved is kept, and more of it with a larger one."""
    some = domain.certify(rpdr, GOAL, FULL, max_depth=31, budget=1500)
    more = domain.certify(rpdr, GOAL, FULL, max_depth=31, budget=3000)
    assert not some.complete
    assert not more.complete
    assert 1500 <= len(some.boxes.kappa) < len(more.boxes.kappa) < 6000
    assert some.contains(GOAL)
    assert domain.certify(rpdr, GOAL, REGION).complete


def test_no_more_processes_than_can_run():
    """A thousand workers are no more than the machine can use."""
    with executor_for(None, 1000) as pool:
        assert pool.submit(abs, -1).result() == 1
        assert len(multiprocessing.active_children()) <= 2 * (os.cpu_count() or 1)


@pytest.mark.parametrize(
    "path",
    [
        lambda: PPoly(np.zeros((1, 1, 2)), [1.0, 0.0]),
        lambda: PPoly(np.zeros((1, 2, 2)), [2.0, 1.0, 0.0]),
        lambda: PPoly.construct_fast(np.zeros((1, 0, 2)), np.array([1.0])),
        lambda: PPoly.construct_fast(np.zeros((1, 0, 2)), np.array([])),
        lambda: PPoly.construct_fast(np.zeros((1, 1, 2)), np.array([0.0, 1.0, 2.0])),
        lambda: BSpline.construct_fast(np.zeros(8), np.zeros((4, 2)), 3),
        lambda: BSpline.construct_fast(np.zeros(2), np.zeros((1, 2)), 1),
        lambda: BSpline.construct_fast(np.array([1.0]), np.zeros((0, 2)), 0),
        lambda: PPoly.construct_fast(np.zeros((1, 1, 2)) * 1j, np.array([0.0, 1.0])),
    ],
)
def test_paths_that_do_not_go_on(rpdr, path):
    """Knots that decrease, one knot, none."""
    with pytest.raises(InvalidInputError):
        domain.certify_path(rpdr, path())


@pytest.mark.parametrize("folder", ["", "file", "file/below", "/dev/null", "/proc/ccpin", "bad\0name", 3])
def test_a_checkpoint_is_a_folder(rpdr, tmp_path, folder, monkeypatch):
    """It was a traceback; and nothing is left in the present folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InvalidInputError, match="checkpoint"):
        domain.certify(rpdr, GOAL, REGION, checkpoint=folder)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_damaged_checkpoints_are_computed_again(rpdr, tmp_path):
    """Cut off, overwritten, exchanged: no error, and the same result, wherever the damage is."""
    problem = reading_of(rpdr, rpdr.q_reference).problem
    store, arrays = ChunkStore(tmp_path, problem), (np.arange(6.0), np.array([True, False]))

    def task(problem, arrays):
        raise NotImplementedError

    keys = [store.key(task, (np.array([k]),)) for k in range(2)]
    for key in keys:
        store.save(key, arrays)
    file = tmp_path / f"{keys[0]}.chunk"
    whole_file, generator = file.read_bytes(), np.random.default_rng(4)
    file.write_bytes((tmp_path / f"{keys[1]}.chunk").read_bytes())
    assert store.load(keys[0]) is None
    for place in generator.integers(len(whole_file), size=300).tolist():
        damaged = bytearray(whole_file)
        damaged[place] ^= int(generator.integers(1, 256))
        file.write_bytes(bytes(damaged[:place]) if place % 5 == 0 else bytes(damaged))
        found = store.load(keys[0])
        assert found is None or all(np.array_equal(one, other) for one, other in zip(found, arrays, strict=True))
    file.write_bytes(whole_file)
    assert np.array_equal(store.load(keys[0])[0], arrays[0])
