"""Certificates whose work is interrupted, or whose helpers are gone: what is proved is kept, nobody waits in vain."""

import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.covering.runner import Runner, Work
from ccpin.domain import certify, certify_sheets
from ccpin.domain.closures.system import reading_of
from ccpin.domain.singular import cover, following
from ccpin.errors import DifferentSubjectsError, InvalidInputError
from ccpin.proof.cell_tree import WHOLE
from ccpin.work import ended, executor_for, side_by_side, stoppable
from tests.support.long_cases import later

TORUS = (np.full(2, -np.pi), np.full(2, np.pi))
GOAL = np.radians((-108.0, -72.0))


def press():
    signal.raise_signal(signal.SIGINT)


class Pressed:
    """Progress that presses Ctrl-C when it is told for the n-th time."""

    def __init__(self, at):
        self.at, self.told = at, 0

    def __call__(self, *_):
        self.told += 1
        if self.told == self.at:
            press()


@pytest.mark.parametrize("at", [pytest.param(2, marks=pytest.mark.slow), pytest.param(9, marks=pytest.mark.slow)])
def test_an_interrupted_search_for_sheets_goes_on(rpdr, at):
    """It kept nothing; it keeps its cells now, and goes on from them to the same counts."""
    whole = certify_sheets(rpdr, TORUS, max_depth=5)
    part = certify_sheets(rpdr, TORUS, max_depth=5, progress=Pressed(at))
    assert not part.complete
    resumed = certify_sheets(rpdr, TORUS, max_depth=5, begun=part)
    assert resumed.complete
    assert len(resumed.sheets) == len(whole.sheets) == 2
    assert resumed.counted_fraction == pytest.approx(whole.counted_fraction, abs=1e-9)
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (2000, 2))
    np.testing.assert_array_equal(resumed.number_of_solutions(q), whole.number_of_solutions(q))


def test_work_goes_on_only_where_it_was_begun(rpdr, tmp_path):
    """Another region, another mechanism, and what was loaded says that it was."""
    part = certify_sheets(rpdr, TORUS, max_depth=4, progress=Pressed(3))
    with pytest.raises(InvalidInputError, match="begun is of another region"):
        certify_sheets(rpdr, (TORUS[0], TORUS[1] - 0.5), begun=part)
    with pytest.raises(DifferentSubjectsError, match="goes on"):
        certify_sheets(ccpin.load("four_bar"), begun=part)
    part.save(tmp_path / "part.npz")
    loaded = domain.SheetAtlas.load(tmp_path / "part.npz")
    assert certify_sheets(rpdr, TORUS, max_depth=4, begun=loaded).source == str(tmp_path / "part.npz")


def test_cells_are_no_smaller_than_asked(rpdr):
    """Edges were halved beyond max_depth where they moved φ most."""
    found = certify_sheets(rpdr, (np.array([-3.0, -1.6]), np.array([-0.2, -1.5])), max_depth=3)
    open_cells = np.unique(found.left.cell)
    assert open_cells.size
    assert found.tree.size[open_cells].min() >= WHOLE >> 3


def test_design_hears_an_interrupt_within_a_certificate(rpdr):
    """The inner certificate swallowed it, its half result counted as whole, and the search went on."""
    asked = []

    def figure(mechanism):
        asked.append(1)
        return certify(mechanism, GOAL, progress=Pressed(3 if len(asked) == 4 else -1), max_depth=5)

    build = domain.scaled_links(rpdr.settled(), {"arms": ["link1", "link2"]})
    found = domain.design(build, {"arms": (0.95, 1.05)}, figure, evaluations=30)
    assert not found.complete
    assert len(asked) == 4
    assert found.trials[-1].reason == "interrupted: its certificate is not whole"
    assert found.trials[-1].figure == 0.0
    assert found.certificate.complete
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_a_figure_that_is_no_number_is_a_trial(rpdr):
    """NaN ended the search and lost all trials."""
    figures = iter([1.0, np.nan, 2.0, np.inf, 1.5] + [0.5] * 20)
    found = domain.design(lambda x: rpdr, {"a": (0.0, 1.0)}, lambda subject: next(figures), evaluations=8)
    assert found.figure == 2.0
    assert [trial.reason[:17] for trial in found.trials[:5]] == ["", "InvalidInputError", "", "InvalidInputError", ""]


def test_an_interrupt_reaches_all_that_wait_for_the_work():
    """And what is begun after it ends at once; afterwards Ctrl-C is what it was."""
    with stoppable() as outer:
        with stoppable() as inner:
            press()
            assert inner.is_set()
        assert outer.is_set()
        with stoppable() as later:
            assert later.is_set()
    with stoppable() as fresh:
        assert not fresh.is_set()
    with pytest.raises(KeyboardInterrupt):
        press()


class Gone:
    """An executor that takes work and never does it."""

    def __init__(self):
        self.taken = 0

    def submit(self, function, *arguments):
        self.taken += 1
        return Future()


class Closed:
    """One that takes none."""

    def submit(self, function, *arguments):
        raise OSError("the client is closed")


def test_nobody_waits_for_an_executor_that_is_gone(rpdr, monkeypatch):
    """A scheduler that had died was waited for for ever; the work is done here."""
    monkeypatch.setattr("ccpin.covering.runner._STALLED", 0.3)
    gone = Gone()
    alone = certify(rpdr, GOAL, (GOAL - 0.3, GOAL + 0.3))
    found = certify(rpdr, GOAL, (GOAL - 0.3, GOAL + 0.3), executor=gone)
    assert gone.taken >= 1
    assert np.array_equal(found.boxes.kappa, alone.boxes.kappa)


def test_a_slow_executor_is_not_given_up(rpdr):
    """What takes longer than a while is computed here, and the rest is the executor's."""
    problem = reading_of(rpdr, rpdr.q_reference).problem
    done = []

    class Slow:
        def submit(self, function, *arguments):
            future = Future()
            threading.Timer(0.05, lambda: (done.append(1), future.set_result(function(*arguments)))).start()
            return future

    runner = Runner(problem, Slow(), None, threading.Event())
    results = runner.map(lambda problem, arrays: (2.0 * arrays[0],), [(np.array([float(k)]),) for k in range(8)])
    assert [float(result[0][0]) for result in results] == [2.0 * k for k in range(8)]
    assert len(done) == 8


def test_a_closed_executor_is_told(rpdr):
    """By an error of ours."""
    with pytest.raises(InvalidInputError, match=r"takes no work .*the client is closed"):
        certify(rpdr, GOAL, executor=Closed())


@pytest.mark.parametrize("at", later(58, 100))  # about the start, in the map
def test_a_largest_workspace_is_interrupted_as_a_whole(at):
    """Ctrl-C in one of its surveys had ended that one alone; what was found is kept and is certified."""
    pressed = Pressed(at)
    found = domain.largest_cube(ccpin.EndEffector(ccpin.load("delta"), "platform"), work=Work(progress=pressed))
    assert not found.atlas.complete
    assert pressed.told <= at + 4  # surveys that end at once, and none that goes on
    assert found.half > 0
    assert found.contains(found.centre)


@pytest.mark.slow
def test_a_scheduler_that_is_killed_is_not_waited_for(rpdr):
    """Dask's own scheduler and worker, the scheduler killed in the midst: the same atlas, computed here, soon."""
    distributed = pytest.importorskip("distributed")
    region = GOAL - 0.5, GOAL + 0.5
    began = time.monotonic()
    alone = certify(rpdr, GOAL, region, max_depth=9)
    spent = time.monotonic() - began
    with ExitStack() as closing:
        run = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
        file = closing.enter_context(tempfile.TemporaryDirectory()) + "/scheduler.json"
        scheduler = closing.enter_context(_process([*run, "--scheduler-file", file, "--no-dashboard"]))
        run = [sys.executable, "-m", "distributed.cli.dask_worker", "--host", "127.0.0.1", "--no-dashboard"]
        closing.enter_context(_process([*run, "--scheduler-file", file, "--nthreads", "1", "--death-timeout", "20"]))
        client = distributed.Client(scheduler_file=file, timeout=30, set_as_default=False)
        closing.callback(client.close, timeout=1)
        client.wait_for_workers(1, timeout=60)
        waves = []

        def kill(progress):
            waves.append(progress)
            if len(waves) == 3:
                scheduler.kill()

        began = time.monotonic()
        found = certify(rpdr, GOAL, region, max_depth=9, executor=client.get_executor(), progress=kill)
        assert len(waves) > 3
        assert time.monotonic() - began < 30 + 10 * spent
    assert found.complete
    np.testing.assert_array_equal(found.boxes.kappa, alone.boxes.kappa)


@contextmanager
def _process(command):
    """A process that is killed in the end."""
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.slow
def test_a_deep_atlas_answers_soon(rpdr):
    """Wherever it is interrupted: 1.4 s went by between two looks at the flag. Loaded machines take longer."""
    waits = []
    for after in np.linspace(0.3, 8.0, 9):
        at = []
        timer = threading.Timer(after, lambda at=at: (at.append(time.monotonic()), os.kill(os.getpid(), signal.SIGINT)))
        timer.start()
        found = certify(rpdr, GOAL, max_depth=16)
        waits.append(time.monotonic() - at[0] if at else 0.0)
        timer.cancel()
        assert found.complete == (not at)
    assert max(waits) < 1.0


@pytest.mark.slow
def test_curves_are_kept_too(rpdr, tmp_path, monkeypatch):
    """A checkpoint saved no time: curves were followed again. One that Ctrl-C cuts short is not kept."""
    followed = []

    def counted(problem, theta, kernel, going):
        followed.append(theta)
        if len(followed) == 1:
            press()
        return following.follow(problem, theta, kernel, going)

    monkeypatch.setattr(cover, "follow", counted)
    region = np.array([[0.99, 1.0], [2.2, 2.15]])  # with the isolated point and a piece of the fold
    part = domain.certify_singularities(rpdr, region, checkpoint=tmp_path)
    assert not part.complete
    assert len(followed) == 1
    whole = domain.certify_singularities(rpdr, region, checkpoint=tmp_path)
    assert len(followed) == 1 + len(whole.curves) == 3
    again = domain.certify_singularities(rpdr, region, checkpoint=tmp_path)
    assert len(followed) == 3
    for one, other in zip(whole.curves, again.curves, strict=True):
        np.testing.assert_array_equal(one.tubes.theta, other.tubes.theta)
        np.testing.assert_array_equal(one.tubes.along, other.tubes.along)
        assert one.closed == other.closed


@contextmanager
def threads(count):
    """What is done side by side has so many."""
    with executor_for(None, count, threads=count):
        yield


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_work_side_by_side_is_given_back_in_order(workers):
    """On as many threads as workers were asked for, each with what its caller knows; and within a task on one."""
    met = threading.Barrier(min(workers, 4), timeout=20.0)

    def task(item):
        met.wait()
        inner = side_by_side(lambda _: threading.get_ident(), range(3))
        assert inner == [threading.get_ident()] * 3
        return item, ended()

    with stoppable(), threads(workers):
        assert side_by_side(task, range(4)) == [(k, False) for k in range(4)]
        press()
        assert side_by_side(task, range(4)) == [(k, True) for k in range(4)]
        assert side_by_side(task, []) == []


def test_the_first_error_of_work_side_by_side_ends_it():
    """What has not begun by then is left."""
    begun = []

    def task(item):
        begun.append(item)
        if item == 0:
            raise ValueError("the first")
        time.sleep(0.1)

    with threads(2), pytest.raises(ValueError, match="the first"):
        side_by_side(task, range(200))
    assert len(begun) < 100
