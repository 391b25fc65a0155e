"""Chains that just do, and just do not, reach each other, and what rows see of their segments."""

import numpy as np
import pytest

from tests.support.chains import NO_LIMIT, NONE, X, Y, Z, chain, closures, leg_and_anchor, planar, stated

pytest.importorskip("flint")

from flint import arb, arb_mat

from ccpin.auditing import lengths, stated_ranges
from ccpin.auditing.closures import BallClosures, exact
from ccpin.auditing.reach import CornerBox, Reach, above, below
from ccpin.auditing.stated_ranges import intervals, unproved


def reach_of(system, unbounded=frozenset(), lower=(1.0,), upper=(6.0,), **more):
    document = stated(system, lower, upper, **more)
    return Reach(BallClosures(document), document, unbounded)


def ends(system, limits=None, lower=(1.0,), upper=(6.0,)):
    box = intervals(reach_of(system, limits=limits, lower=lower, upper=upper))
    return box.low, box.high


# What rows see


@pytest.mark.parametrize(("off", "same"), [(0.99e-13, True), (1.02e-13, False)])
def test_a_matrix_is_i_up_to_roundings(off, same):
    for i in range(2):
        for j in range(2):
            for sign in (-1.0, 1.0):
                matrix = np.eye(2, dtype=object)
                entries = [arb(int(x)) for x in matrix.ravel()]
                entries[2 * i + j] += sign * off
                assert lengths.is_identity(arb_mat(2, 2, entries)) == same


def test_norms_and_sizes():
    assert float(lengths.norm_of(exact(np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 1.0]])))) == pytest.approx(5.0)
    assert float(lengths.norm_of(exact(np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])))) == pytest.approx(3.0**0.5)
    assert float(lengths.size_of(exact(np.array([2.0, -3.0, 6.0])))) == pytest.approx(7.0)
    for x, least, most in (
        (arb(0), 0.0, 0.0),
        (arb(0, 4.0), 0.0, 2.0),
        (arb(-1.0, 5.0), 0.0, 2.0),
        (arb(4.0), 2.0, 2.0),
    ):
        root = lengths.root_of(x)
        assert root.contains(least)
        assert root.contains(most)
        assert float(root.upper()) == pytest.approx(most, abs=1e-6)
    assert float(lengths.least_size(arb(-3.0, 1.0))) == pytest.approx(2.0)
    assert float(lengths.least_size(arb(1.0, 1.5))) == 0.0


def seen(weights, turns, slides, link, tip):
    """What weights see of a chain's segments before each joint and of its tip: (most, least, as it is)."""
    joints = [(k, link, axis, slide) for k, (axis, slide) in enumerate(zip(turns, slides, strict=True))]
    document = closures([chain(joints, np.array(weights), tip)], len(turns) + 1, [len(turns)])
    path = BallClosures(document).paths[0]
    found = lengths.segments_of(path, lengths.norm_of(path.weights))
    return [(float(s.before[0].mid()), float(s.before[1].mid()), s.as_is) for s in found], found


@pytest.mark.parametrize(
    ("weights", "turns", "as_is"),
    [
        ([X, Y], [Z, Z], [True, True, True]),
        ([X, Y], [Y, Z], [True, False, False]),
        ([X, Y], [Z, Y], [True, True, False]),
        ([X, 2.0 * Y], [Z, Z], [True, False, False]),
        ([X, X + Y], [Z, Z], [True, False, False]),
        ([X], [Z, Z], [True, False, False]),
        ([X, Y, Z], [Y, X], [True, True, True]),
        ([X, Y, 2.0 * Z], [Y, X], [True, False, False]),
        ([np.zeros(3), X, Y], [Z, Z], [True, True, True]),
    ],
)
def test_what_rows_see_behind_turns(weights, turns, as_is):
    """As it is, or at most the whole times their norm, and at least nothing."""
    link, tip = np.array([1.0, 2.0, 2.0]), np.array([2.0, 3.0, 6.0])
    told, _ = seen(weights, turns, [False, False], link, tip)
    W = np.array(weights)
    norm = float(lengths.norm_of(exact(W)))
    for (most, least, plain), size, good in zip(told, [link, link, tip], as_is, strict=True):
        assert plain == good
        length = np.linalg.norm(W @ size)
        assert most == pytest.approx(length if good else norm * np.linalg.norm(size))
        assert least == pytest.approx(length if good else 0.0)


def test_slides_turn_nothing():
    told, found = seen([X, Y], [Y, Y], [True, True], np.array([1.0, 2.0, 2.0]), np.ones(3))
    assert [as_is for *_, as_is in told] == [True, True, True]
    assert [float(s.along[0].mid()) for s in found[:2]] == pytest.approx([1.0, 1.0])
    _, found = seen([X, Y], [X, Z], [True, True], np.ones(3), np.ones(3))
    assert [float(s.along[0].mid()) for s in found[:2]] == pytest.approx([1.0, 0.0])

    told, _ = seen([X, 2.0 * Y], [X, X], [True, True], X, Y)
    assert told[2][::2] == (pytest.approx(2.0), True)
    told, _ = seen([X, Y], [Y, X], [False, True], X, Y)
    assert [as_is for *_, as_is in told] == [True, False, False]


def test_lengths_are_uncertain_by_a_little():
    """1e-11 of the whole vector, of which more than 1e-13 of another plane counts as turned out of it."""
    _, found = seen([X, Y], [Z, Z], [False, False], np.array([1.0, 2.0, 2.0]), np.array([2.0, 3.0, 6.0]))
    np.testing.assert_allclose([float(s.before[0].rad()) for s in found], [3e-11, 3e-11, 7e-11], rtol=1e-3)
    low, high = found[0].before[1], found[0].before[0]
    np.testing.assert_allclose(float(low), float(high.lower()), rtol=1e-15)
    for tilt, flat in ((0.97e-13, True), (1.03e-13, False)):
        axis = Z + tilt * X
        _, found = seen([X, Y], [axis, Z], [False, False], X, X)
        assert found[1].as_is == flat


# Reach


def two_arms(first, second, apart, **more):
    """Two bars that turn about points `apart` along a slide of coordinate 0, which has no other joints."""
    arms = (
        planar([(1, np.zeros(3), Z, False)], first * X),
        chain([(0, np.zeros(3), X, True), (2, np.zeros(3), Z, False)], -np.array([X, Y]), second * X),
    )
    return reach_of(closures(arms, 3, [0]), **more), apart


@pytest.mark.parametrize(("first", "second", "apart"), [(1.0, 2.0, 3.0), (5.0, 2.0, 3.0), (2.0, 5.0, 3.0)])
def test_two_bars_meet_as_far_as_they_reach_and_as_near_as_they_can(first, second, apart):
    reach, _ = two_arms(first, second, apart)
    outward = 1.0 if apart == first + second else -1.0
    for off, far in ((1e-6, True), (-1e-6, False)):
        at = apart + outward * off
        turns = CornerBox(np.array([at, -np.pi, -np.pi]), np.array([at, np.pi, np.pi]))
        assert reach.too_far(turns) == far
        wide = 0.25
        low, high = (at, at + wide) if outward > 0 else (at - wide, at)
        box = CornerBox(np.array([low, -np.pi, -np.pi]), np.array([high, np.pi, np.pi]))
        assert reach.too_far(box) == far


def test_a_bar_that_turns_little_is_where_it_is():
    """Within 0.6 rad each way its tip is known; beyond, only its length."""
    reach, _ = two_arms(1.0, 1.0, 2.0)
    for half, far in ((0.599, True), (0.601, False)):
        box = CornerBox(np.array([2.0, np.pi - half, -np.pi]), np.array([2.0, np.pi + half, np.pi]))
        assert reach.too_far(box) == far  # it points away


def test_slides_behind_a_turn_are_as_long_as_they_may_be():
    """A telescope of 1 to 2 between a pivot and a point at a distance."""
    leg = planar([(1, np.zeros(3), Z, False), (2, 0.25 * X, X, True)], 0.5 * X)
    anchor = chain([(0, np.zeros(3), X, True)], -np.array([X, Y]))
    reach = reach_of(closures([leg, anchor], 3, [0]))
    for slide, at, far in (
        ((1.0, 2.0), 2.75 + 1e-6, True),
        ((1.0, 2.0), 2.75 - 1e-6, False),
        ((-2.0, 1.0), 2.75 + 1e-6, True),
        ((-2.0, 1.0), 2.75 - 1e-6, False),
        ((3.0, 3.0), 2.25 - 1e-6, True),
        ((3.0, 3.0), 2.25 + 1e-6, False),
        ((-3.0, -3.0), 2.25 - 1e-6, True),
        ((-3.0, -3.0), 2.25 + 1e-6, False),
    ):
        box = CornerBox(np.array([at, -np.pi, slide[0]]), np.array([at, np.pi, slide[1]]))
        assert reach.too_far(box) == far


def test_segments_behind_a_cut_are_its_own():
    """A rail that is known, and behind it 3 and 2."""
    crane = planar([(0, X, X, True), (1, X, Z, False), (2, 3.0 * X, Z, False)], 2.0 * X)
    origin = chain([(3, np.zeros(3), X, True)], -np.array([X, Y]))
    reach = reach_of(closures([crane, origin], 4, [0, 3]))
    for at, far in ((3.0 - 1e-6, False), (3.0 + 1e-6, True)):
        assert reach.too_far(CornerBox(np.array([at, -4.0, -4.0, 0.0]), np.array([at, 4.0, 4.0, 0.0]))) == far


def test_each_loop_of_point_rows_is_a_group():
    """A chain that enters no row is in none."""
    zeros = np.zeros((2, 3))
    loops = [
        chain([(k, np.zeros(3), X, True)], np.vstack([first, second]))
        for k, (first, second) in enumerate((([X, Y], zeros), (zeros, [X, Y]), (zeros, zeros)))
    ]
    groups = reach_of(closures(loops, 3, [0])).groups
    assert [(group.rows, group.chains) for group in groups] == [((0, 1), (0,)), ((2, 3), (1,))]


def test_a_slide_without_bounds_says_nothing():
    leg = planar([(1, np.zeros(3), Z, False), (2, np.zeros(3), X, True)], 0.5 * X)
    anchor = chain([(0, np.zeros(3), X, True)], -np.array([X, Y]))
    for unbounded, far in ((frozenset(), True), (frozenset({2}), False)):
        reach = reach_of(closures([leg, anchor], 3, [0]), unbounded)
        assert reach.too_far(CornerBox(np.array([9.0, -np.pi, 0.0]), np.array([9.0, np.pi, 0.0]))) == far


def test_only_rows_of_points_alone_are_lengths():
    box = CornerBox(np.array([9.0, 0.0]), np.array([9.0, 0.0]))
    system = leg_and_anchor()
    assert reach_of(system).too_far(box)
    for row in (0, 1):
        system = leg_and_anchor()
        system.couplings[row, 0] = 1.0
        assert not reach_of(system).too_far(box)
        system = leg_and_anchor()
        system.moduli[row] = 1.0
        assert not reach_of(system).too_far(box)
    for k in (0, 1):
        system = leg_and_anchor()
        system.chains[k] = system.chains[k]._replace(direction=True)
        assert not reach_of(system).too_far(box)
    system = leg_and_anchor()
    third = chain([(0, np.zeros(3), X, True)], np.array([Z, np.zeros(3)]))
    system.chains.append(third)  # which enters one of the two rows
    assert not reach_of(system).too_far(box)


def test_an_offset_of_rows_is_a_segment():
    system = leg_and_anchor()
    system.offset[:] = [3.0, 4.0]
    assert reach_of(system).too_far(CornerBox(np.array([1.0, -2.0]), np.array([1.0, -2.0])))
    system.offset[:] = [3.0, 0.0]
    reach = reach_of(system)
    for slide, far in ((-2.0, False), (-2.0 - 1e-6, True), (-2.0 + 1e-6, True)):
        assert reach.too_far(CornerBox(np.array([1.0, slide]), np.array([1.0, slide]))) == far


def test_which_coordinates_a_search_halves_first():
    """All but last joints of chains in no other loop."""
    reach, _ = two_arms(1.0, 1.0, 2.0)
    assert reach.first.tolist() == [0]
    assert two_arms(1.0, 1.0, 2.0, unbounded=frozenset({0}))[0].first.tolist() == []
    long = planar([(1, np.zeros(3), Z, False), (2, X, Z, False)], X)
    other = chain([(0, np.zeros(3), X, True), (2, X, Z, False)], -np.array([X, Y]), X)
    loops = [c._replace(weights=np.vstack([c.weights, np.zeros((2, 3))])) for c in (long, other)]
    third = chain([(1, np.zeros(3), Z, False), (2, X, Z, False)], np.vstack([np.zeros((2, 3)), [X, Y]]), X)
    assert reach_of(closures([*loops, third], 3, [0])).first.tolist() == [0, 1, 2]


def test_boxes_and_their_parts():
    box = CornerBox(np.array([-1.0, 2.0]), np.array([3.0, 8.0]))
    np.testing.assert_array_equal(box.middle, [1.0, 5.0])
    np.testing.assert_array_equal(box.half, [2.0, 3.0])
    first, second = box.cut(0, 0.5)
    np.testing.assert_array_equal(
        [first.low, first.high, second.low, second.high], [[-1, 2], [0.5, 8], [0.5, 2], [3, 8]]
    )
    for ball, low, high in zip(box.balls(), box.low, box.high, strict=True):
        assert (float(ball.lower()), float(ball.upper())) == pytest.approx((low, high), abs=1e-7)
        assert ball.contains(low)
        assert ball.contains(high)
    third = arb(1) / 3
    assert below(third) < third < above(third)
    assert above(third) - below(third) < 1e-15


# Ranges


def close(found, expected, room=1e-6):
    np.testing.assert_allclose(found, expected, rtol=room)
    assert abs(found) >= abs(expected) * (1.0 - 1e-15)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_images_of_couplings(sign):
    """y = 5 q + 1 and z = −y/2, over the region, which is 1e-12 wider, of one more than its larger end."""
    system = closures([], 3, [0], [[5.0 * sign, -1.0, 0.0], [0.0, 1.0, 2.0]], [1.0, 0.0])
    low, high = ends(system, lower=(-2.0,), upper=(3.0,))
    expected = sorted([1.0 - 10.0 * sign, 1.0 + 15.0 * sign])
    np.testing.assert_allclose([low[0], high[0]], [-2.0 - 4e-12, 3.0 + 4e-12], rtol=0, atol=1e-15)
    np.testing.assert_allclose([low[1], high[1]], expected, rtol=0, atol=3e-7)
    np.testing.assert_allclose([low[2], high[2]], [-high[1] / 2.0, -low[1] / 2.0], rtol=0, atol=3e-7)
    assert low[1] < expected[0]
    assert high[1] > expected[1]


def test_rows_that_bound_nothing():
    """Modulo something, entered by a chain, or with a partner without an end on either side."""
    system = closures([], 3, [0], [[1.0, -1.0, 0.0]], [0.0], [2.0 * np.pi])
    assert np.isinf(ends(system)[1][1])
    arm = chain([(0, np.zeros(3), Z, False)], np.array([X]), X)
    system = closures([arm, arm._replace(weights=np.zeros((1, 3)))], 2, [0])
    system.couplings[0], system.periodic[:] = [1.0, -1.0], [True, False]
    assert np.isinf(ends(system)[1][1])
    system = closures([], 3, [0], [[1.0, -1.0, 1.0]])
    for limits in ([NONE, [-NO_LIMIT, 1.0]], [NONE, [-1.0, NO_LIMIT]]):
        low, high = ends(system, limits)
        assert not np.isfinite(low[1])
        assert not np.isfinite(high[1])
    low, high = ends(system, [NONE, [-1.0, 1.0]])
    np.testing.assert_allclose([low[1], high[1]], [0.0, 7.0], atol=1e-6)


def test_plain_angles_have_a_turn_and_others_their_limits():
    arm = planar([(1, np.zeros(3), Z, False), (2, X, Z, False)], X)
    system = closures([arm], 4, [0], [[0.0, 0.0, 1.0, -1.0]])
    low, high = ends(system, [NONE, [-2.0, 3.0], [-0.5, 9.0]])
    turn = np.pi + 1e-9
    np.testing.assert_allclose([low[1], high[1]], [-turn, turn], rtol=0, atol=1e-14)
    np.testing.assert_allclose([low[2:], high[2:]], [[-0.5, -0.5], [3.0, 3.0]], rtol=0, atol=1e-7)
    system.periodic[:] = False
    assert np.isinf(ends(system)[1][1])
    system.periodic[:] = True  # nor is what is coupled
    np.testing.assert_allclose(ends(system, [NONE, [-2.0, 3.0], NONE])[1][1:], [turn, 3.0, 3.0], rtol=0, atol=1e-7)
    system = leg_and_anchor()
    system.periodic[:] = True  # a slide is none all the same
    close(ends(system)[1][1], 6.0)


@pytest.mark.parametrize(
    ("weights", "turns", "most"),
    [
        ([X, Y], [], 6.0),
        ([X, Y], [Z], 6.0),
        ([2.0 * X, Y], [], 6.0),
        ([2.0 * X, Y], [Z], np.inf),
        ([X, Y], [Y], np.inf),
        ([X], [Z], np.inf),
        ([X, Y, Z], [Y, Z], 6.0),
    ],
)
def test_slides_are_bounded_by_lengths(weights, turns, most):
    low, high = ends(leg_and_anchor(np.array(weights), turns))
    if np.isinf(most):
        assert np.isinf(high[1])
        assert np.isinf(low[1])
    else:
        close(high[1], most)
        assert low[1] == -high[1]


def test_lengths_are_all_links_tips_and_other_slides():
    """A rail up to −7, an offset of 5, a crank of 2 and a rod of 3, and a link of 4 before the slide."""
    crank = planar([(1, np.zeros(3), Z, False), (2, 2.0 * X, Z, False)], 3.0 * X)
    slider = chain([(0, np.zeros(3), X, True), (3, 4.0 * Y, X, True)], -np.array([X, Y]))
    system = closures([crank, slider], 4, [0])
    system.offset[:] = [3.0, 4.0]
    _, high = ends(system, lower=(-7.0,), upper=(4.0,))
    close(high[3], 7.0 + 5.0 + 2.0 + 3.0 + 4.0)
    limited = ends(system, [NONE, NONE, [-1.0, 99.0]], lower=(-7.0,), upper=(4.0,))
    assert limited[0][3] == -1.0
    close(limited[1][3], 21.0)


@pytest.mark.parametrize("between", [0.3, 0.5 * np.pi, 2.0])
def test_slides_in_one_frame_are_bounded_together(between):
    along = np.cos(between) * X + np.sin(between) * Y
    carriage = planar([(1, np.zeros(3), X, True), (2, np.zeros(3), along, True)], np.zeros(3))
    crank = chain([(0, np.zeros(3), Z, False)], -np.array([X, Y]), 2.0 * X)
    high = ends(closures([carriage, crank], 3, [0]))[1]
    close(high[1], 2.0 / np.sqrt(1.0 - abs(np.cos(between))))
    close(high[2], 2.0 / np.sqrt(1.0 - abs(np.cos(between))))


def test_a_least_singular_value_that_is_proposed_is_checked(monkeypatch):
    """One that is too large bounds nothing, also where it is below each slide's own."""
    monkeypatch.setattr(stated_ranges, "_SLACK", 1.01)
    assert np.isinf(ends(leg_and_anchor())[1][1])
    carriage = planar([(1, np.zeros(3), X, True), (2, np.zeros(3), 0.6 * X + 0.8 * Y, True)], np.zeros(3))
    crank = chain([(0, np.zeros(3), Z, False)], -np.array([X, Y]), 2.0 * X)
    assert np.all(np.isinf(ends(closures([carriage, crank], 3, [0]))[1][1:]))


def test_slides_that_are_bounded_bound_each_other():
    """Two at right angles, one within limits: the other is bounded by itself, its partner at its longest."""
    carriage = planar([(1, np.zeros(3), X, True), (2, np.zeros(3), Y, True)], np.zeros(3))
    crank = chain([(0, np.zeros(3), Z, False)], -np.array([X, Y]), 2.0 * X)
    low, high = ends(closures([carriage, crank], 3, [0]), [[-0.5, 0.25], [-9.0, 9.0]])
    close(high[2], 2.5)
    assert (low[1], high[1]) == (-0.5, 0.25)


def test_slides_that_are_hardly_seen_have_no_bound():
    three = [(k, np.zeros(3), axis, True) for k, axis in ((1, X), (2, Y), (3, (X + Y) / np.sqrt(2.0)))]
    anchor = chain([(0, np.zeros(3), X, True)], -np.array([X, Y]))
    assert np.all(np.isinf(ends(closures([planar(three, np.zeros(3)), anchor], 4, [0]))[1][1:]))


def test_intervals_with_nothing_in_common_stay():
    system = closures([], 2, [0], [[5.0, -1.0]])
    for limits in ([50.0, 60.0], [-60.0, -50.0]):
        low, high = ends(system, [limits])
        assert (low[1], high[1]) == tuple(limits)


def judged(system, limits, ends, reasons, region=((1.0,), (6.0,))):
    return unproved(reach_of(system, lower=region[0], upper=region[1], limits=limits, ends=ends, reasons=reasons))


def test_ranges_follow_from_the_lemma_or_from_limits():
    """A slide of 6 at most: wider ranges hold it all, others do not; an end called a limit is one."""
    system = leg_and_anchor()
    most = float(ends(system)[1][1])
    for low, high, reasons, limits, good in (
        (-most, most, (3, 3), NONE, True),
        (-7.0, 7.0, (2, 3), NONE, True),
        (-most, np.nextafter(most, 0.0), (3, 3), NONE, False),
        (np.nextafter(-most, 0.0), most, (3, 3), NONE, False),
        (-2.0, most, (1, 3), [-2.0, NO_LIMIT], True),
        (-2.5, most, (1, 3), [-2.0, NO_LIMIT], False),  # what is called a limit is none
        (-2.5, most, (3, 3), [-2.0, NO_LIMIT], True),
        (-most, 2.0, (3, 1), [-NO_LIMIT, 2.0], True),
        (-most, 2.5, (3, 1), [-NO_LIMIT, 2.0], False),
        (-most, most, (0, 3), NONE, False),
        (-most, most, (3, 0), NONE, False),
        (-most, most, (4, 3), NONE, False),
    ):
        assert judged(system, [limits], [[low, high]], [reasons]) == ([] if good else [1])


def test_ranges_of_plain_angles_are_whole_turns():
    arm = planar([(1, np.zeros(3), Z, False)], X)
    system = closures([arm], 2, [0])
    pi = np.pi
    for low, high, reasons, limits, good in (
        (-pi, pi, (0, 0), NONE, True),
        (1.0 - pi, 1.0 + pi, (0, 0), NONE, True),
        (-pi, pi - 0.95e-12, (0, 0), NONE, True),
        (-pi, pi - 1.05e-12, (0, 0), NONE, False),
        (-pi, pi, (0, 3), NONE, False),
        (-pi, pi, (3, 0), NONE, False),
        (-pi, pi, (0, 0), [-4.0, NO_LIMIT], False),
        (-pi, pi, (0, 0), [-NO_LIMIT, 4.0], False),
    ):
        assert judged(system, [limits], [[low, high]], [reasons]) == ([] if good else [1])
