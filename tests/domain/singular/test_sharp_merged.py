"""What parts fill together: bounds apart by less than a search goes beyond them, full turns, and what is left out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import ccpin
from ccpin.covering.region import Region
from ccpin.domain import certify_singularities
from ccpin.domain.singular import merged as module
from ccpin.domain.singular.merged import filled, merge_covers
from ccpin.errors import InvalidInputError

TURN = 2.0 * np.pi
PROBLEM = SimpleNamespace(system=SimpleNamespace(periodic=np.array([True, False, True]), independent=np.array([2, 1])))


def region(lower, upper):
    lower, upper = np.array(lower, dtype=float), np.array(upper, dtype=float)
    return Region(lower, upper, np.zeros(len(lower), dtype=np.bool_))


def whole(*parts):
    """The parts' whole, lower, upper and wrapped; ``None`` where they leave something out."""
    try:
        found = filled(PROBLEM, [region(*part) for part in parts])
    except InvalidInputError:
        return None
    return found.lower.tolist(), found.upper.tolist(), found.wrapped.tolist()


def test_two_halves_fill_their_box():
    assert whole(((0, 0), (1, 2)), ((1, 0), (3, 2))) == ([0, 0], [3, 2], [False, False])
    assert whole(((0, 0), (1, 2)), ((0.5, -1), (3, 2))) is None
    assert whole(((0, 0), (1, 2)), ((0, 2), (1, 5))) == ([0, 0], [1, 5], [False, False])


@pytest.mark.parametrize(("gap", "closed"), [(0.97e-13, True), (1.03e-13, False), (1e-12, False)])
@pytest.mark.parametrize("axis", [0, 1])
def test_bounds_may_be_apart_by_a_tenth_of_what_searches_go_beyond_them(gap, closed, axis):
    """Whichever of the two parts ends, or begins, too soon."""
    one, other = np.array([[0.0, 0.0], [1.0, 1.0]]), np.array([[0.0, 0.0], [1.0, 1.0]])
    one[1, axis], other[0, axis], other[1, axis] = 0.125, 0.125 + gap, 0.25
    one, other = (([low[axis], low[1 - axis]], [high[axis], high[1 - axis]]) for low, high in (one, other))
    one, other = ((tuple(np.roll(a, axis)), tuple(np.roll(b, axis))) for a, b in (one, other))
    assert (whole(one, other) is not None) == closed
    assert (whole(other, one) is not None) == closed


@pytest.mark.parametrize(("short", "wraps"), [(0.0, True), (0.5e-13, True), (2e-13, False), (1e-12, False)])
def test_full_turns_close_on_themselves(short, wraps):
    """Of the angle, and of it alone."""
    assert whole(((1.0, 0.0), (TURN + 0.5, 1.0))) == ([1, 0], [TURN + 0.5, 1], [False, False])
    found = whole(((0.0, 0.0), (TURN - short, TURN)))
    assert found == ([0, 0], [TURN if wraps else TURN - short, TURN], [wraps, False])


def test_parts_over_the_seam():
    """From 3 to 2π + ½ and from 0 to 3: all of the turn; from 4 on there is a gap; on a line there is no turn."""
    assert whole(((0, 0), (3, 1)), ((3, 0), (TURN + 0.5, 1))) == ([0, 0], [TURN, 1], [True, False])
    assert whole(((0.25, 0), (3, 1)), ((3, 0), (TURN + 0.5, 1))) == ([0.25, 0], [0.25 + TURN, 1], [True, False])
    assert whole(((0.5, 0), (3, 1)), ((4, 0), (TURN + 0.75, 1))) is None
    assert whole(((0, 0), (3, 1)), ((3 - TURN, 0), (0.1 - TURN, 1)), ((0.1, 0), (TURN, 1))) is not None
    assert whole(((0, 0), (1, 3)), ((0, 3), (1, TURN + 0.5))) == ([0, 0], [1, TURN + 0.5], [False, False])
    around = ((-1, 0), (TURN - 1, 1))
    assert whole(around, ((3, 1), (3 + TURN, 2))) == ([-1, 0], [TURN - 1, 2], [True, False])
    assert whole(around, ((3, 1), (2 + TURN, 2))) is None


@pytest.mark.parametrize("seed", range(40))
def test_what_is_filled_is_filled_point_by_point(seed):
    """Boxes of quarters at random, with and without turns, against points in the middle of all quarters."""
    rng = np.random.default_rng(seed)
    units, boxes = np.array([TURN / 8, 0.25]), []
    for _ in range(rng.integers(1, 9)):
        low = rng.integers(0, 5 if seed % 2 else 9, 2)
        boxes.append((low, low + rng.integers(1, 6, 2)))
    found = whole(*((low * units, high * units) for low, high in boxes))
    bottom, top = np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)
    wraps = top[0] - bottom[0] >= 8
    top[0] = bottom[0] + 8 if wraps else top[0]
    turns = (-8, 0, 8) if wraps else (0,)
    full = all(
        any(np.any([low[0] <= x + turn < high[0] for turn in turns]) and low[1] <= y < high[1] for low, high in boxes)
        for x in range(bottom[0], top[0])
        for y in range(bottom[1], top[1])
    )
    assert (found is not None) == full
    if full:
        np.testing.assert_allclose(found[0], bottom * units, rtol=1e-15)
        np.testing.assert_allclose(found[1], top * units, rtol=1e-15)
        assert found[2] == [wraps, False]


def test_what_is_missing_is_told():
    """The box left out, as large as it is."""
    parts = [region((0, 0), (1, 3)), region((1, 0), (4, 1)), region((3, 1), (4, 3)), region((1, 2), (3, 3))]
    with pytest.raises(InvalidInputError, match=r"from \[1.0, 1.0\] to \[3.0, 2.0\]"):
        filled(PROBLEM, parts)
    with pytest.raises(InvalidInputError, match=r"from \[2.0, 4.0\] to \[4.0, 5.0\]"):
        filled(PROBLEM, [region(part.lower + [1.0, 3.0], part.upper + [1.0, 3.0]) for part in parts])
    with pytest.raises(InvalidInputError, match=r"from \[1.0, 1.0\] to \[2.0, 3.0\]"):
        filled(PROBLEM, [region((0, 0), (1, 3)), region((1, 0), (3, 1)), region((2, 1), (3, 3))])


# Covers.


@pytest.fixture(scope="module")
def cover():
    return certify_singularities(ccpin.load("rpdr"), np.radians(((118.0, 52.0), (121.0, 55.0))))


def test_a_cover_of_parts_says_what_all_of_them_do(cover, monkeypatch):
    """Boxes tried and left, the reason to end that hides most, the coarsest resolution: that is proposed."""
    monkeypatch.setattr(module, "concluded", lambda proposed, believed: proposed)
    left = cover.uncovered._replace(lower=np.zeros((1, 4)), upper=np.ones((1, 4)))
    one, other = replace(cover, tried=3, resolution=1e-3), replace(cover, tried=4, uncovered=left, resolution=1e-2)
    both = merge_covers([one, other])
    assert (both.tried, both.resolution, len(both.uncovered.lower), both.limit) == (7, 1e-2, 1, None)
    assert len(both.curves) == len(cover.curves)
    assert cover.curves
    for limits, told in (
        ((None, "budget"), "budget"),
        (("budget", "interrupted"), "interrupted"),
        (("interrupted", None), "interrupted"),
    ):
        assert merge_covers([replace(cover, limit=limit) for limit in limits]).limit == told


def test_a_whole_is_what_the_kernel_says_of_it(cover):
    """Boxes that a part lists and that hold nothing are listed no more; but if a part was interrupted they are."""
    left = cover.uncovered._replace(lower=np.zeros((1, 4)), upper=np.ones((1, 4)))
    both = merge_covers([cover, replace(cover, uncovered=left, limit="budget")])
    assert (both.verdict, len(both.uncovered.lower), both.limit) == ("proven", 0, None)
    early = merge_covers([cover, replace(cover, uncovered=left, limit="interrupted")])
    assert (early.verdict, len(early.uncovered.lower), early.proved.covered) == ("undecided", 1, None)


def test_what_one_part_is_not_proved_of_is_believed(cover, monkeypatch):
    """Without facts, or without the one about the region: of the first part, or of another."""
    monkeypatch.setattr(module, "concluded", lambda proposed, believed: believed)
    assert not merge_covers([cover, cover])
    for proved in (None, cover.proved._replace(covered=None)):
        other = replace(cover, proved=proved)
        assert merge_covers([cover, other])
        assert merge_covers([other, cover])
        assert merge_covers([other])


def test_parts_of_other_things_are_refused(cover):
    """Other coordinates, other closures, other limits: each of them alone, and the part is named."""
    four_bar = certify_singularities(ccpin.load("rpdr", independent=["joint1", "joint3"]), ((2.0, 0.9), (2.01, 0.91)))
    limits = cover.ranges.limits.copy()
    limits[1, 0] = -3.0
    narrower = replace(cover, ranges=replace_limits(cover.ranges, limits))
    for other in (replace(cover, names=("a", "b")), replace(cover, reading=four_bar.reading)):
        with pytest.raises(InvalidInputError, match="part 2 is about other closures"):
            merge_covers([cover, other])
    with pytest.raises(InvalidInputError, match="part 3 was searched within other limits"):
        merge_covers([cover, cover, narrower])
    module._refuse_others(cover, cover, 2)


def replace_limits(ranges, limits):
    """The ranges, within other limits."""
    return ranges._replace(limits=limits) if hasattr(ranges, "_replace") else replace(ranges, limits=limits)
