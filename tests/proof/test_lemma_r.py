"""Lemma R where its bounds are attained: images of couplings, lengths in a line, limits, what is not seen."""

import numpy as np
import pytest

from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.ranges import NO_LIMIT, Ranges, Reason, ranges_of, ranges_over
from tests.support.chains import NONE, X, Y, Z, chain, closures, leg_and_anchor, planar


def found(system, lower, upper, limits=None, middle=0.0):
    limits = np.tile(NONE, (len(system.dependent), 1)) if limits is None else np.array(limits)
    names = [f"joint{j}" for j in range(len(system.periodic))]
    region = np.array(lower, dtype=float), np.array(upper, dtype=float)
    return ranges_of(system, np.full(len(system.periodic), middle), region, limits, names)


def assert_ends(ranges, lower, upper):
    """The ends are these, outward, by two parts in a million at most."""
    for ends, exact, side in ((ranges.lower, np.array(lower), -1.0), (ranges.upper, np.array(upper), 1.0)):
        beyond = side * (ends - exact)
        assert np.all(beyond >= 0.0)
        assert np.all(beyond <= 3e-6 * (1.0 + np.abs(exact)) * 2.0 ** np.arange(len(beyond))), (ranges, exact)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_images_of_couplings_are_as_wide_as_they_are(sign):
    """y = 5 q + 1 and z = −y/2, each from a row solved for another of its unknowns."""
    rows = [[5.0 * sign, -1.0, 0.0], [0.0, 1.0, 2.0]]
    ranges = found(closures([], 3, [0], rows, [1.0, 0.0]), [-2.0], [3.0])
    ends = sorted([1.0 - 10.0 * sign, 1.0 + 15.0 * sign])
    assert_ends(ranges, [ends[0], -ends[1] / 2.0], [ends[1], -ends[0] / 2.0])
    assert np.all(ranges.reasons == Reason.COUPLING)


def test_rows_known_modulo_something_bound_nothing():
    """A relation of angles on circles says nothing of how often they turn."""
    with pytest.raises(UnsupportedMechanismError, match="'joint1' has no range"):
        found(closures([], 2, [0], [[1.0, -1.0]], [0.0], [2.0 * np.pi]), [0.0], [1.0])


def test_lengths_bound_a_slide_by_all_links_in_a_line():
    """A rail carried up to 4 and −7, a crank of 2 and a rod of 3: |s| ≤ 7 + 2 + 3, as for the crank stretched away."""
    crank = planar([(1, np.zeros(3), Z, False), (2, 2.0 * X, Z, False)], 3.0 * X)
    slider = chain([(0, np.zeros(3), X, True), (3, np.zeros(3), X, True)], -np.array([X, Y]))
    ranges = found(closures([crank, slider], 4, [0, 1]), [-7.0, -1.0], [4.0, 1.0])
    assert_ends(ranges, [-np.pi, -12.0], [np.pi, 12.0])
    assert ranges.reasons.tolist() == [2 * [Reason.TURN], 2 * [Reason.LENGTHS]]
    assert ranges.turning.tolist() == [True, False]


@pytest.mark.parametrize(("axis", "seen"), [(Z, True), (Y, False)])
def test_a_slide_behind_a_turn_is_bounded_where_the_rows_see_it(axis, seen):
    """A leg that turns about what the rows do not see keeps its length for them; about another axis it need not."""
    leg = planar([(1, np.zeros(3), axis, False), (2, np.zeros(3), X, True)], np.zeros(3))
    anchor = chain([(0, np.zeros(3), X, True)], -np.array([X, Y]), 0.5 * Y)
    system = closures([leg, anchor], 3, [0])
    if seen:
        assert_ends(found(system, [1.0], [6.0]), [-np.pi, -6.5], [np.pi, 6.5])
    else:
        with pytest.raises(UnsupportedMechanismError, match="'joint2' has no range"):
            found(system, [1.0], [6.0])


def test_three_rows_see_a_slide_behind_any_turns():
    """W = 1 keeps all lengths."""
    turns = [(1, np.zeros(3), Z, False), (2, X, Y, False)]
    leg = chain([*turns, (3, np.zeros(3), X, True)], np.eye(3))
    anchor = chain([(0, np.zeros(3), X, True)], -np.eye(3))
    ranges = found(closures([leg, anchor], 4, [0]), [1.0], [6.0])
    assert_ends(ranges, [-np.pi, -np.pi, -7.0], [np.pi, np.pi, 7.0])


@pytest.mark.parametrize("between", [0.3, 0.5 * np.pi, 2.0])
def test_slides_in_one_frame_are_bounded_together(between):
    """Two slides at an angle α hold |s| ≤ r/σ, σ² = 1 − |cos α|, and that is where a point of the circle is."""
    along = np.cos(between) * X + np.sin(between) * Y
    carriage = planar([(1, np.zeros(3), X, True), (2, np.zeros(3), along, True)], np.zeros(3))
    crank = chain([(0, np.zeros(3), Z, False)], -np.array([X, Y]), 2.0 * X)
    ranges = found(closures([carriage, crank], 3, [0]), [-3.0], [3.0])
    most = 2.0 / np.sqrt(1.0 - abs(np.cos(between)))
    turns = np.linspace(-3.0, 3.0, 1000)
    slides = np.linalg.solve(np.array([X[:2], along[:2]]).T, 2.0 * np.array([np.cos(turns), np.sin(turns)]))
    assert np.all(np.abs(slides) <= ranges.upper[:, None])
    assert np.all(ranges.upper <= most * 1.00001)


def test_limits_are_ends_where_nothing_else_is_nearer():
    """A limit within what lengths leave is an end of its own kind; beyond them, or on the other side, it is none."""
    leg = planar([(1, np.zeros(3), Z, False), (2, np.zeros(3), X, True)], np.zeros(3))
    anchor = chain([(0, np.zeros(3), X, True)], -np.array([X, Y]))
    system = closures([leg, anchor], 3, [0])
    ranges = found(system, [1.0], [6.0], [NONE, [0.0, 9.0]])
    assert ranges.reasons[1].tolist() == [Reason.LIMIT, Reason.LENGTHS]
    assert ranges.lower[1] == 0.0
    assert ranges.middle.tolist() == np.mean([ranges.lower, ranges.upper], axis=0).tolist()
    low, high = np.array([[-4.0, 1e-10]]), np.array([[4.0, 5.0]])
    assert ranges.at_limit(low, high).tolist() == [True]
    assert ranges.at_limit(low + [0.0, 1e-8], high + [0.0, 2.0]).tolist() == [False]
    farther = ranges_over(system, ranges, (np.array([1.0]), np.array([20.0])))
    assert farther.reasons[1].tolist() == [Reason.LIMIT, Reason.LIMIT]
    assert isinstance(farther, Ranges)


def test_limits_of_one_joint_bound_what_is_coupled_to_it():
    """Nothing bounds the elbow but its rotor's limits."""
    turning = planar([(0, np.zeros(3), Z, False), (1, X, Z, False)], X)
    system = closures([turning], 3, [0], [[0.0, 4.0, -1.0]])
    system.dependent = np.array([1, 2])
    with pytest.raises(UnsupportedMechanismError, match="'joint1' has no range"):
        found(system, [0.0], [1.0])
    ranges = found(system, [0.0], [1.0], [NONE, [-8.0, 4.0]])
    assert_ends(Ranges(ranges.lower[:1], ranges.upper[:1], ranges.reasons[:1], ranges.limits[:1]), [-2.0], [1.0])
    assert ranges.reasons.tolist() == [2 * [Reason.COUPLING], 2 * [Reason.LIMIT]]


def of(lower, upper, reasons):
    return Ranges(np.array(lower), np.array(upper), np.array(reasons, dtype=np.int8), np.tile(NONE, (len(lower), 1)))


def test_at_a_limit_is_within_a_billionth():
    """Of one more than the larger end."""
    ranges = of([-3.0, -0.5], [1.0, 2.0], [[Reason.LIMIT, Reason.COUPLING], [Reason.LENGTHS, Reason.LIMIT]])
    np.testing.assert_allclose(ranges.edge, [4e-9, 3e-9], rtol=1e-12)
    inside = np.array([-2.0, 0.0]), np.array([0.5, 1.0])
    for axis, side, end, edge in ((0, 0, -3.0, 4e-9), (1, 1, 2.0, 3e-9)):
        for share, meets in ((0.999, True), (1.001, False)):
            box = [corner.copy()[None] for corner in inside]
            box[side][0, axis] = end + (1.0 - 2.0 * side) * share * edge
            assert ranges.at_limit(*box).tolist() == [meets]
            box[side][0, axis] = end - (1.0 - 2.0 * side)
            assert ranges.at_limit(*box).tolist() == [True]
    beyond = np.array([[-2.0, -0.5]]), np.array([[1.0, 1.0]])  # ends that are derived are none
    assert ranges.at_limit(*beyond).tolist() == [False]


def test_full_turns_are_about_their_middle():
    arm = planar([(1, np.zeros(3), Z, False)], X)
    anchor = chain([(0, np.zeros(3), X, True)], -np.array([X, Y]))
    system = closures([arm, anchor], 2, [0])
    for middle in (0.0, 5.0):
        ranges = found(system, [0.5], [1.0], middle=middle)
        for same in (ranges, ranges_over(system, ranges, (np.array([0.5]), np.array([0.7])))):
            np.testing.assert_allclose([same.lower, same.upper], [[middle - np.pi], [middle + np.pi]], rtol=1e-15)


def test_one_end_is_no_range():
    arm = planar([(1, np.zeros(3), X, True)], X)
    for limits in ([-NO_LIMIT, 4.0], [-4.0, NO_LIMIT]):
        with pytest.raises(UnsupportedMechanismError, match="'joint1' has no range"):
            found(closures([arm._replace(direction=True)], 2, [0]), [0.0], [1.0], [limits])


@pytest.mark.parametrize("what", ["slide", "coupled", "not periodic"])
def test_only_plain_angles_have_a_full_turn(what):
    """Whatever is called periodic."""
    arm = planar([(1, np.zeros(3), X if what == "slide" else Z, what == "slide"), (2, X, Z, False)], X)
    rows = [[0.0, 0.0, 1.0, 0.0], [0.0, 1.0 * (what == "coupled"), 0.0, 0.0]]
    system = closures([arm._replace(direction=True)], 4, [0, 3], rows, moduli=[0.0, 0.0, 1.0, 1.0])
    system.periodic[:] = True
    system.periodic[1] = what != "not periodic"
    with pytest.raises(UnsupportedMechanismError, match="'joint1' has no range"):
        found(system, [0.0, 0.0], [1.0, 1.0], [NONE, [-1.0, 1.0]])
    ranges = found(system, [0.0, 0.0], [1.0, 1.0], [[-2.0, 3.0], [-1.0, 1.0]])
    assert ranges.turning.tolist() == [False, False]
    np.testing.assert_allclose([ranges.lower, ranges.upper], [[-2.0, -1.0], [3.0, 1.0]])


def test_images_are_widened_by_a_millionth():
    """Of one more than the larger end, whichever it is; another end, of a limit, stays."""
    for sign in (-1.0, 1.0):
        system = closures([], 2, [0], [[5.0, sign]], [1.0])
        low, high = sorted([sign * 9.0, -sign * 16.0])
        ranges = found(system, [-2.0], [3.0])
        np.testing.assert_allclose([ranges.lower[0], ranges.upper[0]], [low - 17e-6, high + 17e-6], rtol=0, atol=1e-12)
    wide, top = [-10.0, 30.0], 16.0 + 17e-6
    system = closures([], 2, [0], [[5.0, -1.0]], [1.0])
    for limits, ends, reasons in (
        (wide, (-9.0 - 17e-6, top), 2 * [Reason.COUPLING]),
        ([10.0, 30.0], (10.0, top), [Reason.LIMIT, Reason.COUPLING]),
        ([-30.0, -5.0], (-9.0 - 17e-6, -5.0), [Reason.COUPLING, Reason.LIMIT]),
        ([20.0, 30.0], (20.0, 30.0), 2 * [Reason.LIMIT]),  # nothing in common: no such configuration
        ([-30.0, -20.0], (-30.0, -20.0), 2 * [Reason.LIMIT]),
    ):
        ranges = found(system, [-2.0], [3.0], [limits])
        np.testing.assert_allclose([ranges.lower[0], ranges.upper[0]], ends, rtol=0, atol=1e-12)
        assert ranges.reasons[0].tolist() == reasons


@pytest.mark.parametrize("what", ["chain", "one of two chains", "modulo"])
def test_rows_that_chains_enter_are_no_couplings(what):
    arm = chain([(0, np.zeros(3), Z, False)], np.array([X]), X)
    idle = arm._replace(weights=np.zeros((1, 3)))
    system = closures([arm if "chain" in what else idle, idle], 2, [0])
    system.couplings[0] = [1.0, -1.0]
    system.moduli[0] = what == "modulo"
    for limits, good in (([[-1.0, 1.0]], True), (None, False)):
        if good:
            assert found(system, [-0.5], [0.5], limits).upper[0] == 1.0
        else:
            with pytest.raises(UnsupportedMechanismError):
                found(system, [-0.5], [0.5], limits)


def bounds(system, most):
    """Whether the slide is bounded just so, or (None) not at all."""
    if most is None:
        with pytest.raises(UnsupportedMechanismError, match="'joint1' has no range"):
            found(system, [1.0], [6.0])
    else:
        ranges = found(system, [1.0], [6.0])
        assert_ends(ranges._replace(lower=ranges.lower[:1], upper=ranges.upper[:1]), [-most], [most])


def test_only_rows_of_points_alone_bound_slides():
    """Not those that a coupling enters, that hold modulo something, or that a direction enters."""
    bounds(leg_and_anchor(), 6.0)
    for row in (0, 1):
        system = leg_and_anchor()
        system.couplings[row, 0] = 1.0
        bounds(system, None)
        system = leg_and_anchor()
        system.moduli[row] = 1.0
        bounds(system, None)
    for k in (0, 1):
        system = leg_and_anchor()
        system.chains[k] = system.chains[k]._replace(direction=True)
        bounds(system, None)
    system = leg_and_anchor()
    compass = chain([(0, np.zeros(3), Z, False)], np.array([Z * 0.0, Z * 0.0, X]), X)._replace(direction=True)
    system.chains = [c._replace(weights=np.vstack([c.weights, np.zeros(3)])) for c in system.chains] + [compass]
    system.couplings, system.offset, system.moduli = np.zeros((3, 2)), np.zeros(3), np.zeros(3)
    bounds(system, 6.0)


@pytest.mark.parametrize(
    ("weights", "turns", "most"),
    [
        ([X, Y], [Z], 6.0),
        ([X], [Z], None),  # one row sees a slide turned
        ([2.0 * X, Y], [Z], None),
        ([X, Y], [Y], None),
        ([X, Y], [Y, Z], None),
        ([X, Y], [Z, Y], None),
        ([2.0 * X, Y], [], 6.0),
        ([X, Y, Z], [Y, Z], 6.0),
        ([2.0 * X, Y, Z], [Y], None),
    ],
)
def test_what_rows_see_behind_turns(weights, turns, most):
    bounds(leg_and_anchor(np.array(weights), turns), most)


def test_tips_are_seen_as_long_as_they_are():
    """In the plane of two rows, through weights of their own, and, where a turn is in the way, times their norm."""
    bounds(leg_and_anchor(tip=(0.0, 2.0, 7.0)), 8.0)
    bounds(leg_and_anchor(np.array([4.0 * X, Y]), tip=(0.0, 2.0, 7.0)), 6.5)
    for axis, most in ((Z, 8.0), (Y, 6.0 + np.sqrt(53.0))):
        leg = planar([(1, np.zeros(3), X, True)], np.zeros(3))
        turn = chain([(0, np.zeros(3), X, True), (2, np.zeros(3), axis, False)], -np.array([X, Y]), (0.0, 2.0, 7.0))
        bounds(closures([leg, turn], 3, [0]), most)


def test_more_slides_than_rows_have_no_bound():
    """Three in a plane may go far and cancel."""
    slides = [(k, np.zeros(3), axis, True) for k, axis in ((1, X), (2, Y), (3, (X + Y) / np.sqrt(2.0)))]
    anchor = chain([(0, np.zeros(3), X, True)], -np.array([X, Y]))
    bounds(closures([planar(slides, np.zeros(3)), anchor], 4, [0]), None)


def test_offsets_of_points_are_lengths_too():
    system = leg_and_anchor()
    system.offset[:] = [3.0, 4.0]
    bounds(system, 11.0)
