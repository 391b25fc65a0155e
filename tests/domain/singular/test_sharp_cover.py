"""A search loses no box: halves hold what was halved, to the last bit, and what ends it is told."""

from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.arrays import joined, rows_of
from ccpin.covering.region import Region
from ccpin.domain.singular import cover as module
from ccpin.domain.singular.cover import CurveSearch, SearchDomain
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Ranges
from ccpin.work import Stopped
from tests.support.made_up import made_up

SIZE = 4


def boxes_of(centre, half, slopes=0.0):
    """Boxes of two independent coordinates, 1 and 3, and two dependent ones."""
    centre, half = np.atleast_2d(centre), np.atleast_2d(half)
    slopes = np.broadcast_to(slopes, (len(centre), 2, 2)).astype(float)
    return Candidates(np.arange(len(centre)), centre.astype(float), half.astype(float), slopes)


def halves_of(monkeypatch, boxes, jacobian=None, hessian=None, rows=(0, 1)):
    """`_halved` where φ moves as told."""
    count = len(boxes.cell)
    values = SimpleNamespace(
        jacobian=np.zeros((count, 2, SIZE)) if jacobian is None else jacobian,
        hessian=np.zeros((count, 2, SIZE, SIZE)) if hessian is None else hessian,
    )
    monkeypatch.setattr(module, "closure_derivatives", lambda problem, theta: values)
    monkeypatch.setattr(module, "rows_to_halve_for", lambda problem: np.array(rows))
    return CurveSearch._halved(SimpleNamespace(problem=made_up()), boxes)


def exactly(box):
    """The numbers of a box as they are."""
    centre, half, slopes = ([Fraction(float(x)) for x in np.ravel(part)] for part in box[1:])
    return centre, half, [slopes[:2], slopes[2:]]


def holds(box, theta):
    """Whether θ = θ_c + Dδ for a |δ| ≤ h, exactly."""
    centre, half, slopes = exactly(box)
    delta = [x - c for x, c in zip(theta, centre, strict=True)]
    for row, k in enumerate((0, 2)):
        delta[k] -= slopes[row][0] * delta[1] + slopes[row][1] * delta[3]
    return all(abs(d) <= h for d, h in zip(delta, half, strict=True))


def within(box, shares):
    """The θ of a box whose δ are such shares of h, exactly."""
    centre, half, slopes = exactly(box)
    delta = [Fraction(share) * h for share, h in zip(shares, half, strict=True)]
    theta = [c + d for c, d in zip(centre, delta, strict=True)]
    for row, k in enumerate((0, 2)):
        theta[k] += slopes[row][0] * delta[1] + slopes[row][1] * delta[3]
    return theta


@pytest.mark.parametrize("steep", [1.0, 30.0, 1e6])
@pytest.mark.parametrize("cut", [0, 1, 2, 3])
def test_halves_hold_all_of_the_box_that_was_halved(monkeypatch, steep, cut):
    """Corners and the middle of each edge cut, exactly; middles of q that are rounded move those of y by slopes."""
    rng, jacobian = np.random.default_rng(cut), np.zeros((30, 2, SIZE))
    slopes = steep * rng.uniform(-1, 1, (30, 2, 2))
    boxes = boxes_of(rng.uniform(-3, 3, (30, SIZE)), rng.uniform(1e-3, 2e-3, (30, SIZE)), slopes)
    jacobian[:, 0, cut] = 1e9
    found = halves_of(monkeypatch, boxes, jacobian)
    for k in range(30):
        box, halves = rows_of(boxes, slice(k, k + 1)), [rows_of(found, slice(j, j + 1)) for j in (k, k + 30)]
        for ends in product((-1, 1), repeat=SIZE):
            for share in (ends[cut], 0):
                theta = within(box, [share if j == cut else end for j, end in enumerate(ends)])
                assert any(holds(half, theta) for half in halves)


def test_halves_are_wider_by_roundings_only(monkeypatch):
    """4e-16 (1 + |θ_c| + |step| + h) where the middle moves, and slopes times those of q."""
    jacobian = np.zeros((1, 2, SIZE))
    jacobian[0, 0, 1] = 1.0
    boxes = boxes_of([2.0, 3.0, 5.0, 7.0], [0.0, 8.0, 0.0, 0.0], [[-1000.0, 0.0], [0.0, 0.0]])
    found = halves_of(monkeypatch, boxes, jacobian)
    np.testing.assert_array_equal(found.centre, [[2.0 + 4000.0, -1.0, 5.0, 7.0], [2.0 - 4000.0, 7.0, 5.0, 7.0]])
    spare = 4e-16 * np.array([4003.0, 12.0])
    for half in found.half:
        np.testing.assert_allclose(half[[0, 2, 3]], [spare[0] + 1000 * spare[1], 0.0, 0.0], rtol=1e-12)
        assert half[1] - 4.0 == pytest.approx(spare[1], rel=0.2)
    np.testing.assert_array_equal(found.slopes, np.tile(boxes.slopes, (2, 1, 1)))


def test_boxes_are_halved_where_the_rows_move_most(monkeypatch):
    """φ by |φ_θ|h, φ_y by the sum of its columns, of the rows that are asked of only."""
    boxes = boxes_of(np.zeros((3, SIZE)), np.tile([1.0, 1.0, 1.0, 4.0], (3, 1)))
    jacobian, hessian = np.zeros((3, 2, SIZE)), np.zeros((3, 2, SIZE, SIZE))
    jacobian[:, 1] = [0.1, 100.0, 0.0, 0.0]
    jacobian[:, 0] = [[0.1, 0.0, 5.0, 1.0], [0.6, 0.0, 6.5, 0.0], [1.0, 0.0, 0.0, 0.9]]
    hessian[1, 0, [0, 2], 0], hessian[1, 0, 1, 2] = [3.0, -3.0], 100.0
    found = halves_of(monkeypatch, boxes, jacobian, hessian, rows=(0,))
    for number, (cut, step) in enumerate([(2, 0.5), (0, 0.5), (3, 2.0)]):
        moved = np.where(np.arange(SIZE) == cut, step, 0.0)
        np.testing.assert_array_equal(found.centre[[number, number + 3]], [-moved, moved])
    jacobian[:, 1, 1] = 0.0
    found = halves_of(monkeypatch, boxes, jacobian, hessian)
    assert found.centre[0, 2] == -0.5


def test_the_first_box_holds_the_region_and_the_ranges():
    """And 1e-12 more each way."""
    region = Region(np.array([-1.0, 2.0]), np.array([1.5, 2.25]), np.zeros(2, dtype=bool))
    ranges = Ranges(np.array([0.0, -4.0]), np.array([0.5, 3.0]), np.zeros((2, 2), dtype=np.int8), np.zeros((2, 2)))
    search = SimpleNamespace(problem=made_up(), place=SearchDomain(region, ranges))
    box = CurveSearch._whole(search)
    np.testing.assert_allclose(box.centre[0], [0.25, 0.25, -0.5, 2.125], rtol=1e-15)
    np.testing.assert_allclose(box.half[0] - [0.25, 1.25, 3.5, 0.125], 1e-12, rtol=2e-3)
    assert not box.slopes.any()
    assert pytest.approx(1e-12, rel=1e-9) == module.BEYOND


class Told:
    """A search whose steps are told: boxes by number are settled, small or halved."""

    def __init__(self, waiting, kept, settles=(), stop=None):
        self.problem, self.chains, self.tried = made_up(), [], 0
        self.waiting, self.kept, self.settles, self.stop, self.rounds = waiting, kept, settles, stop, 0

    def _whole(self):
        return self.waiting

    def _kept(self, waiting):
        self.rounds += 1
        assert self.rounds < 20
        self.tried += len(waiting.cell)
        if self.rounds == self.stop:
            raise Stopped
        return rows_of(waiting, ~np.isin(waiting.cell, self.kept))

    def _settled(self, waiting):
        return rows_of(waiting, ~np.isin(waiting.cell, self.settles))

    def _halved(self, waiting):
        half = waiting._replace(half=0.5 * waiting.half)
        return joined([half, half._replace(cell=waiting.cell + 100)])


def found_by(told, resolution=0.1, budget=100, waiting=None):
    """What it finds: numbers of boxes left, boxes tried, and what ended it."""
    said = []
    found = CurveSearch.run(told, resolution, budget, lambda *numbers: said.append(numbers), waiting)
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
