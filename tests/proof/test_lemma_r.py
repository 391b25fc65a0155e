"""Lemma R where its bounds are attained: images of couplings, lengths in a line, limits, what is not seen."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.errors import UnsupportedMechanismError
from ccpin.proof.chains import Chain
from ccpin.proof.ranges import NO_LIMIT, Ranges, Reason, ranges_of, ranges_over

X, Y, Z = np.eye(3)
_NONE = [-NO_LIMIT, NO_LIMIT]


def chain(joints, weights, tip=(0.0, 0.0, 0.0)):
    """A chain of (coordinate, link before it, axis, whether it slides), unturned."""
    numbers, links, axes, slides = zip(*joints, strict=True)
    turns = np.tile(np.eye(3), (len(joints), 1, 1))
    tip = np.array(tip, dtype=float)
    return Chain(
        np.array(numbers), turns, np.array(links, dtype=float), np.array(axes), np.array(slides), tip, False, weights
    )


def closures(chains, size, independent, couplings=(), offset=(), moduli=()):
    """φ of chains, and of rows of couplings behind theirs."""
    rows = max([len(c.weights) for c in chains], default=0)
    linear = np.zeros((rows + len(couplings), size))
    linear[rows:] = np.reshape(couplings, (-1, size))
    chains = [c._replace(weights=np.vstack([c.weights, np.zeros((len(couplings), 3))])) for c in chains]
    total = np.zeros(len(linear))
    total[: len(offset)] = offset
    slides = np.zeros(size, dtype=bool)
    for c in chains:
        slides[c.joints[c.prismatic]] = True
    return SimpleNamespace(
        chains=chains,
        couplings=linear,
        offset=total,
        moduli=np.array([*moduli, *np.zeros(len(linear) - len(moduli))]),
        independent=np.array(independent),
        dependent=np.setdiff1d(np.arange(size), independent),
        periodic=~slides & ~np.any(linear != 0.0, axis=0),
    )


def found(system, lower, upper, limits=None):
    limits = np.tile(_NONE, (len(system.dependent), 1)) if limits is None else np.array(limits)
    names = [f"joint{j}" for j in range(len(system.periodic))]
    region = np.array(lower, dtype=float), np.array(upper, dtype=float)
    return ranges_of(system, np.zeros(len(system.periodic)), region, limits, names)


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


def planar(joints, tip):
    return chain(joints, np.array([X, Y]), tip)


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
    ranges = found(system, [1.0], [6.0], [_NONE, [0.0, 9.0]])
    assert ranges.reasons[1].tolist() == [Reason.LIMIT, Reason.LENGTHS]
    assert ranges.lower[1] == 0.0
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
    ranges = found(system, [0.0], [1.0], [_NONE, [-8.0, 4.0]])
    assert_ends(Ranges(ranges.lower[:1], ranges.upper[:1], ranges.reasons[:1], ranges.limits[:1]), [-2.0], [1.0])
    assert ranges.reasons.tolist() == [2 * [Reason.COUPLING], 2 * [Reason.LIMIT]]
