"""What tasks are given, and what they leave: of boxes, and of the tubes beside them."""

from types import SimpleNamespace

import numpy as np

from ccpin.domain.singular import box_tasks as module
from ccpin.domain.singular.box_tasks import settle_boxes, settle_task
from ccpin.proof.curves.settled_boxes import Beside
from ccpin.proof.curves.tubes import Tubes
from ccpin.proof.narrowing import Candidates
from tests.support.made_up import made_up
from tests.support.waiting import any_boxes, any_tubes

N, ALONG = 6, 4  # coordinates of x, and the one that tubes run along


class InTurn:
    """A runner that does one chunk after another, of boxes and tubes as plain arrays."""

    def __init__(self, problem, done):
        self.problem, self.done, self.seen = problem, done, []

    def map(self, task, chunks):
        assert task is settle_task
        for arrays in chunks:
            self.seen.append(arrays)
            yield (self.done(self.problem, arrays),)


def test_settled_boxes_are_dropped_and_no_others(monkeypatch):
    """In chunks of two: all that is not worth a try stays, and what stays undone."""
    rng, settles = np.random.default_rng(9), np.array([0, 1, 1, 1, 1, 1, 1])
    boxes, tubes = any_boxes(rng, 7), any_tubes(rng, 9, ALONG)
    nearest, worth = rng.integers(0, 9, (7, 3)), np.array([1, 1, 1, 0, 1, 1, 1], dtype=bool)
    monkeypatch.setattr(module, "_CHUNK", 2)
    nearby = SimpleNamespace(tubes=tubes, beside=lambda boxes: Beside(nearest, worth))

    def done(problem, arrays):
        some, number, beside = Candidates(*arrays[:4]), arrays[4], Tubes(*arrays[5:])
        np.testing.assert_array_equal(beside.theta[number], tubes.theta[nearest[some.cell]])
        return settles[some.cell]

    runner = InTurn(None, done)
    left = settle_boxes(runner, nearby, boxes)
    np.testing.assert_array_equal(left.cell, [0, 3])
    np.testing.assert_array_equal(left.centre, boxes.centre[[0, 3]])
    assert [len(arrays[0]) for arrays in runner.seen] == [2, 2, 2]


def test_a_chunk_is_asked_of_with_its_own_tubes(monkeypatch):
    """And with bounds for any tree."""
    rng, seen = np.random.default_rng(10), []
    boxes, tubes, nearest = any_boxes(rng, 3), any_tubes(rng, 4, ALONG), rng.integers(0, 4, (3, 2))
    problem = made_up()
    problem.phasors = "planar"
    monkeypatch.setattr(module, "settled_beside", lambda *given: seen.append(given) or np.array([True, False, True]))
    (done,) = settle_task(problem, (*boxes, nearest, *tubes))
    np.testing.assert_array_equal(done, [True, False, True])
    asked, some, among, beside = seen[0]
    assert asked.phasors is None
    np.testing.assert_array_equal(some.slopes, boxes.slopes)
    np.testing.assert_array_equal(beside, nearest)
    np.testing.assert_array_equal(among.hull, tubes.hull)
