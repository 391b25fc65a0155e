"""Gluing where it is sharp: balls at a tube's end, parameters at a box's, roundings of 2π, every row and turn."""

from fractions import Fraction

import mpmath
import numpy as np
import pytest

from ccpin.proof import solutions
from ccpin.proof.facts import NotProvedError, prove, prove_some
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes, boxes_of, glued_by
from tests.support.straight import at_points, boxes_about, circles, straight

U = 2.0**-53
TURN = 2.0 * np.pi


def fact_of(equations, boxes):
    return prove(SolutionsInBoxes(equations, *boxes))


def numbers(*values):
    return np.array(values, dtype=np.int64)


def tubes_of(boxes, **told):
    """Boxes as `_agree` takes them, with what facts found of them told: no noise, no slopes, h as it is, no image."""
    m = boxes.radius.shape[1]
    given = {
        "boxes": boxes,
        "image": np.zeros_like(boxes.radius),
        "noise": np.zeros_like(boxes.radius),
        "slopes": np.zeros_like(boxes.radius),
        "reached": boxes.half,
        "plain": np.all(boxes.modes == np.eye(m), axis=(1, 2)),
    }
    return solutions._GlueBoxes(**(given | told))


def point_of(row, *delta):
    return numbers(row), np.array([delta], dtype=float)


# Which facts.


def test_boxes_are_those_of_facts_about_boxes_alone():
    equations = straight([[1.0]])
    fact = fact_of(equations, boxes_about([[0.0, 0.0], [2.0, 2.0]], 0.5, [[1.0]], 0.1))
    zero = numbers(0)
    at = np.zeros((1, 1))
    glue = prove(GluedBoxes(equations, zero, zero, at, at), fact)
    assert boxes_of([fact, fact]).centre.tolist() == 2 * [[0.0, 0.0], [2.0, 2.0]]
    for facts in ([], [glue], [fact, glue]):
        with pytest.raises(NotProvedError):
            boxes_of(facts)
    points = fact_of(equations, at_points(boxes_about([[0.0, 0.0]], 0.5, [[1.0]], 0.1)))
    for facts in ([fact, points], [points, fact]):
        with pytest.raises(NotProvedError):
            boxes_of(facts)


def test_numbers_are_of_boxes_and_points_that_there_are():
    """Two boxes have no third, one point no second, and a box is no point."""
    equations = straight([[1.0]])
    boxes = boxes_about([[0.0, 0.0], [0.5, 0.5]], 0.5, [[1.0]], 0.1)
    fact = fact_of(equations, boxes)
    point = fact_of(equations, at_points(boxes_about([[0.0, 0.0]], 0.5, [[1.0]], 0.01)))
    at = np.zeros((2, 1))
    for first, second in ((numbers(0, 2), numbers(0, 0)), (numbers(0, 0), numbers(0, 3)), (numbers(0, 3), at[:, 0])):
        with pytest.raises(NotProvedError):
            prove(GluedBoxes(equations, first, second.astype(np.int64), at, at), fact)
    one = numbers(0, 0)
    prove(Met(equations, one, one, at, at, one), point, fact)
    thin = fact_of(equations, boxes_about([[0.0, 0.0]], 1e-3, [[1.0]], 0.01))
    for held, which in ((point, numbers(0, 1)), (point, numbers(0, 2)), (fact, one), (thin, one)):
        with pytest.raises(NotProvedError):
            prove(Met(equations, one, one, at, at, which), held, fact)
    for premises in ((), (point,), (fact,)):
        with pytest.raises(NotProvedError):
            prove(Met(equations, one, one, at, at, one), *premises)


def test_boxes_are_glued_only_where_their_last_parameters_are_q():
    """Twice q's step is no q; with a parameter before it the box is a path's."""
    equations, at = straight([[1.0]]), np.zeros((1, 1))
    boxes = boxes_about([[0.0, 0.0]], 0.5, [[1.0]], 0.1)
    zero = numbers(0)
    twice = fact_of(equations, boxes._replace(directions=2.0 * boxes.directions))
    with pytest.raises(NotProvedError):
        prove(GluedBoxes(equations, zero, zero, at, at), twice)
    along = np.concatenate([0.25 * boxes.directions, boxes.directions], axis=2)
    path = fact_of(equations, boxes._replace(directions=along, half=np.array([[1.0, 0.5]])))
    assert prove(GluedBoxes(equations, zero, zero, np.array([[1.0, 0.0]]), np.array([[0.0, 0.25]])), path)
    assert not prove_some(GluedBoxes(equations, zero, zero, np.array([[1.0, 0.0]]), np.zeros((1, 2))), path)[1].any()
    other = straight([[1.0, 0.0]])
    line = boxes_about([[0.0, 0.0, 0.0]], 0.5, [[1.0, 0.0]], 0.1)
    short = fact_of(other, line._replace(directions=line.directions[:, :, :1], half=line.half[:, :1]))
    with pytest.raises(NotProvedError):
        prove(GluedBoxes(other, zero, zero, at, at), short)


def test_all_pairs_are_looked_at():
    """However many there are."""
    equations, count = straight([[1.0]]), 2 * solutions._PART + 88
    fact = fact_of(equations, boxes_about([[0.0, 0.0], [0.5, 0.5]], 0.5, [[1.0]], 0.1))
    first = np.zeros(count, dtype=np.int64)
    at = np.full((count, 1), 0.25)
    assert prove_some(GluedBoxes(equations, first, first + 1, at, -at), fact)[1].all()
    assert not prove_some(GluedBoxes(equations, first, first + 1, at, at), fact)[1].any()


def test_modes_that_differ_in_one_entry_are_no_unit_matrix():
    """A tube a tenth as wide along one mode does not hold what one of the unit matrix would."""
    equations = straight([[1.0], [1.0]])
    boxes = boxes_about(2 * [[0.0, 0.0, 0.0]], 0.5, [[1.0], [1.0]], 0.1)
    narrow = np.diag([1.0, 0.1])
    modes, inverse = np.array([np.eye(2), narrow]), np.array([np.eye(2), np.linalg.inv(narrow)])
    centre = boxes.centre.copy()
    centre[0, 2] = 0.05
    fact = fact_of(equations, boxes._replace(centre=centre, modes=modes, preconditioner=inverse))
    found = solutions._tubes_of(equations, [fact])
    assert found.plain.tolist() == [True, False]


# Where points are.


def test_parameters_are_added_to_the_centre_as_they_are():
    """q of c + Dδ to the order of u²: sums and products of doubles, exactly."""
    rng = np.random.default_rng(1)
    equations, K = straight(np.ones((1, 2))), 40
    boxes = boxes_about(rng.normal(size=(K, 3)), 1.0, np.ones((1, 2)), 1.0)
    along = rng.normal(size=(K, 3, 2))
    boxes = boxes._replace(directions=np.concatenate([along, boxes.directions], axis=2), half=np.ones((K, 4)))
    delta = rng.normal(size=(K, 4))
    total, rest = solutions._exact(equations, boxes, np.arange(K), delta)
    for k in range(K):
        for i in range(2):
            stated = sum(
                (Fraction(along[k, i, j]) * Fraction(delta[k, j]) for j in range(2)), Fraction(boxes.centre[k, i])
            ) + Fraction(delta[k, 2 + i])
            assert abs(Fraction(total[k, i]) + Fraction(rest[k, i]) - stated) < 40 * U**2


def placed(equations, boxes, delta, q=None, **told):
    """Where a point of q is against the first box."""
    q = None if q is None else tuple(np.array([part], dtype=float) for part in q)
    return solutions._placed(equations, tubes_of(boxes, **told), point_of(0, *delta), q)


def test_a_point_is_as_far_off_as_its_two_doubles_say():
    """At (½, 1) + δ: the differences of what is left in either, the largest of the coordinates."""
    equations = straight([[1.0, 2.0]])
    boxes = boxes_about([[0.5, 1.0, 3.0]], 1.0, [[1.0, 2.0]], 1.0)
    own = placed(equations, boxes, (0.25, U))
    assert (own.off.tolist(), own.over.tolist(), own.turn.tolist()) == ([0.0], [True], [[0, 0]])
    np.testing.assert_allclose(own.base, [[0.75, 1.0, 3.25]], rtol=1e-15)
    for q, off in (
        (([0.75, 1.0], [0.0, 0.0]), U / 1.0),
        (([0.75, 1.0], [0.0, U]), 0.0),
        (([0.75, 1.0], [-U / 4, U]), U / 4),
        (([0.75, 1.0], [3 * U, U]), 3 * U),
        (([0.875, 1.0], [0.0, U]), 0.125),
        (([0.75, 1.25], [0.0, U]), 0.25),
    ):
        found = placed(equations, boxes, (0.25, U), q)
        assert found.off.tolist() == [off]
    small = placed(
        equations, boxes_about([[0.0, 0.0, 0.0]], 1.0, [[1.0, 2.0]], 1.0), (U, 0.0), ([1.0, 0.0], [0.0, 0.0])
    )
    assert small.off.tolist() == [1.0 - U]


def test_what_is_off_counts_as_far_from_the_centre():
    """|δ| + off ≤ h, coordinate by coordinate, of the parameters that are q."""
    equations = straight([[1.0, 2.0]])
    boxes = boxes_about([[0.0, 0.0, 0.0]], [1.0, 0.5], [[1.0, 2.0]], 1.0)
    nothing = np.zeros(2)
    for delta, q, over in (
        ((1.0, 0.5), (1.0, 0.5), True),
        ((1.0001, 0.5), (1.0001, 0.5), False),
        ((1.0, -0.5001), (1.0, -0.5001), False),
        ((0.75, 0.25), (1.0, 0.25), True),
        ((0.75, 0.25), (1.0001, 0.25), False),
        ((0.0, 0.0), (0.0, 0.5001), False),
    ):
        assert placed(equations, boxes, delta, (q, nothing)).over.tolist() == [over]
    along = np.concatenate([np.zeros((1, 3, 1)), boxes.directions], axis=2)
    path = boxes._replace(directions=along, half=np.array([[1.0, 1.0, 0.5]]))
    assert placed(equations, path, (1.0, 0.75, 0.25), ((1.0, 0.25), nothing)).over.tolist() == [True]
    assert placed(equations, path, (1.0001, 0.75, 0.25), ((0.75, 0.25), nothing)).over.tolist() == [False]


@pytest.mark.parametrize("turns", [1, -1, 2, 3, 11, -11, 1335313])
def test_whole_turns_are_off_by_what_their_number_is_off_from_pi(turns):
    """2π is no double and its multiples are rounded: by 2.21u and at most 6.29u a turn."""
    equations = circles()
    boxes = boxes_about([[0.0, 0.0]], 1.0, [[-1.0]], 1.0)
    q = TURN * turns
    found = placed(equations, boxes, (0.0,), ([q], [0.0]))
    assert found.turn.tolist() == [[turns]]
    with mpmath.workprec(200):
        exact = abs(mpmath.mpf(q) - 2 * mpmath.pi * turns)
        assert exact <= found.off[0] <= 8.5 * U * abs(turns) * (1 + 4 * U)
    near = placed(equations, boxes, (2 * U,), ([TURN], [0.0]))
    assert near.off[0] == pytest.approx(2 * U + 8.5 * U, rel=1e-12, abs=0.0)  # the sum of 2π and 2u is rounded to 2π
    straight_on = placed(straight([[1.0]]), boxes_about([[0.0, 0.0]], 1.0, [[1.0]], 1.0), (0.0,), ([TURN], [0.0]))
    assert straight_on.turn.tolist() == [[0]]
    assert not straight_on.over[0]


# Two boxes.


def agree(first, second, at=(0.2, 0.0), **told):
    """Whether two boxes, one with slope 0 and Ã = ½ about y = 0 where y = q, are glued."""
    boxes = boxes_about([[0.0, 0.0], [0.2, second[0]]], 1.0, [[0.0]], [[first], [second[1]]], 0.5)
    told = {"image": np.array([[0.5 * first], [0.0]])} | told
    tubes = tubes_of(boxes, **told)
    found = solutions._agree(straight([[1.0]]), tubes, point_of(0, at[0]), point_of(1, at[1]))
    return bool(found[0][0])


@pytest.mark.parametrize("less", [1e-8, -1e-8])
def test_a_ball_is_where_theorem_n_has_it(less):
    """|f| = 0.1 of R − Z̄R = ½: ζ* + f is within 0.2 · ½ of 0, so y between 0 and 0.2, where it is."""
    assert agree(1.0, (0.1, 0.1 + less)) == (less > 0)
    assert agree(1.0, (0.1 + less, 0.1)) is False
    assert agree(1.0, (0.0, 0.2 + less)) == (less > 0)
    assert agree(1.0, (0.2, 0.2 + less)) == (less > 0)


@pytest.mark.parametrize("less", [1e-6, -1e-6])
def test_a_box_with_no_room_left_says_nothing(less):
    """|f| ≤ R − Z̄R: 0.1 of ½R; with 0.02 of noise 0.12, and the ball is 0.02 larger yet."""
    assert agree(0.2 + less, (0.1, 9.0)) == (less > 0)
    noise = {"noise": np.array([[0.02], [0.0]])}
    assert agree(0.24 + less, (0.1, 9.0), **noise) == (less > 0)
    assert agree(1.0, (0.1, 0.24 * 0.5 + 0.02 + less), **noise) == (less > 0)


def test_rounding_counts_in_the_room_and_in_the_ball():
    """1 + 1e-10 of Z̄R, and of the ball."""
    image = {"image": np.array([[1.0 - 1e-9], [0.0]])}
    boxes = boxes_about([[0.0, 0.0], [0.0, 0.0]], 1.0, [[0.0]], [[1.0], [9.0]], 0.5)
    for residual, held in ((0.89e-9, True), (0.91e-9, False)):
        tubes = tubes_of(boxes, **image)
        at = 2.0 * residual
        found = solutions._agree(straight([[1.0]]), tubes, point_of(0, at), point_of(1, at))
        assert bool(found[0][0]) is held
    assert not agree(1.0, (0.1, 0.1 + 2e-11))


@pytest.mark.parametrize(("first", "second"), [(0.1, 0.3), (0.3, 0.1)])
def test_all_rows_have_to_have_room(first, second):
    """Two rows, of which one has too little."""
    boxes = boxes_about(2 * [[0.0, 0.0, 0.0]], 1.0, [[0.0], [0.0]], [[first, second], [9.0, 9.0]])
    equations = straight([[0.2], [0.2]])
    found = solutions._agree(equations, tubes_of(boxes), point_of(0, 1.0), point_of(1, 1.0))
    assert not found[0][0]
    wide = boxes._replace(radius=np.array([[0.3, 0.3], [9.0, 9.0]]))
    assert solutions._agree(equations, tubes_of(wide), point_of(0, 1.0), point_of(1, 1.0))[0][0]


def test_the_point_is_in_both_boxes():
    assert agree(1.0, (0.1, 0.3))
    assert not agree(1.0, (0.1, 0.3), reached=np.array([[0.19], [1.0]]))
    assert agree(1.0, (0.1, 0.3), at=(0.2, -0.1), reached=np.array([[1.0], [0.2001]]))
    assert not agree(1.0, (0.1, 0.3), at=(0.2, -0.1), reached=np.array([[1.0], [0.1999]]))


def test_a_tube_moves_with_the_point_where_it_leans():
    """What the point is off by counts with the second's slope."""
    slopes = {"slopes": np.array([[0.0], [3.0]])}
    assert agree(1.0, (0.1, 0.1301), at=(0.2, 0.01), **slopes)
    assert not agree(1.0, (0.1, 0.1299), at=(0.2, 0.01), **slopes)


def test_modes_count_whichever_of_the_two_boxes_has_them():
    """ζ and tubes are in them: of a first with V = 2 the ball is twice as large, a second with V = ½ half as wide."""
    equations = straight([[1.0]])
    boxes = boxes_about([[0.0, 0.0], [0.2, 0.1], [0.2, 0.1]], 1.0, [[0.0]], [[1.0], [0.1001], [0.1999]], 0.5)
    modes = np.array([1.0, 1.0, 0.5])[:, None, None]
    tubes = tubes_of(boxes._replace(modes=modes), image=np.full((3, 1), 0.5))
    first, at = numbers(0, 0), np.array([[0.2], [0.2]])
    for second, held in ((numbers(1, 2), [True, False]), (numbers(2, 1), [False, True])):
        assert solutions._agree(equations, tubes, (first, at), (second, 0.0 * at))[0].tolist() == held
    # With V = 2 and Ã = ¼ (f_ζ = ½) residuals are 0.05, steps 0.1, and the ball, half as large in ζ, is as large.
    modes = np.array([1.0, 1.0, 2.0])[:, None, None]
    gain = np.array([0.5, 0.5, 0.25])[:, None, None]
    own = boxes._replace(
        modes=modes, preconditioner=gain, centre=np.array([[0.2, 0.1], [0.0, 0.0], [0.0, 0.0]]),
        radius=np.array([[0.1001], [1.0], [0.5]]),
    )  # fmt: skip
    tubes = tubes_of(own, image=np.array([[0.5], [0.5], [0.25]]))
    for first in (numbers(1, 2), numbers(2, 1)):
        assert solutions._agree(equations, tubes, (first, at), (numbers(0, 0), 0.0 * at))[0].tolist() == [True, True]
    lower = own.centre.copy()
    lower[0, 1] = -0.425
    for centre, radius in ((own.centre, 0.0999), (lower, 0.575)):  # to 0.1999, and to 0.15
        narrow = tubes._replace(boxes=own._replace(centre=centre, radius=np.array([[radius], [1.0], [0.5]])))
        for first in (numbers(1, 2), numbers(2, 1)):
            found = solutions._agree(equations, narrow, (first, at), (numbers(0, 0), 0.0 * at))
            assert found[0].tolist() == [False, False]


def test_turns_between_boxes_are_found():
    """sin(q + y) = 0: boxes at q = 3 and 3 − 2π are one turn apart, in q and in y."""
    equations = circles()
    fact = fact_of(equations, boxes_about([[3.0, -3.0], [3.0 - TURN, TURN - 3.0]], 0.2, [[-1.0]], 0.1))
    first, second, at = numbers(0, 1, 0), numbers(1, 0, 0), np.full((3, 1), 0.1)
    assert prove(GluedBoxes(equations, first, second, at, at), fact).found["turn"].tolist() == [[1], [-1], [0]]
    point = fact_of(equations, at_points(boxes_about([[3.1 + TURN, -3.1]], 0.5, [[-1.0]], 1e-3)))
    met = prove(Met(equations, first, second, at, at, numbers(0, 0, 0)), point, fact)
    assert met.found["turn"].tolist() == [[1], [-1], [0]]


def test_a_point_is_in_both_boxes_and_in_their_tubes():
    """y = q: a point at (0.5, 0.5) with an error of 0.001 and more, in tubes of 0.1."""
    equations = straight([[1.0]])
    fact = fact_of(equations, boxes_about([[0.0, 0.0], [0.5, 0.595]], 0.5, [[1.0]], 0.1))
    zero, one = numbers(0), numbers(1)

    def met(first, second, at, there, error=0.001):
        point = fact_of(equations, at_points(boxes_about([[0.5, 0.5]], 0.5, [[1.0]], error)))
        claim = Met(equations, first, second, np.array([[at]]), np.array([[there]]), zero)
        return bool(prove_some(claim, point, fact)[1][0])

    assert met(zero, one, 0.5, 0.0)
    assert met(one, zero, 0.0, 0.5)
    assert met(zero, one, 0.48, 0.0)  # 0.02 off
    for first, second, at, there, error in (
        (zero, one, 0.51, 0.0, 0.001),  # beyond the first
        (one, zero, 0.0, 0.51, 0.001),
        (zero, one, 0.5, 0.0, 0.0051),  # beyond the second's tube
        (one, zero, 0.0, 0.5, 0.0051),
    ):
        assert not met(first, second, at, there, error)


def test_which_boxes_a_fact_glues():
    """All of the premises, but for the points; of other facts none."""
    equations, (zero, one), at = straight([[1.0]]), (numbers(0), numbers(0)), np.array([[0.5]])
    fact = fact_of(equations, boxes_about([[0.0, 0.0]], 0.5, [[1.0]], 0.1))
    other = fact_of(equations, boxes_about([[0.5, 0.5]], 0.5, [[1.0]], 0.1))
    point = fact_of(equations, at_points(boxes_about([[0.5, 0.5]], 0.5, [[1.0]], 0.001)))
    assert glued_by(prove(GluedBoxes(equations, zero, numbers(1), at, 0.0 * at), fact, other)) == (fact, other)
    assert glued_by(prove(Met(equations, zero, zero, at, at, one), point, fact)) == (fact,)
    with pytest.raises(NotProvedError, match="other kinds"):
        glued_by(fact)
