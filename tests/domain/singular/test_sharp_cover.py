"""A search loses no box: halves hold what was halved, to the last bit, and what ends it is told."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.arrays import joined, rows_of
from ccpin.covering.region import Region
from ccpin.domain.singular import cover as module
from ccpin.domain.singular.cover import CurveSearch, SearchDomain
from ccpin.proof.narrowing import Candidates
from ccpin.work import Stopped
from tests.support.made_up import made_up

SIZE = 4
REGION = Region(np.zeros(2), np.ones(2), np.zeros(2, dtype=bool))


def boxes_of(centre, half):
    """Boxes of two independent coordinates, 1 and 3, and two dependent ones."""
    return Candidates(np.arange(len(centre)), centre, half, np.zeros((len(centre), 2, 2)))


class Told:
    """A search whose steps are told: boxes by number are settled, small or halved."""

    def __init__(self, waiting, kept, settles=(), stop=None):
        self.problem, self.chains, self.tried, self.place = made_up(), [], 0, SearchDomain(REGION, None)
        self.waiting, self.kept, self.settles, self.stop, self.rounds = waiting, kept, settles, stop, 0

    def _kept(self, waiting):
        self.rounds += 1
        assert self.rounds < 20
        self.tried += len(waiting.cell)
        if self.rounds == self.stop:
            raise Stopped
        return rows_of(waiting, ~np.isin(waiting.cell, self.kept))

    def _settled(self, waiting):
        return rows_of(waiting, ~np.isin(waiting.cell, self.settles))


@pytest.fixture(autouse=True)
def numbered_halves(monkeypatch):
    """Halves have numbers, and numbers + 100."""

    def halves(problem, waiting):
        half = waiting._replace(half=0.5 * waiting.half)
        return joined([half, half._replace(cell=waiting.cell + 100)])

    monkeypatch.setattr(module, "halved_steepest", halves)


def found_by(told, resolution=0.1, budget=100, waiting=None):
    """What it finds: numbers of boxes left, boxes tried, and what ended it."""
    said = []
    found = CurveSearch.run(told, resolution, budget, lambda *numbers: said.append(numbers), waiting or told.waiting)
    return sorted(found.left.cell.tolist()), found.tried, found.limit, said


def edged(*edges):
    """Boxes with such largest half edges, others a tenth of them."""
    half = np.array([[0.1 * edge, 0.1 * edge, edge, 0.1 * edge] for edge in edges])
    return boxes_of(np.zeros((len(edges), SIZE)), half)


def test_a_search_goes_on_until_boxes_are_gone_settled_or_small():
    """Of 0 … 3 the first is dropped, the second settled, the third small at once, the fourth after a halving."""
    told = Told(edged(1.0, 1.0, 0.099, 0.19), kept=[0], settles=[1])
    left, tried, limit, said = found_by(told)
    assert (left, tried, limit) == ([2, 3, 103], 4 + 2, None)
    assert said == [(0, 4), (0, 2)]
    assert found_by(Told(edged(), kept=[])) == ([], 0, None, [])
    assert found_by(Told(None, kept=[]), waiting=edged(0.05))[0] == [0]
    assert found_by(Told(edged(0.0999), kept=[]))[:2] == ([0], 1)
    assert found_by(Told(edged(0.1001), kept=[]))[:2] == ([0, 100], 3)


def test_a_search_that_is_over_lists_the_boxes_that_wait():
    """When more are tried than the budget, or it is stopped; not where none is left."""
    assert found_by(Told(edged(1.0, 0.01), kept=[]), budget=1)[:3] == ([0, 1], 2, "budget")
    assert found_by(Told(edged(1.0, 0.01), kept=[]), budget=2)[2] == "budget"
    assert found_by(Told(edged(0.15, 0.01), kept=[]), budget=3)[:3] == ([0, 1, 100], 4, None)
    assert found_by(Told(edged(0.15, 0.01), kept=[]), budget=2)[:3] == ([0, 1, 100], 4, None)
    assert found_by(Told(edged(1.0, 1.0), kept=[0]), budget=2)[:3] == ([1, 101], 4, "budget")
    assert found_by(Told(edged(1.0, 1.0), kept=[0], stop=1))[:3] == ([0, 1], 2, "interrupted")
    assert found_by(Told(edged(1.0, 0.01), kept=[], stop=2))[:3] == ([0, 1, 100], 4, "interrupted")


def test_boxes_tried_are_counted(monkeypatch):
    """Before they are narrowed."""
    boxes = edged(1.0, 2.0, 3.0)
    monkeypatch.setattr(module, "narrow_boxes", lambda runner, ranges, boxes: rows_of(boxes, slice(1)))
    search = SimpleNamespace(_runner=None, place=SimpleNamespace(ranges=None), tried=5)
    assert len(CurveSearch._kept(search, boxes).cell) == 1
    assert search.tried == 8
