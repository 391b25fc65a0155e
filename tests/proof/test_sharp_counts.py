"""Counting over one q and over cells: what is alone, within ranges, the same or another, at each inequality's end."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.arrays import joined, rows_of
from ccpin.proof import exhausted
from ccpin.proof import solution_counts as module
from ccpin.proof.cell_tree import WHOLE, CellRegion, HalvedTree, tree_of
from ccpin.proof.exhausted import Excluded
from ccpin.proof.facts import NotProvedError, prove
from ccpin.proof.narrowing import Candidates
from ccpin.proof.newton import Boxes
from ccpin.proof.ranges import NO_LIMIT, Ranges, Reason
from ccpin.proof.rounding import SLACK
from ccpin.proof.solution_counts import CompleteCells, CountedCells, alone_over, different, own_solutions, same, within
from ccpin.proof.solutions import SolutionsInBoxes
from tests.support.straight import at_points, boxes_about, circles, straight, whole_numbers

U, TURN = 2.0**-53, 2.0 * np.pi
LINE, CIRCLE = straight([[1.0]]), circles()


def problem_of(m, periodic=False):
    """Closures of q and m dependent coordinates, whose angles are circles or not."""
    periodic = np.array([False, *np.broadcast_to(periodic, m)])
    system = SimpleNamespace(
        dependent=np.arange(1, m + 1), independent=np.array([0]), periodic=periodic, n=1, m=m, n_free=m + 1
    )
    return SimpleNamespace(system=system)


def boxes_at(y, modes, radius, slope=0.0):
    """Boxes about (0, y), y of shape (K, m)."""
    y = np.atleast_2d(y)
    count, m = y.shape
    modes = np.broadcast_to(np.array(modes, dtype=float), (count, m, m))
    directions = np.concatenate([np.ones((count, 1, 1)), np.full((count, m, 1), slope)], axis=1)
    one = np.ones((count, m))
    return Boxes(
        np.column_stack([np.zeros(count), y]), np.zeros((count, 1)), directions, modes, modes, radius * one, one,
        one[:, 0],
    )  # fmt: skip


def candidates_at(y, half):
    y, half = np.atleast_2d(y), np.atleast_2d(half)
    zero = np.zeros(len(y))
    return Candidates(
        zero.astype(int), np.column_stack([zero, y]), np.column_stack([zero, half]), np.zeros((len(y), y.shape[1], 1))
    )


def ranges_of(lower, upper, reason=Reason.LIMIT):
    """One range."""
    limits = np.array([[-NO_LIMIT, NO_LIMIT]]) if reason == Reason.TURN else np.array([[lower, upper]])
    return Ranges(np.array([lower]), np.array([upper]), np.full((1, 2), reason, dtype=np.int8), limits)


AROUND = ranges_of(-np.pi, np.pi, Reason.TURN)


# Within the ranges


@pytest.mark.parametrize(
    ("y", "inside", "beyond"),
    [
        ((-2.25, 0), True, False), ((-2.26, 0), False, False), ((-3.75, 0), False, False), ((-3.76, 0), False, True),
        ((4.25, 0), True, False), ((4.26, 0), False, False), ((5.75, 0), False, False), ((5.76, 0), False, True),
        ((0, 9.25), True, False), ((0, 9.26), False, False), ((0, 10.76), False, True), ((0, -9.26), False, False),
    ],
)  # fmt: skip
def test_within_the_ranges(y, inside, beyond):
    """By the box's own spread |V|R = 0.5 and the range's edge 0.25; of a full turn nothing is asked."""
    ranges = SimpleNamespace(
        turning=np.array([True, False, False]), lower=np.array([0, -3.0, -10.0]), upper=np.array([0, 5.0, 10.0]),
        edge=np.array([0, 0.25, 0.25]),
    )  # fmt: skip
    boxes = boxes_at((7.0, *y), [[1, 0, 0], [0, 1, -1], [0, -2, 0]], 0.25)
    found = within(problem_of(3), ranges, boxes)
    assert [bool(mask[0]) for mask in found] == [inside, beyond]


# The same, or another


def test_the_same_where_one_lies_alone_in_the_other(monkeypatch):
    """What is asked: all that one box may carry, turned to the other, within its tube; 4u (2 + |y| + |y′|) more."""
    asked = []
    monkeypatch.setattr(module, "alone_in", lambda problem, boxes, held: asked.append((boxes, held)) or [answer])
    problem = problem_of(2, (True, False))
    one = boxes_at((0.5 + TURN, 1.0), [[1, -2], [0, 1]], 0.25, 3.0)
    other = boxes_at((0.5 + 5e-7, 3.0), np.eye(2), 1.0)
    for answer in (True, False):
        assert same(problem, one, other) is answer
    boxes, held = asked[0]
    assert boxes is other
    np.testing.assert_allclose(held.centre, [[0.0, 0.5, 1.0]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(held.half, [[0.0, 0.75, 0.25]], rtol=0, atol=1e-13)
    more = (held.half - [[0.0, 0.75, 0.25]])[0, 1:] / (4 * U)
    np.testing.assert_allclose(more, [3.0 + TURN, 6.0], rtol=0, atol=0.26)
    np.testing.assert_array_equal(held.slopes, np.full((1, 2, 1), 3.0))


def test_what_is_the_same_is_held_however_far_it_is_turned(monkeypatch):
    """The ball about the turned box holds the configuration itself, to roundings of 2π and of large numbers."""
    asked = []
    monkeypatch.setattr(module, "alone_in", lambda problem, boxes, held: asked.append(held) or [True])
    for turns in (1, 1000, 10**6, -(10**9)):
        for y in (-2.0, 0.1, 2.0):
            same(problem_of(1, True), boxes_at((y + TURN * turns,), np.eye(1), 0.0), boxes_at((0.5,), np.eye(1), 0.0))
            pi = Fraction(31415926535897932384626433832795028841971693993751, 10**49)
            true = Fraction(y + TURN * turns) - 2 * pi * turns
            held = asked.pop()
            assert abs(true - Fraction(held.centre[0, 1])) <= Fraction(held.half[0, 1]) + Fraction(1e-13)


@pytest.mark.parametrize("k", [0, 1])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("radii", [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.25, 0.75)])
def test_different_beyond_both_spreads(k, side, radii):
    """From the sum of what both may be off by, 1e-13 and the slack, turns not counted, in one coordinate."""
    problem = problem_of(2, (True, False))
    most = 2.0 * sum(radii) * SLACK + 1e-13
    for share, differ in ((1.0 - 1e-3, False), (1.0 + 1e-3, True)):
        y = np.array([0.25, -0.5]) if sum(radii) else np.zeros(2)
        moved = y.copy()
        moved[k] += side * most * share
        moved[0] += TURN if sum(radii) else 0.0
        one, other = boxes_at(moved, [[2, 0], [0, -2]], radii[0]), boxes_at(y, [[2, 0], [0, 2]], radii[1])
        assert different(problem, one, other) is differ


# Candidates that hold no other


def test_a_candidate_is_known_where_one_is_alone_in_it(monkeypatch):
    """In one box or another, of those that are near."""
    waiting, boxes = (
        candidates_at([[0.0], [1.0], [2.0]], [[0.5], [0.5], [0.5]]),
        boxes_at([[0.0], [1.0], [0.5]], [[1.0]], 0.1),
    )
    alone = {(0.0, 0.0), (1.0, 1.0), (2.0, 1.0)}  # of candidates and boxes

    def alone_in(problem, boxes, held):
        return np.array([pair in alone for pair in zip(held.centre[:, 1], boxes.centre[:, 1], strict=True)], dtype=bool)

    monkeypatch.setattr(module, "alone_in", alone_in)
    assert alone_over(problem_of(1), waiting, boxes).tolist() == [True, True, False]
    assert alone_over(problem_of(1), waiting, boxes.take(np.array([0]))).tolist() == [True, False, False]
    assert alone_over(problem_of(1), waiting, boxes.take(np.array([], dtype=int))).tolist() == [False] * 3


def points(q, *y, radius=0.1):
    """Boxes over q = h about solutions of sin(q + y) = 0."""
    found = [boxes_about([[q, y]], 0.0, [[-1.0]], radius, np.sign(np.cos(q + y))) for y in y]
    return joined(found) if found else rows_of(boxes_about([[q, 0.0]], 0.0, [[-1.0]], radius), slice(0))


def test_candidates_a_turn_away_or_wider_than_both_are_not_known():
    """About y = −q the other of sin(q + y) = 0 is π away; where cos > 0 no other can be."""
    boxes = points(0.25, -0.25)
    waiting = candidates_at([[-0.25], [-0.25], [-0.25], [-0.25 + TURN], [0.5]], [[0.5], [1.5], [3.2], [0.5], [0.75]])
    waiting.centre[:, 0] = 0.25
    assert alone_over(CIRCLE.problem, waiting, boxes).tolist() == [True, True, False, False, True]
    other = points(0.25, -0.25 + TURN)
    assert alone_over(CIRCLE.problem, waiting, other).tolist() == [False, False, False, True, False]


# All over one q


def owned(*y, ranges=AROUND, q=0.25):
    return own_solutions(CIRCLE.problem, ranges, np.array([q]), points(q, *y)).tolist()


def test_all_over_a_q_each_once():
    """sin(q + y) = 0 has two."""
    one, other = -0.25, np.pi - 0.25
    assert owned(one, other) == [True, True]
    assert owned(other, one) == [True, True]
    assert owned(one, one, other) == [True, False, True]
    assert owned(one, other, one, one, other) == [True, True, False, False, False]
    assert owned(one + TURN, one, other, one - 3 * TURN) == [True, False, True, False]
    for some in ((), (one,), (other,), (one, one + TURN), (one + TURN, other)):
        with pytest.raises(NotProvedError, match="not known"):
            owned(*some)


def test_one_at_the_end_of_a_turn_is_counted_once():
    """y = ±π − q is at both ends of the range; both are to be told."""
    one, other = 0.0, np.pi
    assert owned(one, other, -other, q=0.0) == [True, True, False]
    with pytest.raises(NotProvedError, match="not known"):
        owned(one, other, q=0.0)


def lone(y, ranges, radius=1e-3):
    """The same of y = q."""
    boxes = boxes_about([[y, y]], 0.0, [[1.0]], radius)
    return own_solutions(LINE.problem, ranges, np.array([y]), boxes).tolist()


def test_one_within_the_ranges_or_beyond_them():
    """One that may be at an end is neither."""
    assert lone(0.25, ranges_of(-1.0, 1.0)) == [True]
    assert lone(0.25, ranges_of(0.5, 1.0)) == [False]
    assert lone(0.25, ranges_of(-1.0, 0.125)) == [False]
    for low, high in ((0.25 - 5e-4, 1.0), (-1.0, 0.25 + 5e-4), (0.25 + 5e-4, 1.0), (0.25, 0.25)):
        with pytest.raises(NotProvedError, match="end of a range"):
            lone(0.25, ranges_of(low, high))
    none = rows_of(boxes_about([[0.0, 0.0]], 0.0, [[1.0]], 0.1), slice(0))
    assert own_solutions(LINE.problem, ranges_of(0.5, 1.0), np.zeros(1), none).tolist() == []
    with pytest.raises(NotProvedError, match="not known"):
        own_solutions(LINE.problem, ranges_of(-0.5, 1.0), np.zeros(1), none)


@pytest.mark.parametrize(("alike", "kept"), [
    ([(0, 1)], [True, False, True]), ([(1, 0)], [True, False, True]), ([(2, 0)], [True, True, False]),
    ([(0, 1), (1, 2), (0, 2)], [True, False, False]), ([], [True, True, True]),
])  # fmt: skip
def test_those_that_may_be_the_same_are_to_be(monkeypatch, alike, kept):
    """Either in the other; of three all pairs."""
    told = {tuple(sorted(pair)) for pair in alike}
    number = lambda boxes: int(boxes.centre[0, 1])  # noqa: E731
    monkeypatch.setattr(module, "narrowed_both", lambda problem, ranges, waiting: rows_of(waiting, slice(0)))
    monkeypatch.setattr(module, "different", lambda problem, a, b: (number(a), number(b)) not in told)
    monkeypatch.setattr(module, "same", lambda problem, a, b: (number(a), number(b)) in alike)
    boxes = boxes_about([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 9.0]], 0.0, [[1.0]], 0.1)
    ranges = ranges_of(-5.0, 5.0)
    assert own_solutions(LINE.problem, ranges, np.zeros(1), boxes).tolist() == [*kept, False]
    if alike:
        monkeypatch.setattr(module, "same", lambda problem, a, b: (number(a), number(b)) in alike[1:])
        with pytest.raises(NotProvedError, match="may be the same"):
            own_solutions(LINE.problem, ranges, np.zeros(1), boxes)


def test_candidates_over_a_q_are_halved_while_that_is_due(monkeypatch):
    """One, two, four: seven are fewer than eight; where one that is left is not to be halved, nothing is known."""
    monkeypatch.setattr(module, "narrowed_both", lambda problem, ranges, waiting: waiting)
    monkeypatch.setattr(module, "alone_over", lambda problem, waiting, boxes: waiting.half[:, 1] < 0.2)
    monkeypatch.setattr(module, "to_halve", lambda problem, waiting: (np.ones(len(waiting.cell), int), due(waiting)))
    none = rows_of(boxes_about([[0.0, 0.0]], 0.0, [[1.0]], 0.1), slice(0))
    for most, last, proved in ((8, -9.0, True), (7, -9.0, False), (8, 0.7, False), (8, 0.82, True)):
        monkeypatch.setattr(module, "_MOST", most)
        due = lambda waiting, last=last: ~((waiting.half[:, 1] < 0.3) & (np.abs(waiting.centre[:, 1] - last) < 0.06))  # noqa: E731
        if proved:
            assert own_solutions(LINE.problem, ranges_of(-1.0, 1.0), np.zeros(1), none).tolist() == []
        else:
            with pytest.raises(NotProvedError, match="not known"):
                own_solutions(LINE.problem, ranges_of(-1.0, 1.0), np.zeros(1), none)


# Counted cells


EIGHTHS = {"cut": (0,) * 9, "child": (1, 3, 5, -1, 7, -1, -1, -1, -1)}  # of [0, 1]: ¼, ⅛, ⅛, ¼, ¼ are 3, 7, 8, 5, 6


@pytest.fixture(autouse=True)
def _wide_cells(monkeypatch):
    """Cells here are few and wide, so that they are to be halved more often before they are given up."""
    monkeypatch.setattr(exhausted, "_DEEPER", 4)


def excluded(equations=CIRCLE, lower=(0.0,), upper=(1.0,), cut=(0, 0, 0), child=(1, -1, -1), kept=(), **others):
    """The fact: by default about the halves of [0, 1], over none of which sin(q + y) = 0 is singular."""
    n, m = equations.system.n, equations.system.m
    given = {
        "wrapped": np.zeros(n, dtype=bool),
        "limits": np.tile([-NO_LIMIT, NO_LIMIT], (m, 1)),
        "middle": np.zeros(m),
        "singular": np.ones(1, dtype=bool),
        "kept": np.isin(np.arange(len(child)), kept),
    }
    cut, child = whole_numbers(*cut), whole_numbers(*child)
    return prove(Excluded(equations, np.array(lower), np.array(upper), cut=cut, child=child, **(given | others)))


def both(q):
    """Boxes about the two configurations over q = h."""
    return points(q, -q, np.pi - q)


def solved(boxes, equations=CIRCLE):
    return prove(SolutionsInBoxes(equations, *boxes))


def counted(cell, q, point, equations=CIRCLE):
    return CountedCells(
        equations, whole_numbers(*cell), np.array(q, dtype=float).reshape(-1, equations.system.n), whole_numbers(*point)
    )


def test_all_cells_of_a_part_have_as_many_as_one_q_of_it():
    """Two; parts that were not counted, or with something missing, have no number, whatever the others have."""
    fact = prove(counted((1,), (0.25,), (0, 0)), excluded(), solved(both(0.25)))
    assert (fact.found["count"].tolist(), fact.found["own"].tolist()) == ([-1, 2, 2], [True, True])
    apart = excluded(**EIGHTHS, kept=(8,))
    twice = joined([both(0.125), both(0.875), points(0.125, -0.125)])
    fact = prove(counted((3, 6), (0.125, 0.875), (0, 0, 1, 1, 0)), apart, solved(twice))
    assert fact.found["count"].tolist() == [-1, -1, -1, 2, -1, 2, 2, 2, -1]
    assert fact.found["own"].tolist() == [True] * 4 + [False]
    for rows, count, own in (
        ((0, 1, 2), [2, -1], [True, True, False]),
        ((0, 2, 3), [-1, 2], [False, True, True]),
        ((), [-1, -1], []),
    ):
        some, point = twice.take(np.array(rows, dtype=int)), np.array([0, 0, 1, 1])[list(rows)]
        fact = prove(counted((3, 6), (0.125, 0.875), point), apart, solved(some))
        assert fact.found["count"][[3, 7, 6, 5]].tolist() == np.repeat(count, 2).tolist()
        assert fact.found["own"].tolist() == own
    only = prove(counted((6,), (0.875,), (0, 0)), apart, solved(both(0.875)))
    assert only.found["count"].tolist() == [-1, -1, -1, -1, -1, 2, 2, -1, -1]
    root = prove(counted((0,), (0.5,), (0, 0)), excluded(cut=(0,), child=(-1,)), solved(both(0.5)))
    assert root.found["count"].tolist() == [2]


def test_where_nothing_is_none_is_counted():
    """y = q ≤ 0.3: beyond there is none, and none is a number too."""
    limits = np.array([[-5.0, 0.3]])
    none = solved(rows_of(boxes_about([[0.0, 0.0]], 0.0, [[1.0]], 0.1), slice(0)), LINE)
    fact = prove(counted((2,), (0.75,), (), LINE), excluded(LINE, limits=limits), none)
    assert fact.found["count"].tolist() == [-1, -1, 0]
    beyond = solved(boxes_about([[0.75, 0.75]], 0.0, [[1.0]], 0.1), LINE)
    fact = prove(counted((2,), (0.75,), (0,), LINE), excluded(LINE, limits=limits), beyond)
    assert (fact.found["count"].tolist(), fact.found["own"].tolist()) == ([-1, -1, 0], [False])


@pytest.mark.parametrize("side", [-1, 1])
def test_a_q_is_in_the_middle_half_of_its_cell(side):
    """¼ of its width from the middle is, a bit more is not."""
    fact, at = excluded(), 0.25 + side * 0.125
    for q, held in ((at, True), (at + side * 2.0**-54, False), (0.25 + side * 0.3, False)):
        if held:
            prove(counted((1,), (q,), (0, 0)), fact, solved(both(q)))
        else:
            with pytest.raises(NotProvedError, match="not in its cell"):
                prove(counted((1,), (q,), (0, 0)), fact, solved(both(q)))


def test_cells_and_points_are_real_numbers():
    """A cell that is narrower than doubles are apart there holds those q alone that it does hold."""
    rng = np.random.default_rng(2)
    lower, upper = np.array([1e9 - 0.4, -3.0]), np.array([1e9 + 1.0, 5.0])
    region = CellRegion(lower, upper, np.zeros(2, dtype=bool))
    some = SimpleNamespace(region=region, lower=lower, upper=upper)
    for level in (20, 22, 23, 24, 25):
        size = WHOLE >> level
        corners = size * rng.integers(0, 1 << level, (40, 2))
        tree = HalvedTree(corners, np.full((40, 2), size), np.ones(40, dtype=bool))
        q = region.position(corners + 0.5 * size)[0]
        q += rng.integers(-2, 3, q.shape) * np.array([np.spacing(1e9), 0.2 * 8.0 / (1 << level)])
        found = module.well_inside(some, tree, np.arange(40), q)
        for k in range(40):
            inside = True
            for j in range(2):
                width = (Fraction(upper[j]) - Fraction(lower[j])) / (1 << level)
                middle = Fraction(lower[j]) + width * (Fraction(int(corners[k, j]), size) + Fraction(1, 2))
                inside &= abs(Fraction(q[k, j]) - middle) <= width / 4
            assert found[k] == inside


def test_boxes_are_over_their_q_and_nothing_else():
    """Not a bit beside it, nor over some of q about it, nor are they points without parameters."""
    fact, claim = excluded(), counted((1,), (0.25,), (0, 0))
    for boxes in (
        both(np.nextafter(0.25, 1.0)), both(0.25)._replace(half=np.full((2, 1), 1e-300)),
        both(0.25)._replace(half=np.array([[0.0], [1e-3]])), at_points(both(0.25)),
    ):  # fmt: skip
        with pytest.raises(NotProvedError, match="not over its q"):
            prove(claim, fact, solved(boxes))
    other = joined([both(0.25), both(0.875)])
    prove(counted((1,), (0.25,), (0, 0)), fact, solved(other.take(np.arange(2))))
    for point in ((0,), (0, 0, 0), (0, 1), (2, 2), (1, 1)):
        with pytest.raises(NotProvedError, match="over no q"):
            prove(counted((1,), (0.25,), point), fact, solved(both(0.25)))
    with pytest.raises(NotProvedError, match="not over its q"):
        prove(
            counted((3, 6), (0.125, 0.875), (0, 1, 1, 1)),
            excluded(**EIGHTHS, kept=(8,)),
            solved(joined([both(0.125), both(0.875)])),
        )


def test_cells_are_of_parts_that_are_excluded_each_counted_once():
    apart, found = excluded(**EIGHTHS, kept=(8,)), solved(both(0.125))
    for cells in ((3, 7), (3, 3), (8,), (3, 8), (1,), (9,), (12,), (0,)):
        q = np.array([{3: 0.125, 7: 0.3125, 8: 0.4375, 1: 0.25, 0: 0.5}.get(cell, 0.125) for cell in cells])
        boxes = joined([both(x) for x in q])
        with pytest.raises(NotProvedError):
            prove(counted(cells, q, np.repeat(np.arange(len(q)), 2)), apart, solved(boxes))
    prove(counted((3,), (0.125,), (0, 0)), apart, found)


def test_premises_are_what_excludes_singular_ones_and_boxes():
    claim, fact, boxes = counted((1,), (0.25,), (0, 0)), excluded(), solved(both(0.25))
    nothing = excluded(singular=np.zeros(1, dtype=bool))
    other = excluded(circles(planar=True))
    assert prove(claim, other, boxes).found["count"].tolist() == [-1, 2, 2]
    two = excluded(circles(2), (0.0, 0.0), (1.0, 1.0))
    for premises in (
        (),
        (fact,),
        (boxes,),
        (boxes, fact),
        (fact, fact),
        (nothing, boxes),
        (two, boxes),
        (fact, boxes, fact),
    ):
        with pytest.raises(NotProvedError):
            prove(claim, *premises)
    for change in (
        {"q": np.array([[np.nan]])},
        {"q": np.zeros((2, 1))},
        {"cell": whole_numbers(-1)},
        {"point": np.zeros(2)},
    ):
        with pytest.raises(NotProvedError):
            prove(replace(claim, **change), fact, boxes)


# Parts


def parts(wrapped, gap=0.0, kept=(), lower=-np.pi):
    """How cells of four quarters of a turn hang together; told by the first cell of each part."""
    upper = lower + TURN + gap
    some = SimpleNamespace(
        lower=np.array([lower]), upper=np.array([upper]), wrapped=np.array([wrapped]),
        cut=np.zeros(7, dtype=int), child=whole_numbers(1, 3, 5, -1, -1, -1, -1),
    )  # fmt: skip
    ours = np.isin(np.arange(7), np.setdiff1d([3, 4, 5, 6], kept))
    found = module._parts(tree_of(some.cut, some.child, 1), some, ours)
    return [-1 if k < 0 else int(np.flatnonzero(found == k)[0]) for k in found[3:]]


def test_parts_hang_together_by_faces_and_over_seams():
    """Where the two ends of a turn are no more apart than what is excluded beyond them."""
    assert parts(False) == [3, 3, 3, 3]
    assert parts(False, kept=(4,)) == [3, -1, 5, 5]
    assert parts(False, kept=(4, 6)) == [3, -1, 5, -1]
    assert parts(True, kept=(4,)) == [3, -1, 3, 3]
    assert parts(True, kept=(4, 6)) == [3, -1, 5, -1]
    assert parts(True, kept=(3,)) == [-1, 4, 4, 4]
    for gap, joins in ((0.9e-12, True), (-0.9e-12, True), (1.1e-12, False), (-1.1e-12, False)):
        assert parts(True, gap, kept=(4,)) == [3, -1, *(2 * [3 if joins else 5])]


def test_cells_that_touch_at_a_corner_do_not_hang_together():
    """Two quarters of a square, both beside the two that are kept."""
    some = SimpleNamespace(lower=np.zeros(2), upper=np.ones(2), wrapped=np.zeros(2, dtype=bool))
    some.cut, some.child = whole_numbers(0, 1, 1, 0, 0, 0, 0), whole_numbers(1, 3, 5, -1, -1, -1, -1)
    for ours in ((3, 6), (4, 5)):
        found = module._parts(tree_of(some.cut, some.child, 2), some, np.isin(np.arange(7), ours))
        assert (found >= 0).sum() == len(set(found[list(ours)])) == 2


def test_a_turn_far_away_is_counted_in_parts():
    """There its two ends may be too far apart, where roundings of a full turn are allowed."""
    for lower, whole in ((-3.0, True), (2e4, False)):
        upper = lower + TURN
        if not whole:
            upper = np.nextafter(np.nextafter(upper, 0.0), 0.0)
        turn = excluded(
            lower=(lower,), upper=(upper,), wrapped=np.ones(1, dtype=bool), cut=(0,) * 7,
            child=(1, 3, 5, -1, -1, -1, -1), kept=(4,),
        )  # fmt: skip
        q = lower + TURN / 8
        found = prove(counted((3,), (q,), (0, 0)), turn, solved(points(q, *turned(q))))
        assert found.found["count"].tolist() == [-1, -1, -1, 2, -1, *(2 * [2 if whole else -1])]


def turned(q):
    """The two y over a q about [−π, π]."""
    one = float(np.angle(np.exp(-1j * q)))
    return one, one - np.copysign(np.pi, one)


# All of them in boxes


def over_halves(*cells, half=0.25, off=0.0, radius=0.1):
    """The fact about boxes over the halves 1 and 2 of [0, 1], of both configurations each, and over which they lie."""
    q = [(cell - 0.5) * 0.5 + off for cell in cells for _ in range(2)]
    boxes = joined(
        boxes_about([[at, y - at]], half, [[-1.0]], radius, np.cos(y))
        for at, y in zip(q, (0.0, np.pi) * len(cells), strict=True)
    )
    return solved(boxes), np.repeat(cells, 2)


def complete(cell, box=None, cut=(0, 0, 0), child=(1, -1, -1), equations=CIRCLE):
    box = range(len(cell)) if box is None else box
    return CompleteCells(
        equations, cut=whole_numbers(*cut), child=whole_numbers(*child), cell=whole_numbers(*cell),
        box=whole_numbers(*box),
    )  # fmt: skip


@pytest.fixture(scope="module")
def two():
    """That there are two over both halves."""
    return prove(counted((1,), (0.25,), (0, 0)), excluded(), solved(both(0.25)))


def found_of(claim, *premises):
    fact = prove(claim, *premises)
    return fact.found["complete"].tolist(), fact.found["count"].tolist()


def test_as_many_boxes_as_configurations_are_all(two):
    boxes, cells = over_halves(1, 2)
    assert found_of(complete(cells), two, boxes) == ([False, True, True], [-1, 2, 2])
    assert found_of(complete(cells[::-1], (3, 2, 1, 0)), two, boxes) == ([False, True, True], [-1, 2, 2])
    for cell, box, held in (
        ((1, 1, 2), (0, 1, 2), [True, False]), ((2, 2), (2, 3), [False, True]), ((), (), [False, False]),
        ((1, 1, 1, 2, 2), (0, 1, 1, 2, 3), [False, True]), ((1, 1, 2, 2), (0, 0, 3, 3), [False, False]),
        ((1, 1, 1, 2, 2), (0, 1, 2, 2, 3), [False, True]), ((1, 1, 2, 2), (0, 1, 3, 1), [True, False]),
    ):  # fmt: skip
        assert found_of(complete(cell, box), two, boxes)[0] == [False, *held]


def test_boxes_hold_all_of_their_cells(two):
    """And are about their middles, all of a cell about the same."""
    for half, off, held in (
        (0.25, 0.0, True),
        (0.24, 0.0, False),
        (0.3, 0.05, True),
        (0.3, 0.06, False),
        (0.4, 0.13, False),
    ):
        boxes, cells = over_halves(1, half=half, off=off, radius=0.3)
        assert found_of(complete(cells), two, boxes)[0] == [False, held, False]
    wide, cells = over_halves(1, half=0.3, radius=0.3)
    aside = over_halves(1, half=0.3, off=0.01, radius=0.3)[0]
    assert found_of(complete(cells, (2, 3)), two, wide, aside)[0] == [False, True, False]
    assert found_of(complete(cells, (0, 3)), two, wide, aside)[0] == [False, False, False]


def test_boxes_a_turn_away_are_those_of_no_cell_here(two):
    """In q; in y they are as good as any."""
    boxes, _ = over_halves(1, 1)
    whole = boxes.claim.boxes
    for k, held in ((0, False), (1, True)):
        moved = whole.centre + TURN * np.eye(2)[k]
        fact = solved(whole._replace(centre=np.where(np.arange(4)[:, None] >= 2, moved, whole.centre)))
        assert found_of(complete((1, 1), (0, 3)), two, fact)[0] == [False, held, False]
        assert found_of(complete((1, 1), (0, 2)), two, fact)[0] == [False, False, False]


def test_none_is_complete_without_boxes():
    """Over its cells, and over halves of them."""
    limits = np.array([[-5.0, 0.3]])
    none = solved(rows_of(boxes_about([[0.0, 0.0]], 0.0, [[1.0]], 0.1), slice(0)), LINE)
    zero = prove(counted((2,), (0.75,), (), LINE), excluded(LINE, limits=limits), none)
    assert found_of(complete((), equations=LINE), zero, none) == ([False, False, True], [-1, -1, 0])
    box = solved(boxes_about([[0.75, 0.75]], 0.25, [[1.0]], 0.1), LINE)
    assert found_of(complete((2,), equations=LINE), zero, box)[0] == [False] * 3
    finer = complete((), (), (0,) * 5, (1, -1, 3, -1, -1), LINE)
    assert found_of(finer, zero, none) == ([False, False, True, True, True], [-1, -1, 0, 0, 0])


@pytest.mark.parametrize(("coarse", "finer"), [
    ((1, -1, -1), (1, 3, 5, -1, -1, 7, -1, -1, -1)),
    ((7, -1, -1, -1, -1, -1, -1, -1, -1), (7, -1, -1, -1, -1, -1, -1, 3, 5)),
    ((7, -1, -1, -1, -1, -1, -1, -1, -1), (7, 3, -1, -1, -1, -1, -1, 1, 5)),
    ((7, -1, -1, -1, -1, 1, -1, -1, -1), (7, 3, -1, -1, -1, 1, -1, 5, -1)),
    ((1, -1, -1, -1, -1), (1, -1, -1, 1, -1)),
    ((1, -1, -1), (1, 3, -1, -1, 5, -1, 7, -1, -1)),
])  # fmt: skip
def test_leaves_halved_further_have_the_count_of_their_leaf(coarse, finer):
    """Whatever their numbers are, those of cells that nobody reached before with them."""
    cut, kept = (0,) * len(coarse), (coarse[0] + 1,)
    part = prove(counted((coarse[0],), (0.25,), (0, 0)), excluded(cut=cut, child=coarse, kept=kept), solved(both(0.25)))
    none = solved(rows_of(boxes_about([[0.0, 0.0]], 0.25, [[-1.0]], 0.1), slice(0)))
    count = prove(complete((), (), (0,) * len(finer), finer), part, none).found["count"]
    below = {coarse[0]}
    while more := {finer[cell] + side for cell in below if finer[cell] >= 0 for side in (0, 1)} - below:
        below |= more
    assert set(np.flatnonzero(count == 2)) == below
    assert set(np.flatnonzero(count == -1)) == set(range(len(finer))) - below


def test_trees_are_those_that_were_counted(two):
    boxes, _ = over_halves(1, 2)
    for cut, child in (
        ((0,), (-1,)), ((0, 0), (-1, -1)), ((0,) * 4, (2, -1, -1, -1)), ((0,) * 5, (3, -1, -1, -1, -1)),
        ((0,) * 3, (-1, -1, -1)), ((0,) * 5, (1, 1, -1, -1, -1)), ((0,) * 3, (1, 1, -1)),
    ):  # fmt: skip
        with pytest.raises(NotProvedError):
            prove(complete((), (), cut, child), two, boxes)
    spare = excluded(cut=(0,) * 5, child=(1, -1, -1, -1, -1))
    spare = prove(counted((1,), (0.25,), (0, 0)), spare, solved(both(0.25)))
    with pytest.raises(NotProvedError, match="another tree"):
        prove(complete(()), spare, boxes)
    plane = circles(2)
    tree = {"cut": (1, 0, 0), "child": (1, -1, -1)}
    known = excluded(plane, (0.0, 0.0), (1.0, 1.0), **tree)
    two_boxes = joined(boxes_about([[0.5, 0.25, y - 0.75]], 0.0, [[-1.0, -1.0]], 0.1, np.cos(y)) for y in (0.0, np.pi))
    fact = prove(counted((1,), ((0.5, 0.25),), (0, 0), plane), known, solved(two_boxes, plane))
    assert fact.found["count"].tolist() == [-1, 2, 2]
    none = solved(two_boxes.take(np.array([], dtype=int)), plane)
    assert prove(complete((), (), **tree, equations=plane), fact, none).found["count"].tolist() == [-1, 2, 2]
    with pytest.raises(NotProvedError, match="another tree"):
        prove(complete((), (), (0, 0, 0), (1, -1, -1), plane), fact, none)
    prove(complete((), (), (1, 0, 1), (1, -1, -1), plane), fact, none)


def test_boxes_lie_over_leaves_that_there_are(two):
    boxes, _ = over_halves(1, 2)
    for cell, box in (((3,), (0,)), ((5,), (0,)), ((1,), (4,)), ((1,), (7,)), ((0,), (0,)), ((1, 0), (0, 1))):
        with pytest.raises(NotProvedError):
            prove(complete(cell, box), two, boxes)
    spare = complete((1,), (0,), (0,) * 5, (1, -1, -1, -1, 0))
    prove(spare, two, boxes)
    for cell in (3, 4):
        with pytest.raises(NotProvedError, match="over no leaf"):
            prove(replace(spare, cell=whole_numbers(cell)), two, boxes)
    for change in ({"box": whole_numbers(0, 1)}, {"cell": whole_numbers(-1)}, {"cell": np.ones(1)}):
        with pytest.raises(NotProvedError):
            prove(replace(spare, **change), two, boxes)
    for premises in ((), (two,), (boxes,), (boxes, two), (two, boxes, two), (two.premises[0], boxes)):
        with pytest.raises(NotProvedError):
            prove(spare, *premises)


@pytest.mark.parametrize("k", [0, 1])
@pytest.mark.parametrize(("turning", "places"), [
    (False, {(-1.5, 0.25): True, (-1.75, 0.25): True, (-1.8, 0.25): False, (3.25, 0.25): True, (3.3, 0.25): False,
             (0.0, np.inf): False, (0.0, 2.0): True, (-2.1, 0.0): False}),
    (True, {(-9.0, 0.25): True, (9.0, 0.25): True, (0.0, np.inf): False}),
])  # fmt: skip
def test_boxes_keep_the_limits_over_their_middles(monkeypatch, turning, places, k):
    """−2.5 + ½ ≤ y − e and y + e ≤ 4 − ½, where the end of [−2.5, 4] is ½ wide; of full turns nothing is asked."""
    equations = straight([[1.0], [1.0]])
    given = [Reason.TURN, Reason.LIMIT] if turning else [Reason.LIMIT, Reason.LIMIT]
    given = given if k == 0 else given[::-1]
    reasons = np.repeat(given, 2).reshape(2, 2)
    told = SimpleNamespace(
        lower=np.full(2, -2.5), upper=np.full(2, 4.0), edge=np.full(2, 0.5), turning=reasons[:, 0] == Reason.TURN
    )
    one = boxes_about([[0.5, 0.5, 0.5]], 0.0, [[1.0], [1.0]], 0.1)
    known = excluded(equations, cut=(0,), child=(-1,))
    part = prove(counted((0,), (0.5,), (0,), equations), known, solved(one, equations))
    boxes = solved(one._replace(half=np.full((1, 1), 0.5)), equations)
    monkeypatch.setattr(Excluded, "ranges", lambda self: told)
    for (y, error), held in places.items():
        at, off = np.zeros((1, 2)), np.zeros((1, 2))
        at[0, k], off[0, k] = y, error
        monkeypatch.setattr(module, "at_centres", lambda *_, at=at, off=off: (at, off))
        assert found_of(complete((0,), (0,), (0,), (-1,), equations), part, boxes) == ([held], [1])
    at, off = np.array([[0.0, 0.0], [0.25, 0.25]]), np.zeros((2, 2))
    at[1, k] = np.nan if turning else 9.0  # one more than there are, which is none
    monkeypatch.setattr(module, "at_centres", lambda *_: (at, off))
    assert found_of(complete((0, 0), (0, 0), (0,), (-1,), equations), part, boxes) == ([False], [1])


@pytest.mark.parametrize("turn", [0.0, TURN, -TURN])
@pytest.mark.parametrize("errors", [(0.0, 0.0), (0.5, 0.25), (0.0, 0.5), (0.5, 0.0)])
def test_boxes_differ_beyond_what_both_may_be_off_by(turn, errors):
    """By e + e′ and 1e-13, in one coordinate, turns not counted; over the same q."""
    claim = complete((5, 2, 5, 7), (0, 1, 2, 3))
    for share, differ in ((0.9, False), (1.1, True)):
        for side in (-1.0, 1.0):
            moved = sum(errors) * SLACK + 1e-13 * share
            y = np.array([[0.0], [0.0], [turn + side * moved], [0.0]])
            error = np.array([[errors[0]], [0.0], [errors[1]], [0.0]])
            assert claim._alike(np.zeros((4, 1)), y, error).tolist() == ([] if differ else [5])


def test_all_pairs_over_a_cell_are_told_apart():
    """One coordinate is enough; other middles, or an error that is none, tell nothing."""
    equations = straight([[1.0, 0.0], [0.0, 1.0]])
    claim = complete((3, 1, 3, 3, 1), (0, 1, 2, 3, 4), equations=equations)
    y = np.array([[0.0, 0.0], [5.0, 5.0], [0.0, 1.0], [0.0, 2.0], [6.0, 5.0]])
    q, none = np.zeros((5, 2)), np.zeros((5, 2))
    assert claim._alike(q, y, none).tolist() == []
    for first, second, cell in ((0, 2, 3), (2, 3, 3), (0, 3, 3), (1, 4, 1)):
        same_there = y.copy()
        same_there[second] = y[first]
        assert set(claim._alike(q, same_there, none)) == {cell}
        far = y.copy()
        far[second] = y[first] + [0.25, -0.25]
        error = none.copy()
        error[first] = 0.2
        assert set(claim._alike(q, far, error)) == set()
        error[second] = 0.1
        assert set(claim._alike(q, far, error)) == {cell}
        for other in (np.inf, np.nan):
            error = none.copy()
            error[second] = other
            assert cell in claim._alike(q, y, error)
        aside = q.copy()
        aside[second, 1] = 1e-300
        assert cell in claim._alike(aside, y, none)
    assert claim._alike(q, y + TURN * np.arange(5.0)[:, None], none).tolist() == []
