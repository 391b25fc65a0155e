"""That cells of a box cover it, that parts lie in its tube, which boxes touch: by what is asked, call by call."""

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("flint")

from flint import arb, arb_mat

from ccpin.auditing import boxes, gluing, workspace
from ccpin.auditing.boxes import Box, Looked
from ccpin.auditing.reading import ClaimedCells, ClaimedRequirements, Counts, Faces
from ccpin.auditing.tiling import WHOLE, Over
from tests.support.rows import Quadratic, Rows, exact


def box_of(half, radius=(1.0,)):
    m, n = len(radius), len(half)
    directions = np.vstack([np.eye(n), np.zeros((m, n))])
    return Box(
        [arb(0)] * (n + m), exact(directions), exact(np.eye(m)), [arb(r) for r in radius], np.array(half),
        np.arange(n, n + m),
    )  # fmt: skip


class Asked:
    """Answers and what was asked."""

    def __init__(self, answer):
        self.answer, self.calls = answer, []

    def __call__(self, *args, **more):
        self.calls.append((*args, *more.values()))
        return self.answer(*args, **more)


def leaves(half, small):
    """The cells of a box halved along its longest edge until one is small, in their order."""
    waiting, found = [(-half, half)], []
    while waiting:
        low, high = waiting.pop()
        if small(low, high):
            found.append((low.tolist(), high.tolist()))
            continue
        axis = int(np.argmax(high - low))
        below, above = high.copy(), low.copy()
        below[axis] = above[axis] = 0.5 * (low[axis] + high[axis])
        waiting += [(low, below), (above, high)]
    return found


def small(low, high):
    return np.max(high - low) <= (0.3 if low[0] < 0.0 else 1.1)


HALF = np.array([1.0, 0.75])


def test_the_cells_of_a_box_cover_it(monkeypatch):
    """Each is half of another; the tube is narrowed from a fourth of the cuts on."""
    asked = Asked(lambda closures, box, cell, narrowing: small(*cell))
    monkeypatch.setattr(boxes, "holds", asked)
    monkeypatch.setattr(boxes, "_misses", lambda *_: pytest.fail("all holds"))
    assert boxes.box_proved(None, box_of(HALF), 12) is True
    held = [(cell[0].tolist(), cell[1].tolist()) for _, _, cell, _ in asked.calls if small(*cell)]
    assert held == leaves(HALF, small)
    for _, _, (low, high), narrowing in asked.calls:
        cuts = np.log2(np.prod(2.0 * HALF) / np.prod(high - low))
        assert narrowing == (round(cuts) >= 3)


@pytest.mark.parametrize(("cuts", "looks", "places"), [(2, 4096, 3), (0, 4096, 1), (5, 2, 2)])
@pytest.mark.parametrize("misses", [True, False])
def test_a_box_that_is_not_cut_deep_enough_is_not_proved(monkeypatch, cuts, looks, places, misses):
    """Refuted, where a middle of a cell is; after so many cuts, or looks."""
    asked, missed = Asked(lambda *_, **__: False), Asked(lambda *_: misses)
    monkeypatch.setattr(boxes, "_LOOKS", looks)
    monkeypatch.setattr(boxes, "holds", asked)
    monkeypatch.setattr(boxes, "_misses", missed)
    assert boxes.box_proved(None, box_of(HALF), cuts) is (False if misses else None)
    assert len(asked.calls) == places
    low, high = asked.calls[-1][2]
    np.testing.assert_array_equal([call[2] for call in missed.calls], [0.5 * (low + high)])


@pytest.mark.parametrize("radius", [(0.0, 1.0), (1.0, 0.0), (-1.0, 1.0)])
def test_a_tube_without_a_width_is_none(radius):
    assert boxes.box_proved(None, box_of([1.0], radius), 3) is False


def test_a_tube_misses_where_it_was_proved_to_hold_none():
    box = box_of([1.0])
    for c, misses in ((0.9, False), (1.1, True)):
        assert boxes._misses(Quadratic(c=c), box, np.zeros(1)) == misses
    assert boxes._misses(Quadratic(c=0.5, g=1.0), box, np.array([0.6]))
    assert not boxes._misses(Quadratic(c=0.5, g=1.0), box, np.array([0.4]))
    assert not boxes._misses(Rows([9.0], [[1.0, 0.0]]), box, np.zeros(1))  # no Ã


def looked(most, least, none=False, offset=0.0, carried=0.0, m=1):
    return Looked(most, least, none, np.full(m, offset), np.full((m, m), carried))


@pytest.mark.parametrize(
    ("tube", "narrowing", "narrowed", "part", "good"),
    [
        (None, True, True, looked(True, True), False),
        (looked(True, True), False, False, None, True),
        (looked(False, True), False, True, looked(True, True), False),
        (looked(False, True), True, False, looked(True, True), False),
        (looked(False, True), True, True, None, True),
        (looked(True, False), False, False, looked(False, True), True),
        (looked(True, False), True, True, looked(True, False), False),
        (looked(True, False), True, True, None, False),
    ],
)
def test_one_at_most_in_the_tube_and_one_at_least_in_a_part(monkeypatch, tube, narrowing, narrowed, part, good):
    answers = [tube]
    monkeypatch.setattr(boxes, "look", lambda *_: answers.pop() if answers else part)
    monkeypatch.setattr(boxes, "_one_in_tube", lambda *_: narrowed)
    monkeypatch.setattr(boxes, "_solution", lambda *_: np.zeros(1))
    assert boxes.holds(None, box_of([1.0]), (np.array([-1.0]), np.array([1.0])), narrowing) == good


def test_parts_lie_in_the_tube_and_are_made_by_their_images(monkeypatch):
    """About what is taken for the solution over the cell's middle: the whole of its room first, then 1.05 images."""
    cell, middle = (np.array([-0.5]), np.array([1.0])), np.array([0.25, -0.5])
    found = Looked(True, False, False, np.array([0.1, 0.2]), np.array([[0.1, 0.05], [2.0, 0.1]]))
    asked, sought = Asked(lambda *_: found), Asked(lambda *_: middle)
    monkeypatch.setattr(boxes, "look", asked)
    monkeypatch.setattr(boxes, "_solution", sought)
    assert not boxes.holds(None, box_of([1.0], (1.0, 2.0)), cell, False)
    assert sought.calls[0][2].tolist() == [0.25]
    assert len(asked.calls) == 1 + boxes._PARTS
    assert asked.calls[0][3].tolist() == [0.0, 0.0]
    assert asked.calls[0][4].tolist() == [1.0, 2.0]
    room = np.array([0.75, 1.5])
    part = room
    for _, _, _, at, size in asked.calls[1:]:
        assert at is middle
        np.testing.assert_allclose(size, part, rtol=1e-14)
        assert np.all(size <= room)
        part = np.minimum(room, 1.05 * (found.offset + found.carried @ part))
    for at in ([1.0, 0.0], [0.0, -2.0], [1.5, 0.0]):
        middle = np.array(at)
        asked.calls.clear()
        assert not boxes.holds(None, box_of([1.0], (1.0, 2.0)), cell, False)
        assert len(asked.calls) == 1


def test_a_tube_is_tried_at_its_ends(monkeypatch):
    """A fourth of each side, in six rounds; what was not shown to hold none stays."""
    asked = Asked(lambda *_: looked(False, False))
    monkeypatch.setattr(boxes, "look", asked)
    cell = np.zeros(1), np.zeros(1)
    assert not boxes._one_in_tube(None, None, cell, np.array([1.0, 2.0]))
    ends = [(at - part, at + part) for _, _, _, at, part in asked.calls]
    assert len(ends) == 6 * 5
    for k in range(6):
        expected = [
            ([-1, -2], [-0.5, 2]), ([0.5, -2], [1, 2]), ([-1, -2], [1, -1]), ([-1, 1], [1, 2]), ([-1, -2], [1, 2]),
        ]  # fmt: skip
        np.testing.assert_allclose(ends[5 * k : 5 * k + 5], expected, atol=1e-12)
    monkeypatch.setattr(boxes, "look", lambda *_: None)
    assert not boxes._one_in_tube(None, None, cell, np.array([1.0]))


@pytest.mark.parametrize("m", [1, 2])
def test_solutions_stay_in_what_is_left_of_a_tube(monkeypatch, m):
    """Looks that tell exactly which parts hold no solution: of two in the tube none is lost."""
    rng = np.random.default_rng(m)
    cell = np.zeros(1), np.zeros(1)
    for count, one in ((1, True), (2, False)):
        for _ in range(30):
            roots = rng.uniform(-1.0, 1.0, (count, m))

            def exactly(closures, box, cell, middle, part, roots=roots):
                held = np.sum(np.all(np.abs(roots - middle) <= part, axis=1))
                return looked(held == 1 and np.max(part) < 0.9, False, held == 0, m=m)

            monkeypatch.setattr(boxes, "look", exactly)
            assert boxes._one_in_tube(None, None, cell, np.ones(m)) == one


def test_looks_move_the_dependent_coordinates():
    """E puts V's rows where y is."""
    box = Box(
        [arb(0)] * 3,
        exact(np.eye(3)[:, :1]),
        exact([[1.0, 2.0], [3.0, 4.0]]),
        [arb(1)] * 2,
        np.ones(1),
        np.array([2, 0]),
    )
    whole = boxes.embedded(box, exact([[1.0], [10.0]]))
    assert [float(x) for x in whole] == [43.0, 0.0, 21.0]


# Which boxes touch


def cells(wrapped=(False, False), upper=(4.0, 1.0)):
    """Three cells: the left half and the right half's lower and upper halves; a fourth way around if wrapped."""
    half, whole = WHOLE // 2, WHOLE
    return SimpleNamespace(
        place=np.array([[0, 0], [half, 0], [half, half]]),
        size=np.array([[half, whole], [half, half], [half, half]]),
        lower=np.array([-2.0, 0.0]),
        upper=np.array([-2.0, 0.0]) + upper,
        wrapped=np.array(wrapped),
        centre=np.zeros((3, 1)),
        over=Over(np.array([7, 8, 9]), np.array([1, 0, 2])),
        counts=None,
    )


def touching(document):
    return sorted((c.first, c.second, *c.middle.tolist(), *c.turn.tolist()) for c in gluing.contacts(document))


def test_boxes_touch_over_shared_faces_once():
    beside = [(0, 1, 0.0, 0.25, 0.0, 0.0), (0, 2, 0.0, 0.75, 0.0, 0.0)]
    above = [(1, 2, 1.0, 0.5, 0.0, 0.0)]
    assert touching(cells()) == sorted(beside + above)
    around = [(1, 0, 2.0, 0.25, 4.0, 0.0), (2, 0, 2.0, 0.75, 4.0, 0.0)]
    assert touching(cells((True, False))) == sorted(beside + above + around)
    over = [(0, 0, -1.0, 1.0, 0.0, 1.0), (2, 1, 1.0, 1.0, 0.0, 1.0)]
    assert touching(cells((False, True))) == sorted(beside + above + over)
    corner = cells()
    corner.place[2], corner.size[2] = [0, WHOLE // 2], WHOLE // 2
    corner.size[0] = WHOLE // 2
    assert touching(corner) == sorted([(0, 1, 0.0, 0.25, 0.0, 0.0), (0, 2, -1.0, 0.5, 0.0, 0.0)])
    held = cells(upper=(4.0, 0.0))
    assert touching(held) == [(0, 1, 0.0, 0.0, 0.0, 0.0), (0, 2, 0.0, 0.0, 0.0, 0.0)]


def test_boxes_that_share_an_edge_do_not_touch():
    """Beside each other along x and above each other along y, at the same z."""
    half = WHOLE // 2
    document = SimpleNamespace(
        place=np.array([[0, 0, 0], [half, half, 0]]),
        size=np.array([[half, half, WHOLE], [half, half, WHOLE]]),
        lower=np.zeros(3),
        upper=np.ones(3),
        wrapped=np.zeros(3, dtype=bool),
    )
    assert touching(document) == []
    document.size[0, 1] = WHOLE
    assert touching(document) == [(0, 1, 0.5, 0.75, 0.5, 0.0, 0.0, 0.0)]


def test_faces_of_two_sheets_are_between_certified_cells():
    """Boxes 0, 1, 2 over cells 8, 7, 9."""
    document = cells()
    for certified, glued, expected in (
        ([True, True, True], [], {(0, 1), (0, 2), (1, 2)}),
        ([True, True, True], [(0, 1)], {(0, 2), (1, 2)}),
        ([True, True, True], [(0, 1), (0, 2)], set()),
        ([False, True, True], [], {(0, 2)}),
        ([True, False, True], [], {(1, 2)}),
        ([True, True, False], [], {(0, 1)}),
    ):
        numbers = ClaimedCells(np.array([7, 8, 9]), None, None)
        document.counts = Counts(numbers, None, np.array(certified), None, None)
        first, second = np.array(glued, dtype=int).reshape(-1, 2).T
        faces = Faces(first, second, None, None)
        assert {(c.first, c.second) for c in gluing.apart(document, faces)} == expected
    document.counts = None
    assert not list(gluing.apart(document, Faces(first[:0], second[:0], None, None)))


class Placed:
    """Where a solution is sought and found, and what tubes say."""

    def __init__(self, monkeypatch, found, first=True, second=True):
        self.sought, self.asked = [], []
        self.document = SimpleNamespace(
            centre=np.array([[1.0, 2.0, 5.0], [4.0, 4.0, 4.0]]),
            directions=np.array([[[1.0, 0.0], [0.0, 1.0], [0.5, 0.25]], np.zeros((3, 2))]),
            independent=np.array([0, 1]),
            dependent=np.array([2]),
        )
        monkeypatch.setattr(gluing, "near", lambda c, dependent, theta: self.sought.append(theta) or found)
        monkeypatch.setattr(gluing, "in_tube", self.tell)
        self.answers = {0: first, 1: second}

    def tell(self, document, k, theta, radius, turn):
        self.asked.append((k, theta, radius, turn.tolist()))
        return self.answers[k]


@pytest.mark.parametrize(("first", "second", "same"), [
    (True, True, True), (True, False, False), (True, None, None), (None, True, None), (False, True, None),
])  # fmt: skip
def test_two_boxes_carry_one_solution_where_both_hold_it(monkeypatch, first, second, same):
    at = Placed(monkeypatch, ("θ", 0.5), first, second)
    contact = gluing.SharedFace(0, 1, np.array([1.5, 1.0]), np.array([4.0, 0.0]))
    assert gluing.same_solution(None, at.document, contact) is same
    np.testing.assert_array_equal(at.sought, [[1.5, 1.0, 5.0 + 0.25 - 0.25]])
    assert at.asked == [(0, "θ", 0.5, [0.0, 0.0]), (1, "θ", 0.5, [4.0, 0.0])][: 2 if first else 1]
    assert gluing.same_solution(None, Placed(monkeypatch, None).document, contact) is None


def test_a_solution_is_sought_over_the_place_itself(monkeypatch):
    """θ_c + D(q − q_c), q as it is."""
    at = Placed(monkeypatch, None)
    at.document.directions[0, 1, 1] = 0.0
    gluing.solution(None, at.document, 0, np.array([1.25, 3.0]))
    np.testing.assert_array_equal(at.sought, [[1.25, 3.0, 5.375]])


@pytest.mark.parametrize(
    ("gap", "reach", "sure"), [(3.0, 3.28, True), (3.0, 3.29, False), (-6.0, 0.25, True), (-6.1, 0.2, False)]
)
def test_angles_are_beyond_a_tube_where_other_turns_are_too(gap, reach, sure):
    for periodic in ([True, True], [False, True], [True, False], [False, False]):
        document = SimpleNamespace(dependent=np.array([1, 2]), periodic=np.array([False, *periodic]))
        for gaps in ((gap, 0.0), (0.0, gap)):
            turns = [p for p, g in zip(periodic, gaps, strict=True) if g]
            told = gluing._by_turns(document, [arb(g) for g in gaps], [arb(0, reach if g else 0.1) for g in gaps])
            assert told == (sure or not turns[0])


# Demands


def a_workspace(lower=(-9.0, -9.0), upper=(9.0, 9.0), driven=(1,), dexterity=0.0, units=(1.0,), half=1.0, radius=0.25):
    return SimpleNamespace(
        demands=ClaimedRequirements(
            np.array(lower), np.array(upper), np.array(driven, dtype=int), np.array(units), dexterity
        ),
        independent=np.array([0]),
        dependent=np.array([1]),
        centre=np.array([[1.0, 2.0]]),
        directions=np.array([[[1.0], [0.5]]]),
        modes=np.array([[[2.0]]]),
        radius=np.array([[radius]]),
        half=np.array([[half]]),
        periodic=np.array([False, False]),
    )


def test_boxes_reach_d_h_and_e_r():
    """|θ − θ_c| ≤ |D|h + |E|R: q up to 1, y up to 0.5 + 0.5 from the middle."""
    document = a_workspace()
    low, high = np.array([-0.5]), np.array([1.0])
    reached = workspace._reached(boxes.box_of(document, 0), low, high)
    for ball, ends in zip(reached, ((0.5, 2.0), (2.0 - 0.25 - 0.5, 2.0 + 0.5 + 0.5)), strict=True):
        assert (float(ball.lower()), float(ball.upper())) == pytest.approx(ends, abs=1e-6)


@pytest.mark.parametrize("k", [0, 1])
def test_limits_are_kept_by_all_coordinates(k):
    theta = [arb(1.0, 0.5), arb(-2.0, 0.5)]
    ends = np.array([[0.5, 1.5], [-2.5, -1.5]])
    for low, high, good in ((1e-6, 1e-6, True), (-1e-6, 1e-6, False), (1e-6, -1e-6, False)):
        limits = ends + 1e-6 * np.array([-1.0, 1.0])
        limits[k] = ends[k, 0] - low, ends[k, 1] + high
        assert workspace._within(ClaimedRequirements(limits[:, 0], limits[:, 1], None, None, 0.0), theta) == good


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("value", [2.0, -2.0])
def test_a_box_is_beyond_a_limit_where_its_solution_is(monkeypatch, side, value):
    """By more than the radius in which that is proved to be, of the coordinate it is, and in the box's own tube."""
    found, held = (np.array([7.0, value, 1.0]), 0.125), [True]
    monkeypatch.setattr(workspace, "near", lambda *_: found)
    monkeypatch.setattr(workspace, "in_tube", lambda *_: held[0])
    for off, beyond in ((0.126, True), (0.124, False), (-0.5, False)):
        ends = np.array([[-9.0, -9.0, -9.0], [9.0, 9.0, 9.0]])
        ends[1 if side > 0 else 0, 1] = value - side * off
        document = SimpleNamespace(
            demands=ClaimedRequirements(ends[0], ends[1], None, None, 0.0),
            independent=np.array([0]),
            dependent=np.array([1, 2]),
            centre=np.zeros((1, 3)),
        )  # fmt: skip
        assert workspace._beyond(None, document, 0) == beyond
        held[0] = None
        assert not workspace._beyond(None, document, 0)
        held[0] = True
    monkeypatch.setattr(workspace, "near", lambda *_: None)
    assert not workspace._beyond(None, document, 0)
    document.demands = None
    assert not workspace._beyond(None, document, 0)


@pytest.mark.parametrize(
    ("changed", "beyond", "good"),
    [
        ({}, False, True),
        ({"upper": (9.0, 2.9)}, True, False),
        ({"upper": (9.0, 2.9)}, False, None),
        ({"driven": ()}, False, True),
        ({"driven": (0, 1)}, False, False),
    ],
)
def test_what_is_met(monkeypatch, changed, beyond, good):
    monkeypatch.setattr(workspace, "_beyond", lambda *_: beyond)
    monkeypatch.setattr(workspace, "_holds", lambda *_: True)
    assert workspace.met(Quadratic(), a_workspace(**changed), 0, 3) is good


def test_the_cells_of_a_box_meet_all_demands(monkeypatch):
    """Halved along what moves θ most, until each does; or not proved."""
    document = SimpleNamespace(
        demands=ClaimedRequirements(np.full(3, -9.0), np.full(3, 9.0), np.array([0, 1]), None, 0.0),
        independent=np.array([0, 1]),
        dependent=np.array([2]),
        centre=np.zeros((1, 3)),
        directions=np.array([[[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]]]),
        modes=np.array([[[1.0]]]),
        radius=np.array([[0.1]]),
        half=HALF[None],
    )
    asked = Asked(lambda slopes, said: small(*slopes))
    monkeypatch.setattr(workspace, "_Slopes", lambda closures, document, box, cell: cell)
    monkeypatch.setattr(workspace, "_holds", asked)
    assert workspace.met(None, document, 0, 12) is True
    half = boxes.box_of(document, 0).half
    held = [(cell[0].tolist(), cell[1].tolist()) for cell, _ in asked.calls if small(*cell)]
    assert held == leaves(half, small)
    for cuts, looks, count in ((2, 4096, 3), (0, 4096, 1), (5, 2, 2)):
        asked = Asked(lambda *_: False)
        monkeypatch.setattr(boxes, "_LOOKS", looks)
        monkeypatch.setattr(workspace, "_holds", asked)
        assert workspace.met(None, document, 0, cuts) is None
        assert len(asked.calls) == count
    document.directions[0, 2] = [0.5, 4.0]  # the second moves θ more
    asked = Asked(lambda cell, said: small(*cell))
    monkeypatch.setattr(boxes, "_LOOKS", 4096)
    monkeypatch.setattr(workspace, "_holds", asked)
    assert workspace.met(None, document, 0, 12) is True
    np.testing.assert_allclose(asked.calls[1][0], [[-half[0], 0.0], half])


def slopes_of(closures, document, low=-0.5, high=1.0):
    return workspace._Slopes(closures, document, boxes.box_of(document, 0), (np.array([low]), np.array([high])))


def test_slopes_are_enclosed_as_far_as_they_go():
    """For φ of second degree: at the middle ± what it changes by along D and E."""
    closures, document = Quadratic(g=0.5, a=0.25, b=0.125, d=-0.5), a_workspace()
    document.modes = np.array([[[-2.0]]])
    slopes = slopes_of(closures, document)
    theta = np.array([1.0, 2.0]) + 0.25 * np.array([1.0, 0.5])
    at = closures.line + closures.bend @ theta
    along, aside = closures.bend @ [1.0, 0.5], closures.bend @ [0.0, -2.0]
    found = slopes.between(exact([[3.0]]), exact(np.eye(2)))
    for ball, middle, reach in zip(
        found.entries(), 3 * at, 3 * (np.abs(along) * 0.75 + np.abs(aside) * 0.25), strict=True
    ):
        assert float(ball.mid()) == pytest.approx(middle)
        assert float(ball.rad()) == pytest.approx(reach, rel=1e-6)
    beyond = slopes_of(closures, document, 1.0, 1.5).between(exact([[3.0]]), exact(np.eye(2)))
    for ball, reach in zip(beyond.entries(), 3 * (np.abs(along) * 0.25 + np.abs(aside) * 0.25), strict=True):
        assert float(ball.rad()) == pytest.approx(reach, rel=1e-6)
    mixed = slopes.between(exact([[3.0]]), exact([[1.0], [2.0]])).entries()[0]
    assert float(mixed.rad()) == pytest.approx(3 * (abs(along @ [1, 2]) * 0.75 + abs(aside @ [1, 2]) * 0.25), rel=1e-6)


class Cubic(Quadratic):
    """φ = y³/6, of which the slope as evaluated is closer than by its change; unless it is evaluated worse."""

    def __init__(self, far=0.0):
        super().__init__()
        self.far = far

    def jacobian(self, motions):
        wide = motions[1].rad() > 0
        return arb_mat(1, 2, [arb(0), motions[1] * motions[1] / 2 + (arb(0, self.far) if wide else 0)])

    def variation(self, motions, direction):
        return arb_mat(1, 2, [arb(0), motions[1] * direction[1]])


def test_of_two_enclosures_the_narrower_is_taken():
    document = a_workspace(radius=0.25)
    document.directions[0, 1] = 0.0  # y = 2 ± 0.5
    for closures, middle, reach in ((Cubic(), 2.0, 1.125), (Cubic(far=2.0), 2.0, 1.25)):
        (_, ball) = slopes_of(closures, document, -1.0, 1.0).between(exact([[1.0]]), exact(np.eye(2))).entries()
        assert (float(ball.mid()), float(ball.rad())) == pytest.approx((middle, reach), rel=1e-6)


@pytest.mark.parametrize("driven", [(0,), (1,)])
def test_motors_hold_where_the_others_are_determined(monkeypatch, driven):
    """φ = g q + y: driven by q, y is determined; by y, q where g ≠ 0; with dexterity, 2 and 3 besides."""
    for g, others in ((1.0, True), (0.0, driven == (0,))):
        document = a_workspace(driven=driven)
        slopes = slopes_of(Quadratic(g=g), document)
        assert workspace._holds(slopes, document.demands) == others
        if others:
            for found, dexterous, good in ((None, True, False), ((1, 2), False, False), ((1, 2), True, True)):
                monkeypatch.setattr(workspace, "_derivative", lambda slopes, found=found: found)
                monkeypatch.setattr(workspace, "_dexterous", lambda *_, answer=dexterous: answer)
                assert workspace._holds(slopes, document.demands) is True
                assert workspace._holds(slopes, document.demands._replace(dexterity=0.1)) is good


def test_motors_hold_up_to_where_the_others_slope_may_vanish():
    for b, good in ((0.9, True), (1.1, False)):
        document = a_workspace(driven=(0,), half=1.0)
        document.centre[:], document.directions[0, 1], document.radius[:] = 0.0, 0.0, 0.0
        assert workspace._holds(slopes_of(Quadratic(b=b), document, -1.0, 1.0), document.demands) == good


def test_derivatives_are_within_t():
    """T = F/(1 − M), a millionth more; for a line the least number there is."""
    document = a_workspace(radius=0.0)
    document.centre[:], document.directions[0, 1] = 0.0, 0.0
    g, a, b = 0.5, 0.25, 0.125
    X, T = workspace._derivative(slopes_of(Quadratic(g=g, a=a, b=b), document, -1.0, 1.0))
    assert X[0, 0] == pytest.approx(-g)
    assert T[0, 0] == pytest.approx((a - b * g) / (1 - b) * (1 + 1e-6), rel=3e-8)
    X, T = workspace._derivative(slopes_of(Quadratic(g=g), document, -1.0, 1.0))
    assert (X[0, 0], T[0, 0]) == (-g, 1e-300)
    assert workspace._derivative(slopes_of(Quadratic(b=1.1), document, -1.0, 1.0)) is None


@pytest.mark.parametrize(("factor", "good"), [(1.0, True), (0.99, False), (0.0, False), (np.nan, False), (-1.0, False)])
@pytest.mark.parametrize("b", [0.125, 0.0])
def test_a_t_that_is_proposed_is_checked(monkeypatch, factor, good, b):
    solve = np.linalg.solve
    monkeypatch.setattr(np.linalg, "solve", lambda A, B: factor * solve(A, B))
    document = a_workspace(radius=0.0)
    document.centre[:], document.directions[0, 1] = 0.0, 0.0
    slopes = slopes_of(Quadratic(g=0.5, a=0.25, b=b), document, -1.0, 1.0)
    monkeypatch.setattr(workspace, "contracts", lambda matrix: True)
    assert (workspace._derivative(slopes) is not None) == good


@pytest.mark.parametrize("row", [0, 1])
def test_a_t_that_is_proposed_is_checked_in_every_row(monkeypatch, row):
    closures = Rows([0.0, 0.0], [[0.5, 1.0, 0.0], [0.5, 0.0, 1.0]], np.eye(3)[[0, 0]][:, :, None] * np.eye(3)[0])
    document = SimpleNamespace(
        independent=np.array([0]), dependent=np.array([1, 2]), centre=np.zeros((1, 3)), half=np.ones((1, 1)),
        directions=np.eye(3)[None, :, :1], modes=np.eye(2)[None], radius=np.zeros((1, 2)),
    )  # fmt: skip
    slopes = slopes_of(closures, document, -1.0, 1.0)
    solve, factor = np.linalg.solve, np.ones((2, 1))
    monkeypatch.setattr(np.linalg, "solve", lambda A, B: solve(A, B) * (factor if B.ndim == 2 else 1.0))
    assert workspace._derivative(slopes) is not None
    factor[row] = 0.9
    assert workspace._derivative(slopes) is None


def dexterous(X, T, dexterity, units, driven):
    n = X.shape[1]
    document = SimpleNamespace(independent=np.arange(n), dependent=np.arange(n, n + len(X)))
    said = ClaimedRequirements(None, None, np.array(driven), np.array(units), dexterity)
    return workspace._dexterous(said, document, X, T)


def test_dexterity_is_by_singular_values_and_their_errors():
    """K = diag(x) by units; at least (min − e)/(max + e)."""
    X, T = np.diag([3.0, 8.0]), np.array([[0.3, 0.0], [0.0, 0.4]])
    for units, K, e in (((1.0, 1.0), (3.0, 8.0), 0.5), ((0.5, 2.0), (6.0, 4.0), np.hypot(0.6, 0.2))):
        least = (min(K) - e) / (max(K) + e)
        assert dexterous(X, T, least * (1.0 - 1e-9), units, [2, 3])
        assert not dexterous(X, T, least * (1.0 + 1e-9), units, [2, 3])
    assert dexterous(X, T, 1.0 - 1e-9, (1.0, 1.0), [0, 1])  # x itself is driven


@pytest.mark.parametrize("which", [None, "U", "V", "S", "UV"])
def test_a_decomposition_that_is_proposed_is_checked(monkeypatch, which):
    """Of U, V and S that are off by known amounts: 3."""
    svd, n = np.linalg.svd, 2
    off = 0.1

    def proposed(K):
        U, S, Vt = svd(K)
        U = U * (1 + off) if which in ("U", "UV") else U
        Vt = Vt * (1 - off) if which in ("V", "UV") else Vt
        return U, S + off * (which == "S"), Vt

    monkeypatch.setattr(np.linalg, "svd", proposed)
    K = np.array([2.0, 5.0])
    X, T = np.diag(K), np.zeros((n, n))
    u = np.sqrt(2) * abs((1 + off) ** 2 - 1) if which in ("U", "UV") else 0.0
    v = np.sqrt(2) * abs((1 - off) ** 2 - 1) if which in ("V", "UV") else 0.0
    scale = (1 + off if which in ("U", "UV") else 1.0) * (1 - off if which in ("V", "UV") else 1.0)
    S = K + off * (which == "S")
    g = np.linalg.norm(scale * K - S)
    least = (S.min() - g) / np.sqrt((1 + u) * (1 + v))
    most = (S.max() + g) / np.sqrt((1 - u) * (1 - v))
    assert dexterous(X, T, least / most * (1 - 1e-9), (1.0, 1.0), [2, 3])
    assert not dexterous(X, T, least / most * (1 + 1e-9), (1.0, 1.0), [2, 3])


@pytest.mark.parametrize("which", [0, 2])
@pytest.mark.parametrize(("size", "good"), [(1.29, True), (1.31, False)])
def test_a_decomposition_far_from_orthogonal_proves_nothing(monkeypatch, which, size, good):
    """√2 |s² − 1| reaches 1 at s = 1.3066."""
    svd = np.linalg.svd

    def proposed(K):
        parts = list(svd(K))
        parts[which] = parts[which] * size
        parts[1] = parts[1] * size
        return parts

    monkeypatch.setattr(np.linalg, "svd", proposed)
    assert dexterous(np.diag([2.0, 2.0]), np.zeros((2, 2)), 1e-9, (1.0, 1.0), [2, 3]) == good
