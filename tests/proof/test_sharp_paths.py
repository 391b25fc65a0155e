"""Paths followed at equality: tubes that just fill their boxes, ends, knots, jumps, and the way from box to box."""

from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof import paths
from ccpin.proof.facts import NotProvedError, prove, prove_some
from ccpin.proof.newton import reached
from ccpin.proof.paths import Followed, follows
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes
from tests.support.straight import at_points, boxes_about, straight, whole_numbers

U = 2.0**-53
LINE = straight([[1.0]])


def boxes_along(middles, along, half=0.5, far=5.0, equations=LINE):
    """Boxes about stretches of y = Σq from middle − along to middle + along, as wide as told, |s| ≤ far."""
    middles, along = np.atleast_2d(middles), np.atleast_2d(along)
    slope = np.ones((1, middles.shape[1]))
    centre = np.hstack([middles, middles.sum(axis=1, keepdims=True)])
    boxes = boxes_about(centre, half, slope, 0.1)
    step = np.hstack([along, along.sum(axis=1, keepdims=True)])[..., None]
    wide = np.hstack([np.full((len(middles), 1), far), boxes.half])
    boxes = boxes._replace(half=wide, directions=np.concatenate([step, boxes.directions], axis=2))
    return prove(SolutionsInBoxes(equations, *boxes))


def met(boxes, q, first, at, second=None, there=None, equations=LINE):
    """That the solution over q is that of a box at s, and of another."""
    q = np.atleast_1d(np.array(q, dtype=float))
    slope = np.ones((1, len(q)))
    point = at_points(boxes_about([[*q, q.sum()]], 0.0, slope, 1e-3))
    second, there = (first, at) if second is None else (second, there)
    ends = (np.array([[s, *np.zeros(len(q))]]) for s in (at, there))
    numbers = whole_numbers(first), whole_numbers(second)
    return prove(Met(equations, *numbers, *ends, whole_numbers(0)), prove(SolutionsInBoxes(equations, *point)), boxes)


def glued(boxes, at=1.0, there=-1.0):
    """Box 0 at s and box 1 at s′."""
    ends = np.array([[at, 0.0]]), np.array([[there, 0.0]])
    return prove(GluedBoxes(LINE, whole_numbers(0), whole_numbers(1), *ends), boxes)


def followed(coefficients=((1.0,), (0.0,)), knots=(0.0, 1.0), times=(0.0, 0.5, 1.0), tube=(0.1,), equations=LINE):
    """q = t from 0 to 1, in two stretches; coefficients by power and piece."""
    coefficients = np.array(coefficients, dtype=float)
    coefficients = coefficients if coefficients.ndim == 3 else coefficients[..., None]
    return Followed(equations, coefficients, np.array(knots), np.array(times), np.array(tube))


@pytest.fixture(scope="module")
def two():
    """Boxes about both stretches, the start in the first, what glues them."""
    boxes = boxes_along([[0.25], [0.75]], [[0.25], [0.25]])
    return boxes, met(boxes, 0.0, 0, -1.0), glued(boxes)


def test_a_line_is_followed(two):
    fact = prove(followed(), *two)
    assert fact.found["seed"].tolist() == [[0.0, 0.0]]
    prove(followed(), two[0], two[1], met(two[0], 0.5, 0, 1.0, 1, -1.0))
    starts = np.array([[-1.0, 0.0], [-0.5, 0.0]]), np.array([[-1.0, 0.0], [-0.5, 0.0]])
    points = prove(SolutionsInBoxes(LINE, *at_points(boxes_about([[0.0, 0.0], [0.125, 0.125]], 0.0, [[1.0]], 1e-3))))
    three = boxes_along([[0.125], [0.5], [0.875]], [[0.125], [0.25], [0.125]])
    ends = np.array([[1.0, 0.0], [1.0, 0.0]]), np.array([[-1.0, 0.0], [-1.0, 0.0]])
    links = GluedBoxes(LINE, whole_numbers(0, 1), whole_numbers(1, 2), *ends)
    claim = followed(times=(0.0, 0.25, 0.75, 1.0))
    start = met(three, 0.0, 0, -1.0)
    prove(claim, three, start, prove(links, three))
    for k in (0, 1):
        with pytest.raises(NotProvedError):
            prove(claim, three, start, prove(links.take([k]), three))
    many = Met(LINE, *(np.zeros(2, dtype=np.int64) for _ in range(2)), *starts, whole_numbers(0, 1))
    assert prove(followed(), two[0], prove(many, points, two[0]), two[2]).found["seed"].tolist() == [[0.0, 0.0]]


def test_what_says_less_is_no_premise(two):
    """No start, no boxes, boxes of more stretches or of other parameters, a start in twins, elsewhere or at the end."""
    boxes, start, glue = two
    twins = boxes.replay()
    three = boxes_along([[0.25], [0.75], [1.25]], 3 * [[0.25]])
    plain = prove(SolutionsInBoxes(LINE, *boxes_about([[0.25, 0.25], [0.75, 0.75]], 0.5, [[1.0]], 0.1)))
    one = boxes_along([[0.25]], [[0.25]])
    end = np.array([[-1.0, 0.0]])
    started = GluedBoxes(LINE, whole_numbers(0), whole_numbers(0), end, end)
    for premises in (
        (),
        (boxes,),
        (boxes, glue, start),
        (boxes, prove(started, boxes, boxes), glue),
        (start, start, glue),
        (three, met(three, 0.0, 0, -1.0), glued(three)),
        (one, met(one, 0.0, 0, -1.0)),
        (plain, start, glue),
        (boxes, met(twins, 0.0, 0, -1.0), glue),
        (boxes, met(boxes, 0.25, 0, 0.0), glue),
        (boxes, met(boxes, 0.5, 1, -1.0, 0, 1.0), glue),
        (boxes, met(boxes, 0.0, 0, -1.0, 1, -3.0), glue),
        (boxes, start),
        (boxes, start, glued(twins)),
        (boxes, start, glued(boxes, 0.0, -2.0)),
        (boxes, start, glued(boxes, 1.5, -0.5)),
        (boxes, start, glue, boxes),
    ):
        with pytest.raises(NotProvedError):
            prove(followed(), *premises)


def test_boxes_are_linked_from_end_to_beginning_without_a_turn(two):
    """s = 1 of the one is s = −1 of the next."""
    boxes = two[0]
    for at, there, turn, linked in (
        (1.0, -1.0, (0, 0), True),
        (1.0, -0.9, (0, 0), False),
        (0.9, -1.0, (0, 0), False),
        (1.0, -1.0, (1, 0), False),
        (1.0, -1.0, (0, -1), False),
    ):
        claim = GluedBoxes(LINE, whole_numbers(3), whole_numbers(4), np.array([[at, 0.0]]), np.array([[there, 0.0]]))
        fact = SimpleNamespace(claim=claim, premises=(boxes,), found={"turn": np.array([turn])})
        assert paths._links(fact, boxes) == ({(3, 4)} if linked else set())
        assert paths._links(SimpleNamespace(**(vars(fact) | {"premises": (two[1],)})), boxes) == set()


def line(pieces, offset=0.0, knots=(0.0, 1.0)):
    """Coefficients of q = t in pieces."""
    return np.array([np.ones(pieces), np.array(knots[:pieces]) + offset])


def test_paths_that_are_none(two):
    """Knots of other pieces, none, falling, or between times; times beyond, falling, or the same."""
    good = (
        (line(1), (0.0, 1.0), (0.0, 0.5, 1.0)),
        (line(2, knots=(0.0, 0.5)), (0.0, 0.5, 1.0), (0.0, 0.5, 1.0)),
        (line(2), (0.0, 1.0, 2.0), (0.0, 0.5, 1.0)),
        (line(2), (0.0, 1.0, 2.0), (0.0, 0.5, 0.75)),
        (line(1), (0.0, 1.5), (0.0, 0.5, 1.0)),
        (line(2, knots=(0.0, 0.2)), (0.0, 0.2, 1.0), (0.25, 0.5, 1.0)),
        (line(1), (0.0, 1.0), (0.125, 0.5, 0.75)),
    )
    bad = (
        (line(1), (0.0, 0.5, 1.0), (0.0, 0.5, 1.0)),
        (line(2, knots=(0.0, 0.5)), (0.0, 1.0), (0.0, 0.5, 1.0)),
        (np.zeros((0, 1)), (0.0, 1.0), (0.0, 0.5, 1.0)),
        (line(2, knots=(0.0, 0.5)), (0.0, 1.0, 0.5), (0.0, 0.25, 0.5)),
        (line(3, knots=(0.0, 0.0, 0.5)), (0.0, 0.0, 0.5, 1.0), (0.0, 0.5, 1.0)),
        (line(1), (0.0, 1.0), (0.0, 0.5, 0.5)),
        (line(1), (0.0, 1.0), (0.0, 0.5, 0.25)),
        (line(1, 0.1), (0.1, 1.0), (0.0, 0.5, 1.0)),
        (line(1, 0.1), (0.1, 1.0), (0.06, 0.1, 1.0)),
        (line(1), (0.0, 0.9), (0.0, 0.9, 1.0)),
        (line(2, knots=(0.0, 0.4)), (0.0, 0.4, 1.0), (0.0, 0.5, 1.0)),
    )
    for coefficients, knots, times in good:
        prove(followed(coefficients, knots, times), *two)
    for coefficients, knots, times in bad:
        with pytest.raises(NotProvedError):
            followed(coefficients, knots, times)._require_path()


def covered(boxes, **path):
    return followed(**path)._covered(boxes).tolist()


@pytest.mark.parametrize("less", [1e-9, -1e-9])
def test_a_tube_lies_in_its_box_with_all_that_it_strays(less):
    """Ends that differ from the line's at either side, what the path bends, and the tube's own width."""
    held = less > 0
    for middle, along, gap in ((0.5, 0.5, 0.0), (0.55, 0.45, 0.1), (0.45, 0.45, 0.1), (0.625, 0.5, 0.125)):
        box = boxes_along([[middle]], [[along]], half=0.3 + gap)
        assert covered(box, times=(0.0, 1.0), tube=(0.3 - less,)) == [held]
    bent = boxes_along([[0.5]], [[0.5]], half=0.8)
    assert covered(bent, coefficients=((1.0,), (0.0,), (0.0,)), times=(0.0, 1.0), tube=(0.3 - less,)) == [held]
    for short, reaches in ((1.0, True), (0.95, False), (0.55, False)):
        box = boxes_along([[0.5]], [[0.5]], far=short)
        assert covered(box, times=(0.0, 1.0)) == [reaches]


def test_all_coordinates_are_in_their_boxes():
    """Two, of which one is too wide, before a jump and behind it."""
    plane = straight([[1.0, 1.0]])
    jump = [[[1.0, 0.0], [1.0, 0.0]], [[0.0, 0.0], [0.5, 0.25]]]
    boxes = boxes_along([[0.25, 0.0], [0.75, 0.25]], [[0.25, 0.0], [0.25, 0.0]], equations=plane)
    path = {"coefficients": jump, "knots": (0.0, 0.5, 1.0), "equations": plane}
    for tube, held in (
        ((0.1, 0.1), [True, True]),
        ((0.51, 0.1), [False, False]),
        ((0.1, 0.24), [True, True]),
        ((0.1, 0.26), [True, False]),
    ):
        assert covered(boxes, tube=tube, **path) == held


@pytest.mark.parametrize("less", [1e-9, -1e-9])
def test_a_path_that_jumps_goes_straight_to_where_it_goes_on(less):
    """The end of the one stretch is in the other's box too, with the tube about it."""
    boxes = boxes_along([[0.25], [0.75]], [[0.25], [0.25]], half=0.3)
    for offset in (0.1, -0.1):
        path = {"coefficients": [[1.0, 1.0], [offset, 0.5]], "knots": (0.0, 0.5, 1.0)}
        assert covered(boxes, tube=(0.2 - less,), **path) == [less > 0, less > 0]
        path["coefficients"] = [[1.0 + 2.0 * offset, 1.0], [-offset, 0.5]]
        assert covered(boxes, tube=(0.2 - less,), **path) == [less > 0, True]
        boxes_far = boxes_along([[0.25 + offset], [0.75]], [[0.25], [0.25]], half=[[0.4], [0.3]])
        path["coefficients"] = [[1.0, 1.0], [offset, 0.5]]
        assert covered(boxes_far, tube=(0.2 - less,), **path) == [True, less > 0]


@pytest.mark.parametrize("jump", [0.0, 64.0])
def test_sums_are_rounded_by_less_than_8u(jump):
    """The largest tube that is let in is 1 + 8u smaller than what the box is widened to, a jump apart."""
    boxes = boxes_along([[0.25], [0.75]], [[0.25], [0.25]], half=[[1024.0 + 2.0 * jump], [1024.0]])
    row = int(jump > 0.0)  # nothing jumps to the first
    most = Fraction(float(reached(LINE.system, boxes.claim.boxes)[row, 1])) / (1 + 8 * Fraction(U)) - Fraction(jump)
    path = {"coefficients": [[1.0, 1.0], [jump, 0.5]], "knots": (0.0, 0.5, 1.0)}
    unit = Fraction(float(np.spacing(1000.0)))
    for units, held in ((-2, True), (2, False)):
        assert covered(boxes, tube=(float(most + units * unit),), **path)[row] is held


def test_distances_are_those_of_real_numbers():
    """|point − (centre + along)| to the order of u²."""
    rng = np.random.default_rng(2)
    for point, centre, along in rng.normal(size=(200, 3)) * np.array([1.0, 1.0, 1e-8]) + np.array([1.0, 1.0, 0.0]):
        found = Fraction(float(paths._between(point, centre, along)))
        stated = abs(Fraction(point) - Fraction(centre) - Fraction(along))
        assert abs(found - stated) <= Fraction(U) * stated + Fraction(10 * U**2)


def test_a_path_is_followed_to_its_end_or_is_another(two):
    """The same coefficients and knots, from the first to the last."""
    claim = followed()
    fact = prove(claim, *two)
    pieces = SimpleNamespace(c=claim.coefficients, x=claim.knots)
    assert follows(fact, pieces)
    for other in (
        SimpleNamespace(c=claim.coefficients + 1.0, x=claim.knots),
        SimpleNamespace(c=claim.coefficients, x=np.array([0.0, 1.0, 2.0])[[0, 1, 1]]),
        SimpleNamespace(c=claim.coefficients, x=np.array([0.0, 0.25, 1.0])),
    ):
        assert not follows(fact, other)
    for times in ((0.125, 0.5, 1.0), (0.0, 0.5, 0.75)):
        assert not follows(prove(followed(times=times), *two), pieces)
    for none in (two[0], claim, prove_some(two[0].claim)[0], None):
        with pytest.raises(NotProvedError):
            follows(none, pieces)
