"""Limits, motors and dexterity at equality, of closures that are straight lines: every bound of theirs is attained."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof import requirements
from ccpin.proof.bounds import Contraction
from ccpin.proof.demanded import Demanded
from ccpin.proof.equations import Problem, Requirements
from ccpin.proof.facts import NotProvedError, prove
from ccpin.proof.requirements import conditioning, dexterous, meets, passable, reach
from ccpin.proof.solutions import SolutionsInBoxes
from tests.support.straight import boxes_about, straight

NO_LIMIT = np.finfo(float).max
NONE = np.zeros(0, dtype=np.int64)


def problem_of(equations, lower=(-np.inf, -np.inf), upper=(np.inf, np.inf), driven=NONE, units=(1.0,), dexterity=0.0):
    demands = Requirements(
        np.array(lower), np.array(upper), np.array(driven, dtype=np.int64), np.array(units), dexterity
    )
    return Problem(equations.system, equations.stack, None, demands)


LINE = straight([[2.0]])
BOXES = boxes_about([[1.0, 2.0], [5.0, 10.0]], 0.5, [[2.0]], 0.25)


def test_coordinates_reach_as_far_as_boxes_do():
    """|D|h + |E|R, with 1e-10 of it and 1e-12 (1 + |θ|) for roundings."""
    modes = np.full((2, 1, 1), -2.0)
    low, high = reach(problem_of(LINE), BOXES._replace(modes=modes))
    more = np.array([[0.5, 1.5], [0.5, 1.5]]) * (1 + 1e-10) + 1e-12 * (1 + BOXES.centre)
    np.testing.assert_allclose(low, BOXES.centre - more, rtol=1e-15)
    np.testing.assert_allclose(high, BOXES.centre + more, rtol=1e-15)


@pytest.mark.parametrize(
    ("lower", "upper", "kept"),
    [
        ((0.4999, 0.7499), (5.5001, 11.2501), [True, True]),
        ((0.5, 0.7499), (5.5001, 11.2501), [False, True]),
        ((0.4999, 0.75), (5.5001, 11.2501), [False, True]),
        ((0.4999, 0.7499), (5.5, 11.2501), [True, False]),
        ((0.4999, 0.7499), (5.5001, 11.25), [True, False]),
        ((-np.inf, 1.0), (4.0, np.inf), [False, False]),
        ((-np.inf, -np.inf), (1.499, np.inf), [False, False]),
    ],
)
def test_limits_are_kept_by_all_coordinates_of_all_of_a_box(lower, upper, kept):
    assert passable(problem_of(LINE, lower, upper), BOXES).tolist() == kept
    assert meets(problem_of(LINE, lower, upper), BOXES).tolist() == kept


def test_nothing_is_asked_where_nothing_is():
    """Of no boxes, without demands, or without motors."""
    assert meets(Problem(LINE.system, LINE.stack, None), BOXES).tolist() == [True, True]
    assert meets(problem_of(LINE, dexterity=0.5), BOXES).all()
    none = BOXES.take(NONE)
    assert meets(problem_of(LINE, driven=(0,)), none).tolist() == []
    assert meets(problem_of(LINE, (9.0, 9.0), driven=(0,)), BOXES).tolist() == [False, False]


def test_motors_determine_the_motion_where_the_others_follow():
    """y = 2q: by either; y = 0q: not by y's motor, which says nothing of q."""
    still = straight([[0.0]])
    boxes = boxes_about([[0.0, 0.0]], 0.5, [[0.0]], 0.25)
    assert meets(problem_of(LINE, driven=(0,)), BOXES).all()
    assert meets(problem_of(LINE, driven=(1,)), BOXES).all()
    assert meets(problem_of(still, driven=(0,)), boxes).all()
    assert not meets(problem_of(still, driven=(1,)), boxes).any()


@pytest.mark.parametrize(("kappa", "held"), [(0.999, True), (0.95, True), (1.0, False), (1.05, False), (0.55, True)])
def test_motors_are_asked_for_a_contraction(monkeypatch, kappa, held):
    """κ < 1 of the others' rows, on the tube as parameters, widened by 1e-10."""
    seen = []

    def found(bounds, radius):
        seen.append((bounds, radius))
        return np.ones((2, 1)), np.array([kappa, 0.5])

    monkeypatch.setattr(requirements, "weights_for", found)
    monkeypatch.setattr(requirements, "bounds_of", lambda problem, boxes, modes: (boxes, modes))
    assert requirements.regular(problem_of(LINE), problem_of(LINE, driven=(1,)).requirements, BOXES).tolist() == [
        held,
        True,
    ]
    (tube, modes), radius = seen[0]
    assert not radius.any()
    assert modes[:, :, 0].tolist() == 2 * [[1.0, 0.0]]
    assert tube.directions.tolist() == 2 * [[[1.0, 0.0], [2.0, 1.0]]]
    np.testing.assert_allclose(tube.half, [[0.5, 0.25 * (1 + 1e-10)]] * 2, rtol=1e-15)
    assert tube.preconditioner.tolist() == 2 * [[[-0.5]]]


PLANE = straight([[1.0, 0.0], [0.0, 1.0]])


def plane_boxes(stretch):
    """y = q, of which the second row is stretched in the box's slopes."""
    return boxes_about([[0.0, 0.0, 0.0, 0.0]], 0.5, [[1.0, 0.0], [0.0, stretch]], 0.25)


def demanded(dexterity, units=(1.0, 1.0), driven=(2, 3)):
    unlimited = np.full(4, np.inf)
    return problem_of(PLANE, -unlimited, unlimited, driven, units, dexterity)


def test_dexterity_is_that_of_the_slopes_in_their_units(monkeypatch):
    """σ_min/σ_max of D's rows, each unit what it counts as, less the Frobenius norm of what they may be off by."""
    monkeypatch.setattr(requirements, "_drift", lambda problem, boxes: np.zeros((1, 4, 2)))
    problem = demanded(0.25)
    for stretch, units, least in ((0.5, (1.0, 1.0), 0.5), (0.5, (1.0, 2.0), 0.25), (2.0, (1.0, 1.0), 0.5)):
        low, high = conditioning(problem, problem.requirements._replace(units=np.array(units)), plane_boxes(stretch))
        np.testing.assert_allclose([low, high], least, rtol=1e-9)
        assert low < least * (1 - 1e-10 - 0.9e-12 * (1 / least + 1))
        assert high > least * (1 + 1e-10 + 0.9e-12 * (1 / least + 1))
    off = np.zeros((1, 4, 2))
    off[0, 2], off[0, 3, 0] = (0.2, 0.2), 0.1
    monkeypatch.setattr(requirements, "_drift", lambda problem, boxes: off)
    low, high = conditioning(problem, problem.requirements, plane_boxes(0.5))
    np.testing.assert_allclose([low[0], high[0]], [(0.5 - 0.3) / 1.3, (0.5 + 0.3) / 0.7], rtol=1e-9)
    for most, held in (((0.5 - 0.3) / 1.3 - 1e-8, True), ((0.5 - 0.3) / 1.3 + 1e-8, False)):
        demands = problem.requirements._replace(dexterity=most)
        assert dexterous(problem, demands, plane_boxes(0.5)).tolist() == [held]
        assert meets(problem._replace(requirements=demands), plane_boxes(0.5)).tolist() == [held]


@pytest.mark.parametrize(
    ("size", "low", "high"),
    [(0.9, -0.4 / 1.9, 14.0), (1.5, -1.0 / 2.5, np.inf), (3.0, -2.5 / 4.0, np.inf), (np.nan, -np.inf, np.inf)],
)
def test_what_may_be_off_by_more_than_it_is_has_no_bound_above(monkeypatch, size, low, high):
    off = np.zeros((1, 4, 2))
    off[0, 2, 0] = size
    monkeypatch.setattr(requirements, "_drift", lambda problem, boxes: off)
    problem = demanded(0.25)
    found = conditioning(problem, problem.requirements, plane_boxes(0.5))
    np.testing.assert_allclose([found[0][0], found[1][0]], [low, high], rtol=1e-8)


def test_slopes_are_off_by_what_theorem_d_says(monkeypatch):
    """|E|T with F + ZT ≤ T: here (I − Z)⁻¹F, a part in 10⁶ more; none where Z is no contraction or F no bound."""
    Z, F = np.array([[0.5, 0.25], [0.0, 0.5]]), np.array([[1.0, 0.5], [2.0, 3.0]])
    modes = np.array([[[1.0, 0.0], [-1.0, 2.0]]])

    def drift(shrunk, first):
        monkeypatch.setattr(requirements, "_contraction", lambda problem, boxes: np.array([shrunk]))
        monkeypatch.setattr(requirements, "_first", lambda problem, boxes: np.array([first]))
        return requirements._drift(demanded(0.25), plane_boxes(0.5)._replace(modes=modes))[0]

    found = drift(Z, F)
    T = np.linalg.solve(np.eye(2) - Z, F)
    assert found[:2].tolist() == [[0.0, 0.0], [0.0, 0.0]]
    stated = np.abs(modes[0]) @ T
    assert np.all(found[2:] >= stated)
    np.testing.assert_allclose(found[2:], stated, rtol=2e-6)
    assert np.isfinite(drift(0.0 * Z, 0.0 * F)).all()
    assert np.isfinite(drift(0.999 * np.eye(2), F)).all()
    for shrunk, first in (
        (2.0 * np.eye(2), F),
        (np.diag([0.5, 2.0]), F),
        (Z, F + np.inf),
        (np.array([[0.0, 2.0], [2.0, 0.0]]), F),
    ):
        assert np.isnan(drift(shrunk, first)).all()


@pytest.mark.parametrize("wrong", [0.5, 0.9, 1.0, 1.0 + 1e-6])
def test_a_t_that_is_too_small_is_no_bound(monkeypatch, wrong):
    """F + ZT ≤ T is asked, whatever solved it; with T smaller by a factor nothing is proved."""
    monkeypatch.setattr(requirements, "_contraction", lambda problem, boxes: 0.5 * np.eye(2)[None])
    monkeypatch.setattr(requirements, "_first", lambda problem, boxes: np.ones((1, 2, 2)))
    solved = np.array([[1.0, 1.0], [1.0, 1.0]])

    def solve(matrix, right):
        found = 2.0 * right
        found[0, 1, 1] *= wrong / (1.0 + 1e-6)
        return found * solved

    monkeypatch.setattr(requirements, "np", SimpleNamespace(**{**vars(np), "linalg": SimpleNamespace(solve=solve)}))
    assert np.isfinite(requirements._drift(demanded(0.25), plane_boxes(0.5))).all() == (wrong > 1.0)


def test_a_t_of_zero_shows_no_contraction(monkeypatch):
    """F = 0 and T = 0: whatever Z is, F + ZT ≤ T."""
    monkeypatch.setattr(requirements, "_contraction", lambda problem, boxes: 2.0 * np.eye(2)[None])
    monkeypatch.setattr(requirements, "_first", lambda problem, boxes: np.zeros((1, 2, 2)))
    nothing = -1e-300 / (1.0 + 1e-6)
    assert nothing * (1.0 + 1e-6) + 1e-300 == 0.0
    stub = SimpleNamespace(solve=lambda matrix, right: right + nothing)
    monkeypatch.setattr(requirements, "np", SimpleNamespace(**{**vars(np), "linalg": stub}))
    assert np.isnan(requirements._drift(demanded(0.25), plane_boxes(0.5))).all()


class Columns:
    """Bounds whose matrix and rest for e_k are told."""

    def __init__(self, matrix):
        self.matrix = matrix

    def contraction(self, radius):
        steps = np.array([[10.0, 20.0, 40.0][: radius.shape[1]]])
        return Contraction(self.matrix, lambda weight: steps * np.flatnonzero(weight[0])[0])


def test_columns_of_z_are_those_of_its_parts():
    """The matrix's, and what is added for e_k."""
    matrix = np.arange(9.0).reshape(1, 3, 3)
    for k in range(3):
        found = requirements._column(Columns(matrix), np.zeros((1, 3)), k)
        np.testing.assert_allclose(
            found[0], (matrix[0, :, k] + k * np.array([10.0, 20.0, 40.0])) * (1 + 1e-10), rtol=1e-15
        )


@pytest.mark.parametrize(("n", "m"), [(1, 2), (2, 2), (3, 2), (5, 2), (2, 3), (4, 3)])
def test_f_is_bounded_off_the_diagonal_of_two_placings(n, m):
    """|A φ_θ D| of straight lines, exactly; on the diagonal it would be |1 − …|."""
    rng = np.random.default_rng(n + 10 * m)
    slope, lean = rng.normal(size=(2, m, n))
    equations = straight(slope)
    boxes = boxes_about(np.zeros((2, n + m)), 0.1, lean, 0.1, preconditioner=0.5)
    stated = 0.5 * np.abs(lean - slope)
    found = requirements._first(replace_demands(equations), boxes)
    np.testing.assert_allclose(found, np.array([stated, stated]), rtol=1e-8)


def replace_demands(equations):
    return Problem(equations.system, equations.stack, None)


def test_with_one_equation_f_has_no_bound():
    assert np.isinf(requirements._first(replace_demands(LINE), BOXES)).all()


def test_what_is_asked_is_asked_of_all_boxes():
    """Motors drive as many coordinates as are independent, each once, or none; no limit is the largest number."""
    fact = prove(SolutionsInBoxes(LINE, *BOXES))
    claim = Demanded.of(LINE, Requirements(np.full(2, -np.inf), np.array([5.6, np.inf]), NONE, np.ones(1), 0.0))
    assert claim.lower.tolist() == 2 * [-NO_LIMIT]
    assert claim.upper.tolist() == [5.6, NO_LIMIT]
    prove(claim, fact)
    prove(replace(claim, driven=np.array([1])), fact)
    for changes in (
        {"upper": np.array([5.4, NO_LIMIT])},
        {"lower": np.array([0.6, -NO_LIMIT])},
        {"driven": np.array([0, 1])},
        {"driven": np.array([2])},
        {"driven": np.array([3])},
        {"dexterity": np.array([0.5]), "driven": np.array([1])},
    ):
        with pytest.raises(NotProvedError):
            prove(replace(claim, **changes), fact)
    wide = prove(SolutionsInBoxes(PLANE, *plane_boxes(1.0)))
    two = Demanded.of(PLANE, demanded(0.0).requirements)
    prove(two, wide)
    for driven in ([1, 1], [0], [2, 4], [4, 5], [4, 2], [1, 1, 0]):
        with pytest.raises(NotProvedError):
            prove(replace(two, driven=np.array(driven)), wide)
