"""Sweeps: rows and errors, seeds, any workers, and taking up what a kill left."""

import csv
import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import ccpin
from ccpin import sweep
from ccpin.description import scaled
from ccpin.errors import InvalidInputError
from ccpin.simulation import grid, latin_hypercube, sobol
from tests.support.backends import same_on_both
from tests.support.places import ROOT
from tests.support.sweep_tasks import deadly, drawn, parabola, slow

CASES = [{"x": float(x)} for x in (3, -1, 2, 0)]


def test_a_row_for_every_case():
    """Results stand beside their cases in the order asked for; a failure is a row with its error."""
    found = sweep(parabola, CASES)
    assert found.complete
    assert found.table() == {
        "x": [3.0, -1.0, 2.0, 0.0],
        "y": [9.0, None, 4.0, 0.0],
        "both_0": [3.0, None, 2.0, 0.0],
        "both_1": [6.0, None, 4.0, 0.0],
        "error": ["", "ValueError: x = -1.0 is negative", "", ""],
    }


def test_the_table_as_csv(tmp_path):
    """Numbers are written so that they read back the same."""
    found = sweep(parabola, [{"x": 0.1}, {"x": np.float64(1 / 3)}])
    found.save(tmp_path / "table.csv")
    rows = list(csv.DictReader((tmp_path / "table.csv").open(encoding="utf-8")))
    assert [float(row["y"]) for row in rows] == [0.1**2, (1 / 3) ** 2]


def test_the_table_as_parquet(tmp_path):
    """Parquet holds the same columns; another ending is refused."""
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    found = sweep(parabola, CASES)
    found.save(tmp_path / "table.parquet")
    pandas.testing.assert_frame_equal(pandas.read_parquet(tmp_path / "table.parquet"), found.to_pandas())
    with pytest.raises(InvalidInputError, match=r"\.csv or \.parquet"):
        found.save(tmp_path / "table.xls")


def test_pandas_gets_the_table():
    """`to_pandas` has a column a name."""
    pandas = pytest.importorskip("pandas")
    frame = sweep(parabola, CASES).to_pandas()
    assert isinstance(frame, pandas.DataFrame)
    assert list(frame.columns) == ["x", "y", "both_0", "both_1", "error"]


def test_seeds_belong_to_cases():
    """The same seeds whoever computes, in whatever order; other places, other seeds."""
    cases = [{"x": x} for x in range(6)]
    serial, pooled = sweep(drawn, cases, seed=7), sweep(drawn, cases, seed=7, workers=2)
    assert serial == pooled
    assert len(set(serial.table()["noise"])) == 6
    assert sweep(drawn, cases[:3], seed=7).table()["noise"] == serial.table()["noise"][:3]
    assert sweep(drawn, cases, seed=8).table()["noise"] != serial.table()["noise"]


@pytest.mark.slow
@same_on_both
def test_a_dask_cluster_gives_the_same_table():
    """Any executor computes the same rows."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        assert sweep(parabola, CASES, executor=client.get_executor()) == sweep(parabola, CASES)


def test_a_dead_worker_is_a_row():
    """A case that kills its process fails alone; all others are computed."""
    found = sweep(deadly, [{"x": x, "dies": x == 2} for x in range(8)], workers=2)
    assert found.table()["y"] == [0, 1, None, 3, 4, 5, 6, 7]
    assert [number for number, error in enumerate(found.errors) if error] == [2]
    assert "process died" in found.errors[2]


def test_rows_are_found_again(tmp_path):
    """The file keeps what was computed, failures too; only new cases run, and a line cut off is dropped."""
    folder, path = tmp_path / "ran", tmp_path / "sweep.jsonl"
    folder.mkdir()
    cases = [{"x": x, "folder": str(folder)} for x in range(4)]
    first = sweep(slow, cases[:3], path=path, name="slow")
    with path.open("ab") as file:
        file.write(b'{"case": "half a li')
    seen = []
    second = sweep(slow, cases, path=path, name="slow", progress=lambda report: seen.append(tuple(report)))
    assert second.results[:3] == first.results
    assert seen == [(3, 0, 4), (4, 0, 4)]
    assert all((folder / f"ran_{x}").read_text() == "x" for x in range(4))
    assert sweep(slow, cases, path=path, name="slow") == second


PROGRAM = """
import sys
from ccpin import sweep
from tests.support.sweep_tasks import slow
if __name__ == "__main__":
    sweep(slow, [{"x": x, "folder": sys.argv[1]} for x in range(40)], path=sys.argv[2], workers=2, name="slow")
"""


@same_on_both
def test_killed_and_taken_up_again(tmp_path):
    """After kill −9 of the caller alone the rows that were written are not computed again, and no worker is left."""
    folder, path = tmp_path / "ran", tmp_path / "sweep.jsonl"
    folder.mkdir()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([*sys.path, str(ROOT)])}
    arguments = [sys.executable, "-c", PROGRAM, str(folder), str(path)]
    process = subprocess.Popen(arguments, env=environment, stdout=subprocess.PIPE, cwd=ROOT)
    while not path.exists() or path.read_bytes().count(b"\n") < 6:
        assert process.poll() is None
        time.sleep(0.02)
    process.kill()
    process.wait()
    kept = path.read_bytes().count(b"\n") - 1
    assert 0 < kept < 40
    found = sweep(slow, [{"x": x, "folder": str(folder)} for x in range(40)], path=path, name="slow")
    assert found.complete
    assert found.table()["y"] == list(range(40))
    once = [x for x in range(40) if (folder / f"ran_{x}").read_text() == "x"]
    assert len(once) >= 40 - 4  # at most those at work, and those done but not yet written, ran twice
    process.communicate(timeout=60)  # its output ends when the last process that has it ends


def test_an_interrupt_returns_what_is_done(tmp_path):
    """Ctrl-C between cases: the rows so far come back, and the file goes on from there."""

    def stop(report):
        if report.done == 2:
            signal.raise_signal(signal.SIGINT)

    found = sweep(parabola, CASES, progress=stop, path=tmp_path / "rows", name="parabola")
    assert not found.complete
    assert [result is not None or bool(error) for result, error in zip(found.results, found.errors, strict=True)] == [
        *(True, True, False, False)
    ]
    assert sweep(parabola, CASES, path=tmp_path / "rows", name="parabola") == sweep(parabola, CASES)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((parabola, [3.0]), "case 0 is 3.0"),
        ((parabola, [{"x": object()}]), "case 0: <object"),
        ((3, CASES), "function of a case"),
    ],
)
def test_bad_arguments(arguments, words):
    """What is no case and no task is refused before anything runs."""
    with pytest.raises(InvalidInputError, match=words):
        sweep(*arguments)


def test_tasks_must_travel():
    """A task of this function's own cannot be sent to other processes; in this one it can run."""
    with pytest.raises(InvalidInputError, match="define it in a module"):
        sweep(lambda case: {"y": 1}, CASES, workers=2)
    assert sweep(lambda case: {"y": 1}, CASES).table()["y"] == [1] * 4
    assert sweep(partial(parabola), CASES, workers=2) == sweep(parabola, CASES)


def test_another_sweeps_file(tmp_path):
    """A file of another task, or of something else, is left alone."""
    path = tmp_path / "rows"
    sweep(parabola, CASES, path=path, name="parabola")
    before = path.read_bytes()
    with pytest.raises(InvalidInputError, match="another task: task is parabola there and drawn here"):
        sweep(drawn, CASES, path=path, name="drawn")
    assert path.read_bytes() == before
    Path(tmp_path / "text").write_text("dear diary")
    with pytest.raises(InvalidInputError, match="no journal"):
        sweep(parabola, CASES, path=tmp_path / "text", name="parabola")


def scaled_by(case, model):
    return {"y": float(model.at(np.array([-1.8, -1.3]) + 0.0 * case["x"]).g[0])}


class Task:
    """A task that is no function: its numbers tell what it does."""

    def __init__(self, factor):
        self.factor = factor

    def __call__(self, case):
        return {"y": self.factor * case["x"]}


def test_rows_are_of_one_task_and_one_package(tmp_path, monkeypatch):
    """Functions need a name; another's numbers, another mechanism and another version of ccpin are another task."""
    path = tmp_path / "rows"
    with pytest.raises(InvalidInputError, match="give name="):
        sweep(parabola, CASES, path=path)
    assert not path.exists()
    cases = [{"x": 1.0}]
    assert sweep(Task(2.0), cases, path=path).table()["y"] == [2.0]
    with pytest.raises(InvalidInputError, match="another task: digest"):
        sweep(Task(3.0), cases, path=path)
    light = ccpin.ReducedModel(ccpin.load("rpdr"))
    heavy = ccpin.ReducedModel(ccpin.load(scaled(light.mechanism.settled(), masses=2.0)))
    first = sweep(partial(scaled_by, model=light), cases, path=tmp_path / "models", name="g").table()["y"]
    with pytest.raises(InvalidInputError, match="another task: digest"):
        sweep(partial(scaled_by, model=heavy), cases, path=tmp_path / "models", name="g")
    again = ccpin.ReducedModel(ccpin.load("rpdr"))
    assert sweep(partial(scaled_by, model=again), cases, path=tmp_path / "models", name="g").table()["y"] == first
    monkeypatch.setattr("ccpin.simulation.studies.origins.code_digest", lambda *rooms: b"another version")
    with pytest.raises(InvalidInputError, match="another task: code"):
        sweep(Task(2.0), cases, path=path)


def test_grid():
    """Every combination, the last name's changing fastest."""
    assert grid({"a": [1, 2], "b": "xy"}) == [{"a": a, "b": b} for a in (1, 2) for b in "xy"]
    with pytest.raises(InvalidInputError, match="at least one value"):
        grid({"a": []})


def test_latin_hypercube():
    """Each slice of each range has one point; the same seed gives the same points."""
    cases = latin_hypercube({"a": (0.0, 1.0), "b": (-2.0, 2.0)}, 16, seed=3)
    assert sorted(int(case["a"] * 16) for case in cases) == list(range(16))
    assert sorted(int((case["b"] + 2) * 4) for case in cases) == list(range(16))
    assert cases == latin_hypercube({"a": (0.0, 1.0), "b": (-2.0, 2.0)}, 16, seed=3)


def test_sobol():
    """Any count; of 2^m points each half of each range has half."""
    cases = sobol({"a": (0.0, 1.0), "b": (0.0, 1.0)}, 32)
    assert sum(case["a"] < 0.5 for case in cases) == sum(case["b"] < 0.5 for case in cases) == 16
    assert sobol({"a": (0.0, 1.0), "b": (0.0, 1.0)}, 20) == cases[:20]


@pytest.mark.parametrize("ranges", [{"a": (1.0, 0.0)}, {"a": 3.0}, {"a": (0.0, np.inf)}, {}])
def test_bad_ranges(ranges):
    """Bounds must be two finite increasing numbers."""
    with pytest.raises(InvalidInputError, match="ranges must be"):
        latin_hypercube(ranges, 4)
