"""Boxes that together hold all that is looked for: beginnings, what is dropped, halves to the last bit."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from ccpin.arrays import rows_of
from ccpin.proof import candidates as module
from ccpin.proof.candidates import halved, over_all
from ccpin.proof.narrowing import Candidates
from ccpin.proof.ranges import Reason
from tests.support.made_up import made_up
from tests.support.straight import circles, problem_by_hand, straight
from tests.support.waiting import candidates, ranges_of

U = 2.0**-53
LINE, PLANE = straight([[1.0]]), straight([[1.0], [2.0]])


def test_a_search_begins_with_all_of_the_ranges():
    """A thousandth of what counts as at their ends and 1e-12 of the region more, but where a coordinate is held."""
    ranges = ranges_of([-1.0, 2.0], [3.0, 2.5])
    for lower, upper, wide in ((0.25, 0.75, 0.25 + 1e-12 + 1e-14 + 3 * U), (0.5, 0.5, 0.0)):
        found = over_all(problem_by_hand(PLANE), ranges, np.array([lower]), np.array([upper]))
        np.testing.assert_allclose(found.centre, [[0.5, 1.0, 2.25]], rtol=1e-15)
        more = 1e-12 * np.array([4.0, 3.5])
        assert found.half[0, 0] == pytest.approx(wide, rel=1e-15, abs=0.0)
        np.testing.assert_allclose(found.half[0, 1:] - [2.0, 0.25], more, rtol=1e-3)
        assert (found.cell.tolist(), found.slopes.any()) == ([0], False)


@pytest.mark.parametrize(("lower", "upper"), [(0.1, 0.7), (1e6 + 0.1, 1e6 + 0.3), (-1e9 - 1e-3, -1e9)])
def test_a_search_begins_with_all_of_the_region(lower, upper):
    """And 1e-12 more, wherever it is, as real numbers."""
    found = over_all(problem_by_hand(LINE), ranges_of([-1.0], [3.0]), np.array([lower]), np.array([upper]))
    centre, half = Fraction(found.centre[0, 0]), Fraction(found.half[0, 0])
    for room in (Fraction(lower) - (centre - half), centre + half - Fraction(upper)):
        assert room >= Fraction(1e-12)


@pytest.mark.parametrize(("centre", "gone"), [
    ([0.0, 0.0], False), ([1.7499, 0.0], False), ([1.7501, 0.0], True), ([-1.7499, 0.0], False), ([-1.7501, 0.0], True),
    ([0.0, 2.2499], False), ([0.0, 2.2501], True), ([1.75 + 1e-10, 0.0], False), ([-1.75 - 1e-10, 0.0], False),
])  # fmt: skip
def test_what_leans_into_the_ranges_is_not_beyond_them(centre, gone):
    """|y| ≤ 1 and half widths ½ with slopes 1 and 3 over a quarter, and a billionth (1 + |end|) of the ends."""
    ranges, box = (
        ranges_of([-1.0, -1.0], [1.0, 1.0]),
        candidates([[0.0, *centre]], [[0.25, 0.5, 0.5]], [[[1.0], [-3.0]]]),
    )
    assert module.beyond(problem_by_hand(PLANE), ranges, box).tolist() == [gone]


def test_full_turns_have_no_beyond():
    box = candidates([[0.0, 9.0]], [[0.25, 0.5]], [[[1.0]]])
    assert module.beyond(problem_by_hand(circles()), ranges_of([-1.0], [1.0]), box).tolist() == [False]
    assert module.beyond(problem_by_hand(LINE), ranges_of([-1.0], [1.0]), box).tolist() == [True]


def test_all_candidates_are_narrowed_by_both(monkeypatch):
    """In chunks; singular ones are looked for where no limit is met."""
    asked = []

    def narrowed(problem, boxes, inverse=False, regular=None):
        asked.append((len(boxes.cell), inverse, regular))
        return boxes

    monkeypatch.setattr(module, "narrowed", narrowed)
    count = 2 * module._CHUNK + 5
    boxes = candidates(np.zeros((count, 3)), np.full((count, 3), 0.1), np.zeros((count, 2, 1)))
    boxes.centre[:, 1] = np.where(np.arange(count) % 2, 0.95, 0.0)
    boxes.centre[7, 2] = 5.0
    ranges = ranges_of([-1.0, -1.0], [1.0, 1.0], Reason.LIMIT)
    found = module.narrowed_both(problem_by_hand(PLANE), ranges, boxes, singular=True)
    assert found.cell.tolist() == [k for k in range(count) if k != 7]
    assert [n for n, inverse, _ in asked] == [1000, 1000, 1000, 1000, 5, 5]
    assert asked[1][2][:7].tolist() == [True, False, True, False, True, False, True]
    asked.clear()
    module.narrowed_both(problem_by_hand(PLANE), ranges, boxes)
    assert all(regular is None for *_, regular in asked)


# Halves.

SIZE = 4


def boxes_of(centre, half, slopes=0.0):
    """Boxes of two independent coordinates, 1 and 3, and two dependent ones."""
    centre, half = np.atleast_2d(centre), np.atleast_2d(half)
    slopes = np.broadcast_to(slopes, (len(centre), 2, 2)).astype(float)
    return Candidates(np.arange(len(centre)), centre.astype(float), half.astype(float), slopes)


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
def test_halves_hold_all_of_the_box_that_was_halved(steep, cut):
    """Corners and the middle of each edge cut, exactly; middles of q that are rounded move those of y by slopes."""
    rng = np.random.default_rng(cut)
    slopes = steep * rng.uniform(-1, 1, (30, 2, 2))
    boxes = boxes_of(rng.uniform(-3, 3, (30, SIZE)), rng.uniform(1e-3, 2e-3, (30, SIZE)), slopes)
    found = halved(made_up(), boxes, np.full(30, cut))
    for k in range(30):
        box, halves = rows_of(boxes, slice(k, k + 1)), [rows_of(found, slice(j, j + 1)) for j in (k, k + 30)]
        for ends in product((-1, 1), repeat=SIZE):
            for share in (ends[cut], 0):
                theta = within(box, [share if j == cut else end for j, end in enumerate(ends)])
                assert any(holds(half, theta) for half in halves)


def test_halves_are_wider_by_roundings_only():
    """4u (1 + |middle| + |step|) where the middle moves, and slopes times those of q."""
    boxes = boxes_of([2.0, 3.0, 5.0, 7.0], [0.0, 8.0, 0.0, 0.0], [[-1000.0, 0.0], [0.0, 0.0]])
    found = halved(made_up(), boxes, np.array([1]))
    np.testing.assert_array_equal(found.centre, [[2.0 + 4000.0, -1.0, 5.0, 7.0], [2.0 - 4000.0, 7.0, 5.0, 7.0]])
    for half, middle, leaning in zip(found.half, (-1.0, 7.0), (4002.0, -3998.0), strict=True):
        q, y = 4 * U * (1 + abs(middle) + 4.0), 4 * U * (1 + abs(leaning) + 4000.0)
        np.testing.assert_allclose(half[[0, 2, 3]], [y + 1000 * q, 0.0, 0.0], rtol=1e-12)
        assert half[1] - 4.0 == pytest.approx(q, rel=0.2)
    np.testing.assert_array_equal(found.slopes, np.tile(boxes.slopes, (2, 1, 1)))
    assert found.cell.tolist() == [0, 0]
