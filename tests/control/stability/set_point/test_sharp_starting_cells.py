"""The cells that a flood starts from: whose they are, which touch on the line, and in whose turn they are."""

from dataclasses import dataclass
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest

from ccpin.control.stability.set_point import starting_cells as module
from ccpin.control.stability.set_point.flood import FloodLimits
from ccpin.errors import InvalidInputError
from tests.support.flat_cells import boxes_about

TURN = 2.0 * np.pi


@dataclass(frozen=True)
class System:
    independent: np.ndarray
    periodic: np.ndarray
    m: int = 2


class Problem(NamedTuple):
    system: System


class Reading(NamedTuple):
    problem: Problem
    theta: object = None
    chart: object = None

    @property
    def system(self):
        return self.problem.system


def reading(periodic, independent=(0, 1)):
    found = Reading(Problem(System(np.array(independent), np.array(periodic, bool))))
    return found._replace(theta=lambda q_free: np.full(len(periodic), 7.0), chart=SimpleNamespace(n_free=len(periodic)))


def test_dependent_coordinates_with_springs_are_compared_on_the_line():
    one = reading([True, False, True, True, True])
    told = module.on_the_line(one, SimpleNamespace(stiffness=np.array([1.0, 1.0, 2.0, 0.0, -3.0])))
    assert told.system.periodic.tolist() == [True, False, False, True, False]
    for stiffness in ([1.0, 0.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0, 0.0]):
        assert module.on_the_line(one, SimpleNamespace(stiffness=np.array(stiffness))) is one


# Boxes of an atlas.

LOWER = np.array([[0.0, 0.0], [1.0, 0.5], [1.0, -3.0], [0.0, 1.0]])
UPPER = np.array([[1.0, 1.0], [3.0, 2.0], [2.0, 0.5], [1.0, 2.0]])


def atlas_of(lower=LOWER, upper=UPPER, box=(0, 1, -1, 2, 3), unglued=(), **more):
    one = reading([False, False, True, True])
    boxes = boxes_about(0.5 * (lower + upper), 0.5 * (upper - lower))
    boxes = boxes._replace(centre=np.column_stack([boxes.centre, np.zeros(len(lower))]))
    known = {
        "names": ("a", "b"), "reading": one, "problem": one.problem, "lower": lower, "upper": upper, "boxes": boxes,
        "tree": SimpleNamespace(box=np.array(box)), "region": SimpleNamespace(held=np.array([False, False])),
        "unglued": unglued,
    }  # fmt: skip
    return SimpleNamespace(**known | more)


def test_middles_of_common_faces():
    found = module._between(atlas_of(), np.array([[0, 1], [1, 0], [2, 1]]))
    np.testing.assert_array_equal(found, [[1.0, 0.75], [1.0, 0.75], [1.5, 0.5]])


@pytest.mark.parametrize(("gap", "held"), [(0.95e-9, True), (1.05e-9, False), (-0.5, True), (1.0, False)])
def test_boxes_touch_as_they_lie(gap, held):
    """To a billionth of the shorter edge, in every coordinate; not across the seam of a turn."""
    shifts = np.array([0.5, 0.0]) * gap, np.array([0.0, 0.25]) * gap
    for shift in shifts:
        lower = np.array([[10.0, 4.0], [10.5, 4.25]]) + [[0.0, 0.0], shift]
        upper = np.array([[10.5, 4.25], [13.0, 5.0]]) + [[0.0, 0.0], shift]
        for one in (atlas_of(lower, upper), atlas_of(lower[::-1], upper[::-1])):
            assert module._touch_on_the_line(one, np.array([[0, 1]])).tolist() == [held]


def test_pairs_that_are_glued(monkeypatch):
    """Of leaves with boxes that touch; less those that are told to be unglued, in either order."""
    asked = []

    def contacts(tree, region, leaves):
        asked.append(leaves.tolist())
        cell, leaf = np.array([0, 1, 0, 1, 4, 0]), np.array([1, 3, 2, 4, 0, 3])
        return SimpleNamespace(cell=cell, leaf=leaf)

    monkeypatch.setattr(module, "contacts_of", contacts)
    assert module._glued_pairs(atlas_of()) == {(0, 1), (1, 2), (1, 3), (0, 3), (0, 2)} - {(0, 2)} | {(0, 2)}
    assert asked == [[0, 1, 3, 4]]
    for pair in ((1, 2), (2, 1)):
        assert (1, 2) not in module._glued_pairs(atlas_of(unglued=(pair,)))
    assert module._glued_pairs(atlas_of(unglued=((3, 0), (0, 1)))) == {(1, 2), (1, 3), (0, 2)}
    apart = UPPER - [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0], [0.5, 0.0]]
    assert (1, 3) not in module._glued_pairs(atlas_of(upper=apart))


def law_at(q_d, free=None):
    mechanism = SimpleNamespace(independent=("a", "b"), n_free=4)
    model = SimpleNamespace(mechanism=mechanism, gravity_vector=None)
    return SimpleNamespace(model=model, q_d=np.array(q_d), q_free_d=free)


@pytest.fixture
def taken(monkeypatch):
    """`cells_of_atlas` with everything told."""
    told = SimpleNamespace(pairs={(0, 1), (1, 2)}, enclosed=None, asked=[], turned=None, sprung=False)
    monkeypatch.setattr(module, "_potential", lambda *_: "potential")
    monkeypatch.setattr(module, "set_point_of", lambda law: law)
    monkeypatch.setattr(module, "_glued_pairs", lambda atlas: told.pairs)
    monkeypatch.setattr(module, "on_the_line", lambda one, potential: one._replace() if told.sprung else one)
    monkeypatch.setattr(module, "_turned_to_the_law", lambda *given: told.asked.append(given) or told.turned)

    def encloses(problem, boxes, delta, theta, slack):
        told.asked.append((boxes.centre[:, :2], delta, theta, slack))
        return np.ones(len(delta), bool) if told.enclosed is None else np.array(told.enclosed)

    class Store:
        def __init__(self, *given):
            self.given = given

        def add_proved(self, *given):
            self.proved = given

    monkeypatch.setattr(module, "encloses", encloses)
    monkeypatch.setattr(module, "CellStore", Store)
    return told


def test_cells_of_an_atlas_are_its_boxes(taken):
    """All of them where no spring acts on a circle; the law's configuration is in those that hold q_d."""
    atlas = atlas_of()
    store = module.cells_of_atlas(law_at([1.0, 0.75]), atlas)
    centres, delta, theta, slack = taken.asked[0]
    np.testing.assert_array_equal(centres, [[0.5, 0.5], [2.0, 1.25]])
    np.testing.assert_array_equal(centres + delta, [[1.0, 0.75]] * 2)
    np.testing.assert_array_equal(theta, [[1.0, 0.75, 7.0, 7.0]] * 2)
    np.testing.assert_array_equal(slack, np.zeros((2, 2)))
    assert store.whole
    np.testing.assert_array_equal(store.proved[1], LOWER)
    np.testing.assert_array_equal(store.proved[2], UPPER)
    assert store.proved[3] == taken.pairs


@pytest.mark.parametrize(
    ("kept", "pairs", "whole"),
    [([0, 1, 2, 3], {(0, 1), (1, 2)}, True), ([0, 1, 2], {(0, 1), (1, 2)}, False), ([0, 1, 2, 3], {(0, 1)}, False)],
)
def test_what_springs_leave_of_an_atlas(taken, kept, pairs, whole):
    """It is whole where every box and every gluing is kept."""
    taken.sprung, atlas = True, atlas_of()
    taken.turned = atlas.boxes, np.array(kept), pairs
    store = module.cells_of_atlas(law_at([1.0, 0.75]), atlas)
    assert store.whole is whole
    np.testing.assert_array_equal(store.proved[1], LOWER[kept])
    np.testing.assert_array_equal(store.proved[2], UPPER[kept])
    assert store.proved[3] == pairs


def test_atlases_that_are_not_about_the_set_point(taken):
    """Of other coordinates, another chart, a slice, elsewhere, or of another branch in one of the boxes there."""
    law = law_at([1.0, 0.75])
    wrong = {"names": ("a", "c")}, {"region": SimpleNamespace(held=np.array([True, False]))}
    for given in (*wrong, {"reading": reading([False] * 5)}):
        with pytest.raises(InvalidInputError, match=r"over|slice"):
            module.cells_of_atlas(law, atlas_of(**given))
    with pytest.raises(InvalidInputError, match="not in the atlas"):
        module.cells_of_atlas(law_at([9.0, 0.75]), atlas_of())
    for enclosed in ((True, False), (False, True)):
        taken.enclosed = enclosed
        with pytest.raises(InvalidInputError, match="branch"):
            module.cells_of_atlas(law, atlas_of())


# Turns. Of each box the dependent coordinates are predicted to be `offset` + whole turns off; the last is on no circle.

OFFSET = np.array([[0.2, 0.1], [0.2 + TURN, 0.3], [0.2 - TURN, 0.1 + TURN], [5.0, 0.0]])


@pytest.fixture
def predicted(monkeypatch):
    asked = []

    def predict(problem, boxes, delta):
        asked.append(boxes.centre[:, :2] + delta)
        number = [
            int(np.flatnonzero(np.all(atlas_of().boxes.centre[:, :2] == c, axis=1))[0]) for c in boxes.centre[:, :2]
        ]
        return np.column_stack([boxes.centre[:, :2] + delta, OFFSET[number]])

    monkeypatch.setattr(module, "predict", predict)
    return asked


def test_turns_that_bring_boxes_to_the_law(predicted):
    """Those that hold q_d to its configuration, every further one to what it is reached from."""
    free = np.array([1.0, 0.75, 0.25 + 6.0 * TURN, 0.1])
    atlas = atlas_of()
    atlas = SimpleNamespace(**vars(atlas) | {"reading": atlas.reading._replace(theta=lambda _: free)})
    problem = Problem(System(np.array([0, 1]), np.array([False, False, False, True])))
    around = np.array([0])
    turns, reached = module._turns(problem, atlas, {(0, 1), (1, 2)}, around, law_at([1.0, 0.75]))
    assert reached.tolist() == [True, True, True, False]
    np.testing.assert_array_equal(turns[:, 2], [6.0, 5.0, 7.0, 0.0])
    np.testing.assert_array_equal(turns[:, [0, 1, 3]], 0.0)
    np.testing.assert_allclose(predicted[0], [[1.0, 0.75]])
    np.testing.assert_allclose(predicted[1], [[1.0, 0.75]])
    np.testing.assert_allclose(predicted[2], [[1.0, 0.75]])
    np.testing.assert_allclose(predicted[3], [[1.5, 0.5]])
    turns, reached = module._turns(problem, atlas, {(0, 3), (1, 2)}, around, law_at([1.0, 0.75]))
    assert reached.tolist() == [True, False, False, True]
    on_no_line = Problem(System(np.array([0, 1]), np.array([False, False, True, True])))
    turns, _ = module._turns(on_no_line, atlas, {(0, 1), (1, 2)}, around, law_at([1.0, 0.75]))
    assert not turns.any()
    plain = SimpleNamespace(**vars(atlas) | {"problem": Problem(System(np.array([0, 1]), np.zeros(4, bool)))})
    assert not module._turns(problem, plain, {(0, 1)}, around, law_at([1.0, 0.75]))[0].any()


def test_turned_boxes_are_proved_and_glued_again(monkeypatch):
    """Those that moved; of the pairs those of which both are left, where their faces agree on the line."""
    atlas = atlas_of()
    turns = np.zeros((4, 4))
    turns[1, 2], turns[2, 2], turns[3, 2] = 1.0, -2.0, 1.0
    told = SimpleNamespace(reached=[True, True, True, False], proved=[True, False], same=[True], checked=[], glued=[])
    monkeypatch.setattr(module, "_turns", lambda *_: (turns, np.array(told.reached)))

    def check(equations, boxes):
        told.checked.append(boxes.centre)
        return SimpleNamespace(proved=np.array(told.proved))

    def glued(problem, first, delta, second, other):
        told.glued.append((first.centre[:, :2] + delta, second.centre[:, :2] + other, first.centre, second.centre))
        return np.array(told.same, bool)

    monkeypatch.setattr(module, "closures_of", lambda problem: problem)
    monkeypatch.setattr(module, "check", check)
    monkeypatch.setattr(module, "glued", glued)
    pairs = {(0, 1), (1, 2), (1, 3)}
    moved = atlas.boxes.centre + TURN * turns
    found = module._turned_to_the_law(atlas.problem, atlas, pairs, np.array([0]), None)
    np.testing.assert_allclose(told.checked[0], moved[1:3])
    assert found.kept.tolist() == [0, 1]
    np.testing.assert_allclose(found.boxes.centre, moved[:2])
    assert found.pairs == {(0, 1)}
    first, second, one, other = told.glued[0]
    np.testing.assert_allclose(first, [[1.0, 0.75]])
    np.testing.assert_allclose(second, [[1.0, 0.75]])
    np.testing.assert_allclose(one, moved[:1])
    np.testing.assert_allclose(other, moved[1:2])
    told.proved, told.same, told.reached = [False, True, True], [False, True], [True, True, True, True]
    found = module._turned_to_the_law(atlas.problem, atlas, pairs | {(0, 3), (2, 3)}, np.array([0]), None)
    assert found.kept.tolist() == [0, 2, 3]
    assert found.pairs == {(1, 2)}  # of boxes 2 and 3; 0 and 3 do not agree
    told.reached, told.proved, told.same = [False, True, True, True], [True, True, True], [True, True]
    assert module._turned_to_the_law(atlas.problem, atlas, pairs, np.array([1]), None).pairs == {(0, 1), (0, 2)}


# A cell around the set point.


@pytest.mark.parametrize("single", [True, False])
def test_a_first_cell_is_the_box_that_was_proved(monkeypatch, single):
    """Its corners are q_d ∓ the half-widths of its box, and so is the lattice laid; a smaller one of the shape."""
    q_d, shape = np.array([0.5, -1.0]), np.array([1.0, 0.25])

    class Trials:
        proportions = shape

        def __init__(self, *given):
            pass

        def box(self, factor):
            return boxes_about(q_d, factor * shape) if factor < 0.4 else None

        def well(self, boxes):
            half = boxes.half[0]
            lower, upper = q_d - half, q_d + half
            height = 1.0 - (half[0] - 0.2) ** 2
            told = SimpleNamespace(lower=height, upper=height)
            return SimpleNamespace(centre=0.5 * (lower + upper), beta=half[0], effort=1.0, range_over=lambda *_: told)

    made = []
    monkeypatch.setattr(module, "_Trials", Trials)
    monkeypatch.setattr(module, "seed_at_coordinates", lambda *_: SimpleNamespace(reading="reading"))
    monkeypatch.setattr(module, "_potential", lambda *_: "potential")
    monkeypatch.setattr(module, "set_point_of", lambda law: law)
    monkeypatch.setattr(module, "on_the_line", lambda *given: "line")
    law = SimpleNamespace(q_d=q_d, q_free_d=None, model=SimpleNamespace(mechanism=None, gravity_vector=None))

    class Store:
        def __init__(self, *given):
            made.append(given)

        def add_first(self, *given):
            made.append(given)

    monkeypatch.setattr(module, "CellStore", Store)
    module.cells_around(law, 9.0, FloodLimits(3, 1 if single else 9))
    (one, potential, about, (corner, edges)), (box, lower, upper) = made
    assert (one, potential, about) == ("line", "potential", law)
    half = box.half[0]
    np.testing.assert_allclose(half / shape, half[0])
    np.testing.assert_array_equal(lower, q_d - half)
    np.testing.assert_array_equal(upper, corner + edges)  # as the cell beside it has it
    np.testing.assert_allclose(upper, q_d + half, rtol=1e-15)
    np.testing.assert_array_equal(corner, q_d - half)
    np.testing.assert_array_equal(edges, 2.0 * half)
