"""Covers of regions at equality: cells that just fill their boxes, full turns, faces, links and seeds by hand."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from ccpin.proof import covers
from ccpin.proof.cell_tree import WHOLE, CellRegion, lie_within, tree_of
from ccpin.proof.covers import RegionCover, over_region
from ccpin.proof.demanded import Demanded
from ccpin.proof.facts import NotProvedError, prove
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes
from tests.support.straight import at_points, boxes_about, circles, straight, whole_numbers

U = 2.0**-53
LINE, PLANE = straight([[1.0]]), straight([[1.0, 1.0]])


def fact_of(equations, centre, half, slope=((1.0,),), radius=0.1):
    return prove(SolutionsInBoxes(equations, *boxes_about(centre, half, slope, radius)))


def glued(equations, facts, first, second, at, there):
    at, there = (np.atleast_2d(np.array(d, dtype=float)) for d in (at, there))
    return prove(GluedBoxes(equations, whole_numbers(first), whole_numbers(second), at, there), *facts)


def met(equations, facts, theta, box, at, other=None, there=None):
    """That the solution at θ is that of a box, or of two."""
    slope = np.ones((1, len(theta) - 1))
    point = prove(SolutionsInBoxes(equations, *at_points(boxes_about([theta], 0.0, slope, 1e-3))))
    other, there = (box, at) if other is None else (other, there)
    at, there = (np.atleast_2d(np.array(d, dtype=float)) for d in (at, there))
    return prove(Met(equations, whole_numbers(box), whole_numbers(other), at, there, whole_numbers(0)), point, *facts)


def cover(
    equations=LINE,
    lower=(0.0,),
    upper=(1.0,),
    wrapped=(False,),
    cut=(0, 0, 0),
    child=(1, -1, -1),
    box=(-1, 0, 1),
    start=0,
):
    """A claim: by default two halves of [0, 1], each in a box."""
    cut, child, box = (whole_numbers(*given) for given in (cut, child, box))
    return RegionCover(
        equations, np.array(lower), np.array(upper), np.array(wrapped), cut, child, box, whole_numbers(start)
    )


@pytest.fixture(scope="module")
def halves():
    """Two boxes, what glues them, and the seed in the first."""
    boxes = fact_of(LINE, [[0.25, 0.25], [0.75, 0.75]], 0.25)
    return boxes, glued(LINE, [boxes], 0, 1, 0.25, -0.25), met(LINE, [boxes], [0.125, 0.125], 0, -0.125)


def test_two_halves_that_are_glued_are_the_region(halves):
    fact = prove(cover(), *halves)
    found = {name: array.tolist() for name, array in fact.found.items()}
    assert found == {
        "faces": [[0, 1]], "unglued": [], "reached": [True, True], "whole": [True], "seed": [[0.125, 0.125]],
    }  # fmt: skip
    assert over_region(fact, None, False)
    spare = prove(cover(cut=(0, 0, 0, 0), child=(1, -1, -1, -1), box=(-1, 0, 1, -1)), *halves)
    assert spare.found["whole"].tolist() == [True]


def test_what_is_missing_is_found_missing(halves):
    """What glues, a box of either half, a seed."""
    boxes, glue, seed = halves
    torn = prove(cover(), boxes, seed)
    assert (torn.found["unglued"].tolist(), torn.found["reached"].tolist()) == ([[0, 1]], [True, False])
    for box in ((-1, 0, -1), (-1, -1, 1)):
        fact = prove(cover(box=box), *halves)
        assert (fact.found["faces"].tolist(), fact.found["whole"].tolist()) == ([], [False])
    nowhere = prove(cover(start=-1), boxes, glue)
    assert (nowhere.found["reached"].tolist(), nowhere.found["seed"].shape) == ([False, False], (0, 2))
    for fact in (torn, prove(cover(box=(-1, 0, -1)), *halves), nowhere):
        assert not over_region(fact, None, False)
    with pytest.raises(NotProvedError):
        prove(cover(), boxes, glue)
    other = fact_of(LINE, [[5.0, 5.0]], 0.25)
    assert not len(prove(cover(start=-1), boxes, met(LINE, [other], [5.0, 5.0], 0, 0.0)).found["seed"])
    for start in (2, 3):
        with pytest.raises(NotProvedError):
            covers._joined(np.zeros((0, 2), dtype=np.int64), start, 2)
    assert covers._joined(np.array([[1, 2]]), 2, 4).tolist() == [False, True, True, False]


def test_a_seed_is_in_its_box_and_no_other(halves):
    """A fact that says of it that it is in two is none about its box alone; nor is one that glues the box to itself."""
    boxes, glue, _ = halves
    wide = fact_of(LINE, [[0.25, 0.25], [0.75, 0.75]], 0.3)
    both = met(LINE, [wide], [0.5, 0.5], 0, 0.25, 1, -0.25)
    back = met(LINE, [wide], [0.5, 0.5], 1, -0.25, 0, 0.25)
    for start, seed in product((0, 1), (both, back)):
        with pytest.raises(NotProvedError):
            prove(cover(start=start), wide, seed)
    itself = glued(LINE, [boxes], 0, 0, 0.0, 0.0)
    assert len(prove(cover(), boxes, itself, *halves[1:]).found["seed"]) == 1
    with pytest.raises(NotProvedError):
        prove(cover(), boxes, glue, prove(cover(), *halves))


def test_leaves_name_boxes_that_there_are_and_lie_in_them(halves):
    for box in ((-1, 0, 2), (-1, 0, 3), (-1, 1, 1), (-1, 0, 0)):
        with pytest.raises(NotProvedError):
            prove(cover(box=box), *halves)
    with pytest.raises(NotProvedError):
        prove(cover(lower=(1.5,), upper=(1.0,), box=(-1, -1, -1), start=-1), *halves[:2])
    along = np.tile(np.array([[0.0, 1.0], [0.0, 1.0]]), (2, 1, 1))
    path = prove(SolutionsInBoxes(LINE, *halves[0].claim.boxes._replace(directions=along, half=np.ones((2, 2)))))
    assert not prove(cover(box=(-1, -1, -1), start=-1), path).found["whole"]
    with pytest.raises(NotProvedError):
        prove(cover(start=-1), path)
    twice = halves[0].claim.boxes
    twice = prove(SolutionsInBoxes(LINE, *twice._replace(directions=2.0 * twice.directions)))
    with pytest.raises(NotProvedError):
        prove(cover(start=-1), twice)


def test_cells_whose_leaves_lie_in_one_box_are_glued():
    """Without a fact that says so; not where one is a turn further."""
    box = fact_of(LINE, [[0.5, 0.5]], 0.5)
    fact = prove(cover(box=(-1, 0, 0)), box, met(LINE, [box], [0.5, 0.5], 0, 0.0))
    assert over_region(fact, None, False)
    assert prove(cover(box=(-1, 0, 0), start=-1), box).found["unglued"].tolist() == []
    half = fact_of(LINE, [[0.25, 0.25]], 0.25)
    part = prove(cover(box=(-1, 0, -1)), half, met(LINE, [half], [0.25, 0.25], 0, 0.0))
    assert (part.found["reached"].all(), over_region(part, None, False)) == (True, False)
    for n, region in ((1, ((-np.pi,), (np.pi,))), (2, ((-np.pi, -0.1), (np.pi, 0.1)))):
        equations = circles(n, planar=True)
        half, zero = np.array(region[1]), np.zeros(n)
        turn = fact_of(equations, [[0.0] * (n + 1)], half, -np.ones((1, n)))
        wrapped = [True, False][:n]
        claim = cover(equations, *region, wrapped, (0,), (-1,), (0,))
        seed = met(equations, [turn], [0.0] * (n + 1), 0, zero)
        assert prove(claim, turn, seed).found["unglued"].tolist() == [[0, 0]]
        end = zero + np.eye(n)[0] * np.pi
        link = glued(equations, [turn], 0, 0, end, -end)
        assert abs(link.found["turn"]).tolist() == [[1, 0][:n]]
        assert over_region(prove(claim, turn, seed, link), None, False)
        assert prove(claim, turn, seed, glued(equations, [turn], 0, 0, zero, zero)).found["unglued"].tolist() == [
            [0, 0]
        ]


@pytest.mark.parametrize(("start", "most"), [(-np.pi, 6), (1.5, 7)])
def test_a_full_turn_is_one_to_its_roundings(start, most):
    """4u (2π + |a| + |b|), which is 50u and 62u here, one unit of the end's being 8u."""
    turn = fact_of(circles(), [[0.0, 0.0]], 0.01, [[-1.0]])
    for units in (-most - 1, -most, 0, most, most + 1):
        end = start + 2.0 * np.pi + 8.0 * U * units
        claim = cover(circles(), (start,), (end,), (True,), (0,), (-1,), (-1,), -1)
        if abs(units) > most:
            with pytest.raises(NotProvedError):
                prove(claim, turn)
        else:
            prove(claim, turn)
    with pytest.raises(NotProvedError):
        prove(cover(LINE, (-np.pi,), (np.pi,), (True,), (0,), (-1,), (-1,), -1), fact_of(LINE, [[0.0, 0.0]], 0.5))


def lies_within(claim, tree, cell, boxes):
    """Whether a cell of a claim's region lies in a box."""
    region = CellRegion(claim.lower, claim.upper, claim.wrapped)
    return bool(lie_within(claim.equations, region, tree, whole_numbers(cell), boxes, whole_numbers(0))[0])


def test_corners_are_real_numbers():
    """lower + share (upper − lower), to the order of u²."""
    rng = np.random.default_rng(4)
    for _ in range(50):
        low, high = np.sort(rng.normal(size=(2, 3)), axis=0) * 10.0 ** rng.integers(-3, 4)
        corner = rng.integers(0, WHOLE, (5, 3))
        claim = cover(straight(np.ones((1, 3))), low, high, (False,) * 3)
        at, rest = CellRegion(claim.lower, claim.upper, claim.wrapped).position(corner)
        for k, i in product(range(5), range(3)):
            a, b = Fraction(low[i]), Fraction(high[i])
            stated = a + (b - a) * Fraction(int(corner[k, i]), WHOLE)
            assert abs(Fraction(at[k, i]) + Fraction(rest[k, i]) - stated) < 20 * U**2 * (1 + abs(a) + abs(b))


def test_a_cell_lies_in_its_box_to_99_parts_of_what_that_is_widened_by():
    """|x − c| ≤ h + 0.99 (1e-14 + 4u (|c| + h)) of both corners, x and the difference as real numbers."""
    rng = np.random.default_rng(5)
    cut, child = np.zeros(5, dtype=np.int64), whole_numbers(1, -1, 3, -1, -1)
    tree = tree_of(cut, child, 1)
    share = Fraction(99, 100)
    for size, which in product((1e-3, 1.0, 1e3), (1, 3, 4)):
        for upper in (False, True):
            low = size * rng.normal()
            high = low + 1e-3 * rng.uniform(1.0, 2.0)
            claim = cover(LINE, (low,), (high,), (False,), cut, child, np.where(np.arange(5) == which, 0, -1))
            corner = int(tree.lower[which, 0] + upper * tree.size[which, 0])
            x = Fraction(low) + (Fraction(high) - Fraction(low)) * Fraction(corner, WHOLE)
            width = float(tree.size[which, 0] / WHOLE) * (high - low)
            centre = float(x) + (-1 if upper else 1) * 0.6 * width
            gap = abs(x - Fraction(centre))
            for more, held in ((1e-18, True), (-1e-18, False)):
                stated = share * (Fraction(1e-14) + 4 * Fraction(U) * (abs(Fraction(centre)) + gap))
                half = float(gap - stated + Fraction(more) + (1 if more > 0 else -1) * 2 * Fraction(np.spacing(width)))
                boxes = boxes_about([[centre, centre]], half, [[1.0]], 1.0)
                assert lies_within(claim, tree, which, boxes) == held


def test_a_distance_is_rounded_once():
    """A corner's from the centre, whatever the two doubles of either are."""
    rng = np.random.default_rng(6)
    tree = tree_of(whole_numbers(0, 0, 0), whole_numbers(1, -1, -1), 1)
    for _ in range(60):
        low, centre = rng.uniform(1.0, 2.0), rng.uniform(-0.5, 0.5)
        high = low + rng.uniform(0.5, 1.0)
        claim = cover(LINE, (low,), (high,), (False,))
        gap = (Fraction(low) + Fraction(high)) / 2 - Fraction(centre)  # the upper corner of the lower half
        for half in float(gap) - 1.2e-14 + np.spacing(1.0) * np.arange(-12, 12):
            h = Fraction(float(half))
            more = Fraction(99, 100) * (Fraction(1e-14) + 4 * Fraction(U) * (abs(Fraction(centre)) + h))
            boxes = boxes_about([[centre, centre]], half, [[1.0]], 1.0)
            assert lies_within(claim, tree, 1, boxes) == (float(gap) <= float(h + more))


def test_what_is_widened_counts_each_of_its_terms():
    """[½, 1] in a box about ¾: 0.99 (1e-14 + 4u) = 1.034e-14 of it may be missing."""
    tree = tree_of(whole_numbers(0, 0, 0), whole_numbers(1, -1, -1), 1)
    for less, held in ((1.031e-14, True), (1.0375e-14, False)):
        boxes = boxes_about([[0.75, 0.75]], 0.25 - less, [[1.0]], 1.0)
        assert lies_within(cover(box=(-1, -1, 0)), tree, 2, boxes) == held


def test_a_cell_lies_in_its_box_in_every_coordinate():
    """[½, 1] × [0, 1] in boxes too narrow one way or the other."""
    tree, region = (
        tree_of(whole_numbers(0, 0, 0), whole_numbers(1, -1, -1), 2),
        ((0.0, 0.0), (1.0, 1.0), (False, False)),
    )
    boxes = boxes_about(3 * [[0.75, 0.5, 1.25]], [[0.25, 0.5], [0.25, 0.4], [0.2, 0.5]], [[1.0, 1.0]], 1.0)
    cells = whole_numbers(2, 2, 2)
    found = lie_within(PLANE, CellRegion(*map(np.array, region)), tree, cells, boxes, whole_numbers(0, 1, 2))
    assert found.tolist() == [True, False, False]


def test_a_region_of_four_cells_has_four_faces():
    """A ring of them: one face torn is enough, though every box is reached over the others."""
    centre = [[x, y, x + y] for y in (0.25, 0.75) for x in (0.25, 0.75)]
    boxes = fact_of(PLANE, centre, 0.25, [[1.0, 1.0]])
    claim = cover(
        PLANE, (0.0, 0.0), (1.0, 1.0), (False, False), (0, 1, 1, 0, 0, 0, 0), (1, 3, 5, -1, -1, -1, -1),
        (-1, -1, -1, 0, 2, 1, 3),
    )  # fmt: skip
    right, up = np.array([0.25, 0.0]), np.array([0.0, 0.25])
    links = [
        glued(PLANE, [boxes], *pair, step, -step)
        for pair, step in (((0, 1), right), ((2, 3), right), ((0, 2), up), ((1, 3), up))
    ]
    seed = met(PLANE, [boxes], [0.25, 0.25, 0.5], 0, [0.0, 0.0])
    assert over_region(prove(claim, boxes, seed, *links), None, False)
    for k in range(4):
        torn = prove(claim, boxes, seed, *links[:k], *links[k + 1 :])
        assert (len(torn.found["unglued"]), torn.found["reached"].all()) == (1, True)
        assert not over_region(torn, None, False)


def test_facts_number_their_boxes_one_behind_the_other():
    """A box of one fact, two of another; what they glue is told by the cover's numbers, if they are the cover's."""
    one = fact_of(LINE, [[9.0, 9.0]], 0.25)
    two = fact_of(LINE, [[0.25, 0.25], [0.75, 0.75]], 0.25)
    glue, seed = glued(LINE, [two], 0, 1, 0.25, -0.25), met(LINE, [two], [0.25, 0.25], 0, 0.0)
    fact = prove(cover(box=(-1, 1, 2), start=1), one, two, glue, seed)
    assert (fact.found["unglued"].tolist(), fact.found["reached"].tolist()) == ([], [False, True, True])
    assert not over_region(fact, None, False)  # the box at 9 is no part of it
    both = glued(LINE, [one, two], 1, 2, 0.25, -0.25)
    assert covers._numbers(both, (one, two)).tolist() == [0, 1, 2]
    assert covers._numbers(both, (two, one)).tolist() == [2, 0, 1]
    assert covers._numbers(both, (two,)).tolist() == [-1, 0, 1]
    assert len(covers._links(both, (two,), 2)) == 1
    near = fact_of(LINE, [[1.25, 1.25]], 0.25)
    for first, second, at in ((1, 2, 0.25), (2, 1, -0.25)):
        across = glued(LINE, [two, near], first, second, at, -at)
        assert len(covers._links(across, (two,), 2)) == 0
        assert len(covers._links(across, (two, near), 3)) == 1


@pytest.mark.parametrize(
    ("turns", "kept"), [((0, 0), 1), ((1, 0), 1), ((-1, 1), 1), ((2, 0), 0), ((0, -2), 0), ((1, 2), 0)]
)
def test_links_go_at_most_one_turn_round(turns, kept):
    """A face is one turn further at most."""
    equations = circles(2, planar=True)
    q = 2.0 * np.pi * np.array(turns)
    boxes = fact_of(equations, [[0.0, 0.0, 0.0], [-q[0], -q[1], q.sum()]], 0.1, [[-1.0, -1.0]])
    link = glued(equations, [boxes], 0, 1, [0.0, 0.0], [0.0, 0.0])
    assert link.found["turn"].tolist() == [list(turns)]
    assert len(covers._links(link, (boxes,), 2)) == kept


def test_pairs_have_one_number_each_whichever_way_they_are_told():
    """(a, b, k) is (b, a, −k), and nothing else."""
    seen = {}
    for a, b, *turn in product(range(4), range(4), (-1, 0, 1), (-1, 0, 1)):
        pairs = (
            (whole_numbers(a), whole_numbers(b), np.array([turn])),
            (whole_numbers(b), whole_numbers(a), -np.array([turn])),
        )
        key, back = (int(covers._keys(*pair, 4)[0]) for pair in pairs)
        assert key == back
        assert seen.setdefault(key, {(a, b, *turn), (b, a, *(-k for k in turn))}) == {
            (a, b, *turn),
            (b, a, *(-k for k in turn)),
        }
    with pytest.raises(NotProvedError):
        covers._keys(whole_numbers(0), whole_numbers(1), np.zeros((1, 1), dtype=np.int64), 2**31)


def test_more_is_met_by_the_same_boxes_or_not_at_all(halves):
    """A fact about their twins, or none, says nothing of them."""
    fact = prove(cover(), *halves)
    none = np.zeros(0, dtype=np.int64)
    claim = Demanded(LINE, np.full(2, -9.0), np.full(2, 9.0), none, np.ones(1), np.zeros(1))
    assert over_region(fact, prove(claim, halves[0]), True)
    assert not over_region(fact, prove(claim, halves[0].replay()), True)
    assert not over_region(fact, None, True)
