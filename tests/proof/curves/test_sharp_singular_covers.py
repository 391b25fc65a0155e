"""Branch and prune loses no box: which are halved, which stay, what ends it, and of what a fact then is."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.arrays import joined, rows_of
from ccpin.proof.curves import singular_covers as module
from ccpin.proof.curves.settled_boxes import Beside
from ccpin.proof.curves.singular_covers import SingularCovered, covers, halved_steepest, narrowed_to_singular
from ccpin.proof.curves.tubes import Stated
from ccpin.proof.facts import NotProvedError
from ccpin.proof.narrowing import Candidates
from tests.support.made_up import made_up

SIZE = 4


def boxes_of(centre, half):
    """Boxes of two independent coordinates, 1 and 3, and two dependent ones."""
    return Candidates(np.arange(len(centre)), centre, half, np.zeros((len(centre), 2, 2)))


def edged(*edges):
    """Boxes with such largest half edges, others a tenth of them."""
    half = np.array([[0.1 * edge, 0.1 * edge, edge, 0.1 * edge] for edge in edges]).reshape(-1, SIZE)
    return boxes_of(np.zeros((len(edges), SIZE)), half)


# The steps.


def halves_of(monkeypatch, boxes, jacobian, hessian, rows=(0, 1)):
    """`halved_steepest` where φ moves as told."""
    values = SimpleNamespace(jacobian=jacobian, hessian=hessian)
    monkeypatch.setattr(module, "derivatives", lambda problem, theta: values)
    monkeypatch.setattr(module, "rows_to_halve_for", lambda problem: np.array(rows))
    return halved_steepest(made_up(), boxes)


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


def test_boxes_are_narrowed_with_both_choices(monkeypatch):
    """First with Ã = I, then with the inverse, whereby all regular ones are dropped; what is beyond is dropped last."""
    asked = []

    def narrowed(problem, boxes, inverse=False, regular=None):
        asked.append((inverse, None if regular is None else regular.tolist()))
        return rows_of(boxes, boxes.cell != len(asked))

    monkeypatch.setattr(module, "narrowed", narrowed)
    monkeypatch.setattr(module, "beyond", lambda problem, ranges, boxes: boxes.cell == ranges)
    assert narrowed_to_singular(None, 4, edged(*5 * [1.0])).cell.tolist() == [0, 3]
    assert asked == [(False, None), (True, [True] * 4)]
    asked.clear()
    assert narrowed_to_singular(None, 4, rows_of(edged(1.0, 1.0), slice(1, None))).cell.tolist() == []
    assert asked == [(False, None)]


def test_boxes_are_settled_by_tubes_beside_them(monkeypatch):
    """Those that are worth a try; all others stay, and all where there are no tubes."""
    nearest, worth = np.arange(12).reshape(6, 2), np.array([1, 1, 0, 0, 1, 1], dtype=bool)
    asked = []

    def settles(problem, boxes, tubes, beside):
        asked.append((problem, boxes.cell.tolist(), tubes, beside.tolist()))
        return np.array([True, False, False, True])

    monkeypatch.setattr(module, "narrowed_to_singular", lambda problem, ranges, boxes: boxes)
    monkeypatch.setattr(module, "settled_beside", settles)
    nearby = SimpleNamespace(problem="plain", tubes="tubes", beside=lambda boxes: Beside(nearest, worth))
    boxes = edged(*6 * [1.0])
    assert module._pruned("problem", None, nearby, boxes).cell.tolist() == [1, 2, 3, 4]
    assert asked == [("plain", [0, 1, 4, 5], "tubes", [[0, 1], [2, 3], [8, 9], [10, 11]])]
    assert len(module._pruned("problem", None, None, boxes).cell) == 6
    nearby.beside = None
    assert not len(module._pruned("problem", None, nearby, edged()).cell)


# The claim.


def claim_of(resolution=0.2, most=100, n=2, **others):
    """A claim about made-up equations."""
    problem = made_up()
    problem.system.n = n
    given = {
        "lower": np.zeros(2), "upper": np.ones(2), "limits": np.zeros((2, 2)) + [-1.0, 1.0], "middle": np.zeros(SIZE),
        "resolution": np.array([resolution]), "most": np.array([most]),
    }  # fmt: skip
    return SingularCovered(SimpleNamespace(system=problem.system, problem=problem), **(given | others))


@pytest.fixture
def told(monkeypatch):
    """Branch and prune where it is told which boxes are dropped, by number; halves have numbers + 100 · 2^k."""
    made = SimpleNamespace(first=edged(1.0), dropped=[], waves=[], tubes=0, parts=[], asked=[])

    def pruned(problem, ranges, nearby, boxes):
        made.parts.append(len(boxes.cell))
        made.nearby = nearby
        return rows_of(boxes, ~np.isin(boxes.cell, made.dropped))

    def halves(problem, boxes):
        made.waves.append(boxes.cell.tolist())
        half = boxes._replace(half=0.5 * boxes.half)
        return joined([half, half._replace(cell=boxes.cell + 100 * 2 ** len(made.waves))])

    monkeypatch.setattr(module, "_pruned", pruned)
    monkeypatch.setattr(module, "halved_steepest", halves)
    monkeypatch.setattr(module, "over_all", lambda problem, ranges, lower, upper: made.first)
    monkeypatch.setattr(module, "proved_ranges", lambda *given: made.asked.append(given))
    monkeypatch.setattr(module, "tubes_of", lambda equations, facts: SimpleNamespace(half=np.zeros(made.tubes)))
    monkeypatch.setattr(module, "Nearby", lambda problem, tubes: (problem.phasors, tubes))
    return made


def test_boxes_are_halved_until_they_are_gone_or_small(told):
    """Of 0 … 3 the first is dropped, the third is small at once, the others after a halving, or two."""
    told.first, told.dropped = edged(1.0, 0.39, 0.199, 0.401), [0, 203]
    found = claim_of().examined().found
    assert told.waves == [[1, 3], [3], []]
    assert (found["tried"].tolist(), found["early"].tolist()) == ([4 + 4 + 2], [False])
    np.testing.assert_allclose(found["upper"][:, 2], [0.199, 0.195, 0.195, 0.401 / 4, 0.401 / 4], rtol=1e-9)
    assert np.all(found["upper"][:, 2] >= [0.199, 0.195, 0.195, 0.401 / 4, 0.401 / 4])
    np.testing.assert_array_equal(found["lower"], -found["upper"])


@pytest.mark.parametrize(("edge", "left", "tried"), [(0.1999, 1, 1), (0.2001, 2, 3)])
def test_the_resolution_is_of_half_edges(told, edge, left, tried):
    told.first = edged(edge)
    found = claim_of().examined().found
    assert (len(found["lower"]), found["tried"][0]) == (left, tried)


@pytest.mark.parametrize(
    ("most", "tried", "early"), [(0, 1, True), (1, 3, True), (2, 3, True), (3, 7, False), (99, 7, False)]
)
def test_what_waits_when_enough_were_tried_is_listed(told, most, tried, early):
    """A wave is begun if no more than that were tried; all that is halved after it is listed."""
    told.first = edged(0.5)
    found = claim_of(most=most).examined().found
    assert (found["tried"][0], found["early"][0]) == (tried, early)
    assert len(found["lower"]) == 2 ** min(len(told.waves), 2)


def test_boxes_are_listed_where_they_are(told):
    """Centre and half edges, outward."""
    told.first = edged(0.1)._replace(centre=np.array([[1.0, -2.0, 3.0, 0.0]]))
    found = claim_of().examined().found
    np.testing.assert_allclose(found["lower"], [[0.99, -2.01, 2.9, -0.01]], rtol=1e-9)
    np.testing.assert_allclose(found["upper"], [[1.01, -1.99, 3.1, 0.01]], rtol=1e-9)
    assert np.all((found["lower"] < [0.99, -2.01, 2.9, -0.01]) & (found["upper"] > [1.01, -1.99, 3.1, 0.01]))


def test_nothing_waits_and_nothing_is_listed(told):
    told.dropped = [0]
    found = claim_of().examined().found
    assert (len(found["lower"]), found["tried"][0], found["early"][0]) == (0, 1, False)


def test_what_waits_when_a_flag_is_set_is_listed(told, monkeypatch):
    """Before a wave, between its chunks, and not when that is over."""
    told.first = edged(0.5)
    monkeypatch.setattr(module, "ended", lambda: True)
    found = claim_of().examined().found
    assert (told.parts, len(found["lower"]), found["tried"][0], found["early"][0]) == ([], 1, 0, True)
    told.first, told.dropped = edged(*1500 * [0.5]), list(range(1500))
    monkeypatch.setattr(module, "ended", lambda: bool(told.parts))
    found = claim_of().examined().found
    assert (told.parts, len(found["lower"]), found["tried"][0], found["early"][0]) == ([1000], 1000, 1500, True)
    told.parts = []
    monkeypatch.setattr(module, "ended", lambda: False)
    assert not len(claim_of().examined().found["lower"])
    assert told.parts == [1000, 500]
    assert claim_of().examined().proved.tolist() == [True]


def test_tubes_are_known_from_the_start(told):
    """With bounds for any tree; none where there are none."""
    claim_of().examined()
    assert told.nearby is None
    told.tubes = 1
    claim_of().examined()
    assert told.nearby[0] is None
    assert len(told.nearby[1].half) == 1


def test_regions_and_limits_that_are_none(told):
    """Of one coordinate, or three; with corners or limits exchanged, in any row. Those that are the same are some."""
    for wrong in (
        {"n": 1}, {"n": 3}, {"lower": np.array([0.0, 1.5])}, {"lower": np.array([1.5, 0.0])},
        {"limits": np.array([[-1.0, 1.0], [1.0, -1.0]])}, {"limits": np.array([[1.0, -1.0], [-1.0, 1.0]])},
        {"limits": np.array([[-1.0, 1.0], [1.0, 0.75]])},
    ):  # fmt: skip
        with pytest.raises(NotProvedError):
            claim_of(**wrong).examined()
    claim_of(lower=np.ones(2), limits=np.zeros((2, 2))).examined()


def test_ranges_are_derived(told):
    """Of the claim's own numbers; of θ in the middle of full turns the dependent coordinates."""
    claim = claim_of(middle=np.arange(float(SIZE)))
    claim.examined()
    ((closures, middle, region, limits),) = told.asked
    assert closures is claim.equations.system
    assert middle.tolist() == [0.0, 2.0]
    assert (region[0] is claim.lower, region[1] is claim.upper, limits is claim.limits) == 3 * (True,)


def test_a_fact_is_about_its_own_numbers(monkeypatch):
    """Corners, limits and every array of the tubes: no other, in no other order; and none but facts about regions."""
    claim, tubes = claim_of(), Stated(*(np.arange(2.0) + k for k in range(7)))
    fact = SimpleNamespace(claim=claim, premises=())
    monkeypatch.setattr(module, "tubes_of", lambda equations, facts: tubes)
    monkeypatch.setattr(module, "Fact", SimpleNamespace)
    region, limits = (claim.lower, claim.upper), claim.limits
    assert covers(fact, (claim.lower + 0.0, claim.upper + 0.0), limits + 0.0, tubes)
    for k in range(2):
        off = [claim.lower, claim.upper]
        off[k] = off[k] + [0.0, 1e-16 if k == 0 else 1e-15]
        assert not covers(fact, (off[0], off[1]), limits, tubes)
    assert not covers(fact, region, limits + [0.0, 1e-15], tubes)
    for name in Stated._fields:
        for other in (getattr(tubes, name)[::-1], getattr(tubes, name)[:1]):
            assert not covers(fact, region, limits, tubes._replace(**{name: other}))
    for other in (SimpleNamespace(claim=fact, premises=()), claim):
        with pytest.raises(NotProvedError):
            covers(other, region, limits, tubes)
