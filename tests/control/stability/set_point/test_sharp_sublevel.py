"""Claims about levels where U is known: the least on the boundary, attained; every hypothesis just met, or not."""

from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.stability.set_point import set_point_cells as module
from ccpin.control.stability.set_point.set_point_cells import CellPart, SlopeBounded, glued_pairs, without
from ccpin.control.stability.set_point.sublevel_claim import SublevelProved, exposed
from ccpin.control.stability.set_point.well import Range, Well
from ccpin.proof.facts import NotProvedError
from ccpin.proof.newton import reached
from ccpin.proof.solutions import GluedBoxes, Met, SolutionsInBoxes
from tests.support.flat_cells import boxes_about

FLAT = np.diag([2.0, 80.0])  # U = x² + 40y²


class Made:
    """A claim about unit cells about whole numbers, glued where they touch, whose wells are told."""

    def __init__(self, monkeypatch, centres, half=0.5, q_d=None):
        self.centres = np.array(centres, float)
        n = self.centres.shape[1]
        self.half = np.broadcast_to(np.array(half, float), self.centres.shape)
        self.lower, self.upper = self.centres - self.half, self.centres + self.half
        self.boxes = boxes_about(self.centres, self.half)
        self.q_d, self.gain, self.known, self.asked = np.zeros(n) if q_d is None else np.array(q_d), 9.0, None, []
        self.beta = self.effort = self.shift = lambda centre: 1.0
        self.shift, self.told, self.over = lambda centre: 0.0, None, None
        self.pairs = [
            (i, j)
            for i, j in product(range(len(self.centres)), repeat=2)
            if i < j and np.all(np.abs(self.centres[i] - self.centres[j]) <= self.half[i] + self.half[j] + 1e-9)
        ]
        self.turns, self.misjudged = {}, 0.0
        monkeypatch.setattr(module, "gravity_bounds", lambda *given: given)
        monkeypatch.setattr(module, "wells", self._wells)
        monkeypatch.setattr(module, "encloses", self._encloses)

    def _wells(self, law, centres, half, directions, bounds):
        assert bounds[:2] == ("problem", "potential")
        np.testing.assert_array_equal(centres, self.boxes.centre[:, : len(self.q_d)])
        np.testing.assert_array_equal(half, self.boxes.half)
        assert directions is self.boxes.directions or np.array_equal(directions, self.boxes.directions)
        if self.told is not None:
            return self.told
        H = FLAT[: len(self.q_d), : len(self.q_d)]
        value = [0.5 * c @ H @ c + self.shift(c) for c in centres]
        return [Well(c, v, H @ c, H, 0.0, self.beta(c), self.effort(c)) for c, v in zip(centres, value, strict=True)]

    def _encloses(self, problem, boxes, delta, theta, error):
        self.asked.append((boxes.centre[:, : len(self.q_d)] + delta, theta, error))
        return np.ones(len(delta), bool) if self.known is None else np.array(self.known)

    def claim(self):
        n = len(self.q_d)
        system = SimpleNamespace(independent=np.arange(n), n=n)
        problem = SimpleNamespace(system=system)
        law = SimpleNamespace(q_d=self.q_d)
        closures = SimpleNamespace(system=system, problem=Named("problem", system))
        equations = SimpleNamespace(
            closures=closures,
            law=law,
            gain=self.gain,
            theta=np.full(n + 1, 7.0),
            potential="potential",
            misjudged=self.misjudged,
        )
        assert problem.system is closures.system
        if self.over is not None:
            return SlopeBounded(equations, self.lower, self.upper, *np.array(self.over, float))
        return SublevelProved(equations, self.lower, self.upper)

    def premises(self):
        solutions = SimpleNamespace(claim=SolutionsInBoxes(None, *self.boxes))
        first, second = np.array(self.pairs, dtype=np.int64).reshape(-1, 2).T
        turn = np.array([self.turns.get(pair, (0,) * len(self.q_d)) for pair in self.pairs], dtype=np.int64)
        at = np.zeros((len(first), len(self.q_d)))
        glue = SimpleNamespace(
            claim=GluedBoxes(None, first, second, at, at), premises=(solutions,), found={"turn": turn.reshape(at.shape)}
        )
        return solutions, glue

    def found(self):
        proved, found = self.claim().examined(*self.premises())
        assert proved.tolist() == [True]
        return found

    def level(self):
        return float(self.found()["level"][0])

    def refused(self, match):
        with pytest.raises(NotProvedError, match=match):
            self.claim().examined(*self.premises())


class Named(str):
    """A word with a system."""

    def __new__(cls, word, system):
        own = super().__new__(cls, word)
        own.system = system
        return own


def block(monkeypatch, size=1, **more):
    """The cells about whole numbers from −size to size."""
    return Made(monkeypatch, list(product(range(-size, size + 1), repeat=2)), **more)


def at(made, *centre):
    return int(np.flatnonzero(np.all(made.centres == centre, axis=1))[0])


def test_the_level_is_the_least_value_on_the_boundary(monkeypatch):
    """Nine cells, [−1.5, 1.5]²: U is 2.25 at (±1.5, 0); of its cells three meet {U < 2.25}."""
    made = block(monkeypatch)
    made.beta = lambda c: 3.0 + abs(c[0]) if c[1] == 0.0 else 99.0
    found = made.found()
    assert found["level"][0] == pytest.approx(2.25, rel=1e-12)
    assert found["beta"][0] == 4.0
    np.testing.assert_array_equal(found["within"], made.centres[:, 1] == 0.0)
    ((q, theta, error),) = made.asked
    np.testing.assert_array_equal(q, [[0.0, 0.0]])
    np.testing.assert_array_equal(theta, [[7.0] * 3])
    np.testing.assert_array_equal(error, [[0.0]])


def test_cells_that_meet_the_level_count(monkeypatch):
    """Those in which U is not known to be at the level or above it."""
    made = block(monkeypatch)
    lift = 2.25 - 10.0  # of the cells about (·, ±1): their least U is 10 + lift
    for more, counted in ((0.0, False), (-1e-9, True), (1e-9, False)):
        made.shift = lambda c, more=more: lift + more if abs(c[1]) == 1.0 else 0.0
        made.beta = lambda c: 5.0 if abs(c[1]) == 1.0 else 1.0
        assert made.found()["beta"][0] == (5.0 if counted else 1.0)


def test_the_gain_condition_and_the_motors_grip(monkeypatch):
    """β < k and a positive effort in all cells that meet the set, in no other."""
    made = block(monkeypatch)
    for beta, held in ((9.0, False), (np.nextafter(9.0, 0.0), True), (np.nan, False), (99.0, False)):
        made.beta = lambda c, beta=beta: beta if c[0] == 1.0 and c[1] == 0.0 else 1.0
        made.level() if held else made.refused("gain condition")
        made.beta = lambda c, beta=beta: beta if c[1] != 0.0 else 1.0
        assert made.found()["beta"][0] == 1.0
    made.beta = lambda c: 1.0
    for effort, held in ((0.0, False), (1e-300, True), (-1.0, False), (np.nan, False)):
        made.effort = lambda c, effort=effort: effort if c[0] == 1.0 and c[1] == 0.0 else 1.0
        made.level() if held else made.refused("grip")
        made.effort = lambda c, effort=effort: effort if c[1] != 0.0 else 1.0
        made.level()


@pytest.mark.parametrize(("shift", "held"), [(-2.25, False), (-2.25 + 1e-12, True), (-3.0, False), (np.nan, False)])
def test_levels_are_above_zero(monkeypatch, shift, held):
    made = block(monkeypatch)
    made.shift = lambda c: shift if c[0] == 1.0 else 0.0
    assert made.level() == pytest.approx(1e-12, rel=1e-2) if held else made.refused("boundary") is None


@pytest.mark.parametrize("turn", [(1, 0), (0, -1), None])
def test_faces_at_which_cells_are_not_glued_on_the_line_are_boundary(monkeypatch, turn):
    """Between the cells about (0, 0) and (1, 0): U is ¼ at (½, 0). What is behind is reached by other ways."""
    made = block(monkeypatch)
    pair = tuple(sorted((at(made, 0, 0), at(made, 1, 0))))
    if turn is None:
        made.pairs.remove(pair)
    else:
        made.turns[pair] = turn
    found = made.found()
    assert found["level"][0] == pytest.approx(0.25, rel=1e-12)
    assert np.flatnonzero(found["within"]).tolist() == [at(made, 0, 0)]


def test_cells_that_no_chain_joins_to_the_set_point_do_not_count(monkeypatch):
    """Neither their boundary, where U is low, nor their slopes, nor what is below the level in them."""
    made = Made(monkeypatch, [(0.0, 0.0), (5.0, 0.0)])
    made.shift = lambda c: -25.0 if c[0] else 0.0
    made.beta = made.effort = lambda c: np.nan if c[0] else 1.0
    found = made.found()
    assert (found["level"][0], found["within"].tolist()) == (pytest.approx(0.25), [True, False])
    made.pairs = [(0, 1)]  # glued, and touching nowhere: none is behind a face of the other
    made.beta = made.effort = lambda c: 1.0
    made.shift = lambda c: 0.0
    found = made.found()
    assert (found["level"][0], found["within"].tolist()) == (pytest.approx(0.25), [True, False])


def test_a_gap_of_one_bit_is_boundary(monkeypatch):
    for side, by in ((0, np.inf), (1, -np.inf)):
        made = block(monkeypatch)
        k = at(made, 1, 0) if side == 0 else at(made, 0, 0)
        corners = made.lower if side == 0 else made.upper
        corners[k, 0] = np.nextafter(corners[k, 0], by)
        assert made.level() == pytest.approx(0.25, rel=1e-9)
        overlapping = block(monkeypatch)
        corners = overlapping.lower if side == 0 else overlapping.upper
        corners[k, 0] = np.nextafter(corners[k, 0], -by)
        assert overlapping.level() == pytest.approx(2.25, rel=1e-9)


class Edges:
    """A well whose least on parts of the face x = ½ is told by their ranges of y, and in a whole cell."""

    def __init__(self, least, whole):
        self.least, self.whole, self.beta, self.effort = least, whole, 1.0, 1.0

    def range_over(self, lower, upper):
        x, y = zip(lower, upper, strict=True)
        value = self.least(y) if x[0] == x[1] == 0.5 else 9.0 if x[0] == x[1] or y[0] == y[1] else self.whole
        return Range(value, value, lower)


def test_the_rest_of_a_face_is_boundary(monkeypatch):
    """To the right of [−½, ½]² one of two smaller cells is there: what is left of the face is the other half."""
    for y, least in ((-0.25, lambda y: 1.0 + y[0]), (0.25, lambda y: 1.0 - y[1])):
        made = Made(monkeypatch, [(0.0, 0.0), (0.75, y)], [(0.5, 0.5), (0.25, 0.25)])
        assert made.level() == pytest.approx(0.25, rel=1e-12)
        made.told = [Edges(least, 0.5), Edges(lambda y: 9.0, 9.0)]
        assert made.level() == 1.0


class Ends:
    """A well of one coordinate told at the ends of its cell, and its least."""

    def __init__(self, values, least):
        self.values, self.least, self.beta, self.effort = values, least, 1.0, 1.0

    def range_over(self, lower, upper):
        value = self.values[float(lower[0])] if lower[0] == upper[0] else self.least
        return Range(value, value, lower)


@pytest.mark.parametrize(
    ("values", "level", "within"),
    [
        ([3.0, 1.0, 1.0, 2.0], 2.0, [0, 1, 2]), ([3.0, 1.0, 2.0, 2.0], 2.0, [0, 1]),
        ([3.0, 1.0, 2.5, 2.0], 2.0, [0, 1]),
        ([3.0, 2.0, 1.0, 2.0], 2.0, [0]), ([1.5, 1.0, 1.0, 2.0], 1.5, [0, 1, 2]),
        ([3.0, 1.0, 1.9999999, 2.0], 2.0, [0, 1, 2]),
    ],
)  # fmt: skip
def test_what_is_joined_to_the_set_point(monkeypatch, values, level, within):
    """Across faces that hold a point below the level; the level is the least at the ends."""
    made = Made(monkeypatch, [[0.5], [1.5], [2.5]], q_d=[0.5])
    made.told = [Ends({float(k): values[k], k + 1.0: values[k + 1]}, 0.5) for k in range(3)]
    found = made.found()
    assert found["level"][0] == level
    assert np.flatnonzero(found["within"]).tolist() == within


def test_a_cell_that_does_not_meet_the_set_is_no_part_of_it(monkeypatch):
    """Though its neighbour says of the face between them that U is low there."""
    made = Made(monkeypatch, [[0.5], [1.5]], q_d=[0.5])
    made.told = [Ends({0.0: 2.0, 1.0: 1.0}, 0.5), Ends({1.0: 2.0, 2.0: 2.0}, 2.0)]
    assert made.found()["within"].tolist() == [True, False]


@pytest.mark.parametrize(("least", "held"), [(0.0, False), (5e-324, True), (-1e-9, False)])
def test_zero_is_no_level(monkeypatch, least, held):
    """Though U is not known to be above −1 where the set point is."""
    made = Made(monkeypatch, [[0.5]], q_d=[0.5])
    made.told = [Ends({0.0: least, 1.0: 2.0}, -1.0)]
    assert made.level() == least if held else made.refused("above 0 on the boundary") is None


def test_where_robots_of_a_set_come_to_rest(monkeypatch):
    """What g(q_d) is misjudged by over k − β, β of cells that may hold U as low as at q_d, which is to be below c."""
    made = block(monkeypatch)
    made.beta = lambda centre: 1.0 + np.abs(centre).sum()
    assert made.found()["rest"][0] == 0.0
    made.misjudged = 2.0
    found = made.found()
    assert found["beta"][0] > 1.0
    assert found["rest"][0] == pytest.approx(0.25, rel=1e-9)
    assert found["rest"][0] > 0.25
    made.told = [Ends({0.0: 2.0, 1.0: 1.0, 0.5: 1.5}, 0.5), Ends({1.0: 2.0, 2.0: 2.0}, 1.5)]
    made.boxes, made.centres = boxes_about(np.array([[0.5], [1.5]]), np.full((2, 1), 0.5)), np.array([[0.5], [1.5]])
    made.lower, made.upper, made.pairs, made.q_d = made.centres - 0.5, made.centres + 0.5, [(0, 1)], np.array([0.5])
    made.told[1].beta = 5.0
    assert made.found()["rest"][0] == pytest.approx(0.5, rel=1e-9)
    made.told[1].least = 1.5 + 1e-9
    assert made.found()["rest"][0] == pytest.approx(0.25, rel=1e-9)
    made.told[0].values[0.5] = 2.0
    made.refused("every robot")


def test_sheets_over_one_another_are_joined_where_they_are_glued(monkeypatch):
    """Two cells over [0, 1] that are glued to the same one beside them, not to one another."""
    made = Made(monkeypatch, [[0.5], [1.5], [0.5]], q_d=[0.5])
    made.pairs = [(0, 1), (1, 2)]
    made.told = [Ends({0.0: 3.0, 1.0: 2.5}, 0.5), Ends({1.0: 2.5, 2.0: 3.0}, 0.5), Ends({0.0: 2.0, 1.0: 2.5}, 0.5)]
    found = made.found()
    assert (found["level"][0], found["within"].tolist()) == (2.0, [True, False, False])


def test_cells_that_have_nothing_in_common_are_not_joined(monkeypatch):
    """Whatever is said of their boxes, which may reach further; apart in one coordinate or in both."""
    for far in ((5.0, 0.0), (5.0, 7.0)):
        made = Made(monkeypatch, [(0.0, 0.0), far])
        made.pairs, made.told = [(0, 1)], [Edges(lambda y: 9.0, 0.5)] * 2
        assert made.found()["within"].tolist() == [True, False]


# Slopes.


def sloping(monkeypatch, lower, upper, size=1):
    made = block(monkeypatch, size)
    made.over = ([lower], [upper])
    return made


def test_slopes_are_those_of_all_cells_that_are_joined(monkeypatch):
    """The largest β and the least effort, of the nine; where no way joins one it does not count."""
    made = sloping(monkeypatch, (-1.5, -1.5), (1.5, 1.5))
    made.beta = lambda c: 3.0 + c[0] + 0.5 * c[1]
    made.effort = lambda c: 5.0 - c[0] * c[1]
    found = made.found()
    assert (found["beta"][0], found["effort"][0]) == (4.5, 4.0)
    for beta in (np.nan, np.inf):
        made.beta = lambda c, beta=beta: beta if c[0] == 1.0 else 1.0
        made.refused("no bound")
    made.known = [False]
    made.refused("in no cell")
    far = Made(monkeypatch, [(0.0, 0.0), (5.0, 0.0)])
    far.over, far.beta = ([(-0.5, -0.5)], [(0.5, 0.5)]), lambda c: 1.0 + c[0]
    far.effort = lambda c: 2.0 - c[0]
    assert (far.found()["beta"][0], far.found()["effort"][0]) == (1.0, 2.0)
    far.over = ([(-0.5, -0.5), (4.5, -0.5)], [(0.5, 0.5), (5.5, 0.5)])
    far.refused("not covered")


@pytest.mark.parametrize(
    ("lower", "upper", "held"),
    [
        ((-1.5, -1.5), (1.5, 1.5), True), ((-1.5, -0.2), (-0.2, 0.7), True), ((0.25, 0.25), (0.75, 0.5), True),
        ((-1.5, -1.5), (np.nextafter(1.5, 2.0), 1.5), False), ((-1.5, np.nextafter(-1.5, -2.0)), (1.5, 1.5), False),
        ((1.4, 1.4), (1.6, 1.5), False), ((7.0, 7.0), (8.0, 8.0), False),
    ],
)  # fmt: skip
def test_cells_cover_what_slopes_are_bounded_over(monkeypatch, lower, upper, held):
    """To the last bit; a cell that is left out, or not joined, leaves a hole."""
    made = sloping(monkeypatch, lower, upper)
    made.found() if held else made.refused("not covered")
    if held:
        for centre in ((1.0, 0.0), (0.0, 0.0)):
            holed = sloping(monkeypatch, (-1.5, -1.5), (1.5, 1.5))
            k = at(holed, *centre)
            holed.pairs = [pair for pair in holed.pairs if k not in pair]
            holed.refused("not covered")


def test_what_is_left_of_a_box():
    """Without one that reaches in: the rest, in parts that do not overlap; along all axes if none are named."""
    whole = CellPart(np.zeros(2), np.ones(2))
    inner = CellPart(np.full(2, 0.25), np.array([0.5, 2.0]))
    parts = without(whole, inner)
    assert sum(np.prod(part.upper - part.lower) for part in parts) == pytest.approx(1.0 - 0.25 * 0.75)
    assert without(whole, CellPart(np.full(2, -1.0), np.full(2, 2.0))) == []
    assert without(whole, CellPart(np.ones(2), np.full(2, 2.0))) == [whole]


# Where the set point is.


def test_the_set_point_lies_in_a_cell_with_the_laws_configuration(monkeypatch):
    """On its edge, too; the first of those cells in which it is, if their tubes hold it."""
    for q_d, held in (([1.5, 0.0], True), ([np.nextafter(1.5, 2.0), 0.0], False), ([-1.5, 0.0], True),
                      ([np.nextafter(-1.5, -2.0), 0.0], False), ([0.0, 1.6], False)):  # fmt: skip
        made = block(monkeypatch, q_d=q_d)
        made.level() if held else made.refused("in no cell")
    made = block(monkeypatch, q_d=[0.5, 0.0])
    for known, held in (([True, True], True), ([False, True], True), ([False, False], False)):
        made.known = known
        made.level() if held else made.refused("in no cell")
    np.testing.assert_array_equal(made.asked[0][0], [[0.5, 0.0]] * 2)
    made.known = [False, True]
    assert made.claim().start(made.boxes) == at(made, 1, 0)
    made.told = [SimpleNamespace(range_over=lambda *_: Range(1.0, 1.0, None), beta=1.0, effort=1.0)] * 9
    made.refused("where q_d is")


# Cells and boxes.


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_cells_lie_in_their_boxes_as_widened(monkeypatch, side, axis):
    """To the last bit of what the theorem is about."""
    made = Made(monkeypatch, [(0.0, 0.0)], [(0.3, 0.7)])
    widened = reached(SimpleNamespace(n=2, independent=np.arange(2)), made.boxes)[0, axis]
    corners = (made.lower, made.upper)[side]
    corners[0, axis] = widened * (-1, 1)[side]
    made.level()
    corners[0, axis] = np.nextafter(corners[0, axis], (-9, 9)[side])
    made.refused("not in its box")


def test_roundings_of_what_lies_off_the_middle_count(monkeypatch):
    """A corner less a centre is no double: what is lost of it is looked at."""
    made = Made(monkeypatch, [[2.0**-60]], [[0.5]], q_d=[0.0])
    widened = float(reached(SimpleNamespace(n=1, independent=np.arange(1)), made.boxes)[0, 0])
    made.lower[0, 0], made.upper[0, 0] = -widened, 0.5
    made.refused("not in its box")
    made.lower[0, 0] = np.nextafter(-widened, 0.0)
    made.level()


def test_boxes_and_cells_that_do_not_fit(monkeypatch):
    made = block(monkeypatch)
    made.upper[3, 1] = made.lower[3, 1]
    made.refused("without room")
    made.upper[3] = made.lower[3] - 0.1
    made.refused("without room")
    made = block(monkeypatch)
    made.upper[at(made, 1, 1), 1] = made.lower[at(made, 1, 1), 1]
    made.refused("without room")
    made = block(monkeypatch)
    made.lower, made.upper = made.lower[1:], made.upper[1:]
    made.refused("other boxes")
    made = block(monkeypatch)
    turned = made.boxes.directions.copy()
    turned[2, 0, 1] = 1e-9
    made.boxes = made.boxes._replace(directions=turned)
    made.refused("no q|not q")


def test_premises_that_are_none(monkeypatch):
    """Boxes first, then what glues them, of these boxes alone."""
    made = block(monkeypatch)
    solutions, glue = made.premises()
    claim, others = made.claim(), made.premises()[0]
    points = SimpleNamespace(claim=SolutionsInBoxes(None, *made.boxes))
    met = Met(
        None, *(getattr(glue.claim, name) for name in ("first", "second", "at_first", "at_second")), np.arange(20)
    )
    by_points = SimpleNamespace(claim=met, premises=(points, solutions), found=glue.found)
    assert claim.examined(solutions, glue).found["level"] == claim.examined(solutions, by_points).found["level"]
    parts = [SimpleNamespace(**vars(glue) | {"premises": given}) for given in ((others,), (solutions, others), ())]
    parts += [SimpleNamespace(**vars(by_points) | {"premises": given}) for given in ((solutions, points), (solutions,))]
    for wrong in ((), (glue,), (glue, solutions), (solutions, solutions), *((solutions, part) for part in parts)):
        with pytest.raises(NotProvedError):
            claim.examined(*wrong)
    assert claim.examined(solutions).found["level"][0] == pytest.approx(0.25)
    assert len(glued_pairs(solutions, ())) == 0
    assert glued_pairs(solutions, (glue, by_points)).tolist() == [list(pair) for pair in made.pairs] * 2


# Parts of faces.


def inside(part, q):
    return bool(np.all((part.lower <= q) & (q <= part.upper)))


@pytest.mark.parametrize("n", [1, 2, 3])
def test_exposed_parts_are_what_no_cell_goes_on_behind(n):
    """Against points, on a grid of halves so that corners meet; parts of a face overlap nowhere."""
    rng = np.random.default_rng(n)
    for _ in range(60):
        cell = CellPart(np.zeros(n), 2.0 * np.ones(n))
        low = rng.integers(-4, 4, (5, n)) / 2.0
        beside = [CellPart(a, a + rng.integers(1, 5, n) / 2.0) for a in low]
        parts = list(exposed(cell, beside))
        assert all(np.sum(p.lower < p.upper) == n - 1 for p in parts)
        for k, side in product(range(n), (0, 1)):
            face = [p for p in parts if p.lower[k] == p.upper[k] == 2.0 * side]
            for q in rng.uniform(0.0, 2.0, (8, n)):
                q[k] = 2.0 * side
                beyond = q + np.eye(n)[k] * (1e-6 if side else -1e-6)
                behind = any(inside(other, q) and inside(other, beyond) for other in beside)
                assert sum(inside(p, q) for p in face) == (0 if behind else 1)
