"""Covers of singular curves are the same bit for bit whoever does the work, and whatever interrupted it."""

import signal
from concurrent.futures import Executor, Future, ThreadPoolExecutor

import numpy as np
import pytest

from ccpin import domain
from ccpin.covering.runner import Runner
from ccpin.domain.closures.system import reading_of
from ccpin.domain.singular import box_tasks
from ccpin.errors import InvalidInputError
from ccpin.proof.curves.settled_boxes import Nearby, settled, settled_beside
from ccpin.proof.narrowing import Candidates
from tests.support.paper import CURVED as REGION


class Counted(Executor):
    """Does what is submitted at once, and counts it."""

    def __init__(self):
        self.count = 0

    def submit(self, function, /, *arguments):
        self.count += 1
        future = Future()
        future.set_result(function(*arguments))
        return future


class Flag:
    """Never set."""

    def is_set(self):
        return False


def numbers_of(cover):
    """Every number of a cover."""
    curves = [array for curve in cover.curves for array in (*curve.tubes, curve.q, curve.q_free, curve.error)]
    return [*curves, *cover.uncovered, np.array(cover.tried)]


def same(one, other):
    """Whether two covers are the same, bit for bit."""
    facts = [[(c.kind, c.closed) for c in cover.curves] + [cover.limit, cover.verdict] for cover in (one, other)]
    arrays = [[a.tobytes() for a in numbers_of(cover)] for cover in (one, other)]
    return facts[0] == facts[1] and arrays[0] == arrays[1]


@pytest.fixture
def alone(rpdr_curves):
    """The cover, made in this process."""
    return rpdr_curves


@pytest.mark.slow
def test_workers_do_not_change_the_cover(rpdr, alone):
    """Curves, tubes, boxes and how many were tried; `ccpin domain --workers 2` is asked the same (tests/cli)."""
    assert same(alone, domain.certify_singularities(rpdr, REGION, workers=2))


@pytest.mark.slow
def test_an_executor_does_not_change_the_cover(rpdr, alone):
    """Threads for processes."""
    with ThreadPoolExecutor(2) as pool:
        assert same(alone, domain.certify_singularities(rpdr, REGION, executor=pool))


@pytest.mark.slow
def test_chunks_of_any_size_say_the_same(rpdr, alone, monkeypatch):
    """A box is narrowed and settled as it is, whatever boxes and tubes come with it."""
    monkeypatch.setattr(box_tasks, "_CHUNK", 61)
    assert same(alone, domain.certify_singularities(rpdr, REGION))


def test_a_chunk_has_the_tubes_it_needs(rpdr, alone):
    """What is left in chunks with some of the tubes is what is left with all of them at hand."""
    problem = reading_of(rpdr, rpdr.q_reference).bounded("reach").problem
    curve = next(curve for curve in alone.curves if curve.closed)
    rng, size = np.random.default_rng(1), len(curve.tubes.half)
    centre = curve.tubes.theta[rng.integers(size, size=300)] + rng.normal(scale=0.01, size=(300, 4))
    half = rng.choice([1e-3, 1e-2, 0.3], 300)[:, None] * np.ones(4)
    boxes = Candidates(np.zeros(300, dtype=np.intp), centre, half, np.zeros((300, 2, 2)))
    nearby = Nearby(problem, curve.tubes)
    left = box_tasks.settle_boxes(Runner(problem, None, None, Flag()), nearby, boxes)
    nearest = nearby.of(centre, 3)
    expected = ~settled_beside(problem, boxes, curve.tubes, nearest)
    assert 20 < expected.sum() < 280
    assert np.array_equal(left.centre, centre[expected])
    tried = [settled(problem, boxes, curve.tubes.take(beside)) for beside in nearest.T]
    assert np.all(np.any(tried, axis=0)[~expected])


@pytest.mark.slow
def test_after_an_interrupt_the_same_call_goes_on(rpdr, alone, tmp_path):
    """Ctrl-C in the middle leaves boxes; the same call finds the chunks that are done, and a third one all of them."""
    everything, waves = Counted(), []

    def stop(tubes, waiting):
        waves.append(waiting)
        if len(waves) == 25:
            signal.raise_signal(signal.SIGINT)

    assert same(alone, domain.certify_singularities(rpdr, REGION, executor=everything))
    early = domain.certify_singularities(rpdr, REGION, checkpoint=tmp_path, progress=stop)
    assert (early.complete, early.verdict) == (False, "undecided")
    assert everything.count > 40  # that boxes do go through it
    kept = len(list(tmp_path.glob("*.chunk")))
    assert 0 < kept < everything.count
    rest, none = Counted(), Counted()
    assert same(alone, domain.certify_singularities(rpdr, REGION, executor=rest, checkpoint=tmp_path))
    assert rest.count == everything.count - (kept - len(early.curves))  # whole curves are kept beside the boxes
    assert same(alone, domain.certify_singularities(rpdr, REGION, executor=none, checkpoint=tmp_path))
    assert none.count == 0


@pytest.mark.slow
def test_chunks_are_those_of_their_own_closures(rpdr, tmp_path):
    """Another mechanism finds nothing in a folder, nor does another region."""
    domain.certify_singularities(rpdr, REGION, budget=2000, checkpoint=tmp_path)
    again, other, moved = Counted(), Counted(), Counted()
    domain.certify_singularities(rpdr, REGION, budget=2000, executor=again, checkpoint=tmp_path)
    longer = domain.scaled_links("rpdr", links={"arm": ("link1",)})({"arm": 1.01})
    domain.certify_singularities(longer, REGION, budget=2000, executor=other, checkpoint=tmp_path)
    domain.certify_singularities(rpdr, REGION + 0.01, budget=2000, executor=moved, checkpoint=tmp_path)
    assert again.count == 0
    assert min(other.count, moved.count) > 5


@pytest.mark.slow
def test_work_that_goes_on_is_shared_too(rpdr, tmp_path):
    """`continued` in this thread, in two, and a second time from chunks that are kept."""
    early = domain.certify_singularities(rpdr, REGION, budget=3000)
    whole, none = early.continued(checkpoint=tmp_path), Counted()
    assert whole.verdict == "proven"
    assert same(whole, early.continued(workers=2))
    assert same(whole, early.continued(executor=none, checkpoint=tmp_path))
    assert none.count == 0


def test_wrong_numbers_of_workers_are_refused(rpdr):
    """None at all, and both at once."""
    for wrong in ({"workers": 0}, {"workers": 1.5}, {"workers": 2, "executor": Counted()}):
        with pytest.raises(InvalidInputError, match="workers"):
            domain.certify_singularities(rpdr, REGION, **wrong)
