"""Boxes that are said to be proved are, and are of the cells asked for; what is said to be glued is one solution."""

import threading
from dataclasses import replace

import numpy as np
import pytest

from ccpin.covering.proposals import krawczyk, solving, tasks
from ccpin.covering.proposals.krawczyk import certify_boxes
from ccpin.covering.proposals.solving import glued
from ccpin.covering.proposals.tasks import CellsToProve, glue_boxes, prove, prove_cells
from ccpin.covering.runner import Runner
from ccpin.proof.equations import closures_of
from ccpin.proof.newton import check
from tests.support.straight import arm, circles, problem_by_hand, reached_by

WIDTHS = np.geomspace(1e-7, 1.0, 12)
CIRCLE = problem_by_hand(circles())


@pytest.fixture(autouse=True)
def by_numpy(monkeypatch):
    """The compiled core has its own tests."""
    for module in (krawczyk, solving):
        monkeypatch.setattr(module, "certifier", lambda *_: None)


# Boxes.


@pytest.mark.parametrize("elbow", [1.5, 0.3, 0.03, -0.03])
def test_what_is_said_to_be_proved_is(monkeypatch, elbow):
    """By the inequalities of Theorem N: in either attempt, and never beyond the arm's reach."""
    problem, centre = arm(), np.tile(reached_by([0.3, elbow]), (12, 1))
    half = np.repeat(WIDTHS[:, None], 2, axis=1)
    tried = certify_boxes(problem, centre, half, np.eye(2))
    holding = check(closures_of(problem), tried.boxes).proved
    assert np.all(holding[tried.proved])
    farthest = np.linalg.norm(np.abs(centre[:, :2]) + half, axis=1)
    assert not np.any(tried.proved & (farthest >= 2.0))
    np.testing.assert_array_equal(tried.boxes.centre, centre)
    np.testing.assert_array_equal(tried.boxes.half, half)
    monkeypatch.setattr(krawczyk, "_one_weak", lambda inverse: np.zeros(len(inverse), dtype=bool))
    plain = certify_boxes(problem, centre, half, np.eye(2))
    assert np.all(check(closures_of(problem), plain.boxes).proved[plain.proved])
    assert plain.proved[0]
    assert np.all(tried.proved[plain.proved])
    assert np.sum(tried.proved) > np.sum(plain.proved)  # one is proved along singular vectors only
    for again, before in zip(tried.boxes, plain.boxes, strict=True):
        np.testing.assert_array_equal(again[plain.proved], before[plain.proved])


def test_no_box_is_proved_about_what_is_no_solution():
    """Nor where φ_y is singular; the others of the batch are."""
    centre = reached_by([[0.3, 1.0], [0.3, 1.0], [0.3, 0.0], [-0.4, -1.0]])
    centre[1, 3] += 2.0
    tried = certify_boxes(arm(), centre, np.full((4, 2), 1e-3), np.eye(2))
    assert tried.proved.tolist() == [True, False, False, True]


# Gluing: y = −q and y = π − q.


def circle_boxes(*centres, half=0.1):
    centre = np.array(centres, dtype=float)
    tried = certify_boxes(CIRCLE, centre, np.full((len(centre), 1), half), np.eye(1))
    assert np.all(tried.proved)
    return tried.boxes


def pair_glued(first, second, at, there):
    one, other = circle_boxes(first), circle_boxes(second)
    return bool(glued(CIRCLE, one, np.array([[at]]), other, np.array([[there]]))[0])


@pytest.mark.parametrize(("at", "held"), [
    (0.1, True), (0.1 + 0.95e-14, True), (0.1 + 1.05e-14, False), (0.1 - 0.95e-14, True), (0.1 - 1.05e-14, False),
])  # fmt: skip
def test_boxes_are_glued_at_points_of_both(at, held):
    """As widened by 1e-14: the one ends at 0.1, the other begins there."""
    assert pair_glued((0.0, 0.0), (0.2, -0.2), at, at - 0.2) is held
    assert pair_glued((0.2, -0.2), (0.0, 0.0), at - 0.2, at) is held


@pytest.mark.parametrize(("y", "one"), [(-0.2, True), (-0.2 + 2 * np.pi, True), (-0.2 - 4 * np.pi, True),
                                        (np.pi - 0.2, False), (-np.pi - 0.2, False)])  # fmt: skip
def test_one_solution_is_one_but_for_whole_turns(y, one):
    assert pair_glued((0.0, 0.0), (0.2, y), 0.1, -0.1) is one
    assert pair_glued((0.2, y), (0.0, 0.0), -0.1, 0.1) is one


OWN, OTHER = (0.0, 0.0), (0.0, np.pi)


@pytest.mark.parametrize(("near", "second", "proved", "same"), [
    (OWN, OWN, True, True), (OWN, OTHER, True, False), (OTHER, OTHER, True, False), (OTHER, OWN, True, False),
    (OWN, OWN, False, False),
])  # fmt: skip
def test_a_solution_known_badly_is_enclosed_anew(monkeypatch, near, second, proved, same):
    """What is enclosed near by must be proved, and be the first's and the second's; for others of a batch it is not."""
    solve, enclose = solving.solve_in_boxes, solving.certify_points

    def badly(*arguments):
        found = solve(*arguments)
        found.theta[1], found.error[1] = near, 4.0
        return found

    def enclosed(*arguments):
        found = enclose(*arguments)
        assert found.proved.tolist() == [True]
        return found._replace(proved=np.array([proved]))

    monkeypatch.setattr(solving, "solve_in_boxes", badly)
    monkeypatch.setattr(solving, "certify_points", enclosed)
    at = np.zeros((2, 1))
    assert glued(CIRCLE, circle_boxes(OWN, OWN), at, circle_boxes(OWN, second), at).tolist() == [True, same]


# Tasks.


def cells_of(shift=0):
    """Cells a little away from closed configurations of both elbows, one of them beyond the arm's reach."""
    y = np.array([[0.3, 1.0], [0.4, -1.2], [-2.0, 0.7], [3.0, -1.5], [1.0, 2.0]])
    start = reached_by(y)
    centre = start[:, :2] + [[0.01, -0.02], [-0.02, 0.01], [0.02, 0.02], [0.01, 0.01], [-0.01, 0.0]]
    centre[2] = [2.5, 0.5]
    turned = start.copy()
    turned[:, 2:] += 2.0 * np.pi * shift
    return CellsToProve(centre, np.array([[0.01, 0.02]] * 5) * [[1], [1], [1], [1], [0.5]], start, turned)


@pytest.mark.parametrize("shift", [0, 1, -3])
def test_cells_are_proved_as_asked(shift):
    """About their own centres, near what they are to be turned to, and on the elbow's side that they were begun on."""
    problem, cells = arm(), cells_of(shift)
    found = prove(problem, cells)
    assert found.proved.tolist() == [True, True, False, True, True]
    np.testing.assert_array_equal(found.boxes.centre[:, :2], cells.centre)
    kept = np.flatnonzero(found.proved)
    boxes = found.boxes.take(kept)
    assert np.all(check(closures_of(problem), boxes).proved)
    np.testing.assert_array_equal(boxes.half, cells.half[kept])
    np.testing.assert_allclose(boxes.centre, reached_by(boxes.centre[:, 2:]), atol=1e-13)
    assert np.abs(boxes.centre[:, 2:] - cells.turn_to[kept, 2:]).max() < 0.1
    assert np.all(np.sin(boxes.centre[:, 3]) * np.sin(cells.start[kept, 3]) > 0.0)


def test_what_is_demanded_besides_is_asked_of_what_is_proved(monkeypatch):
    monkeypatch.setattr(tasks, "meets", lambda problem, boxes: boxes.centre[:, 0] > 0.0)
    cells = cells_of()
    to_the_right = np.array([True, True, False, True, True]) & (cells.centre[:, 0] > 0.0)
    assert prove(arm(), cells).proved.tolist() == to_the_right.tolist()
    assert np.any(cells.centre[[0, 1, 3, 4], 0] < 0.0)


def test_configurations_are_turned_by_whole_turns():
    """To within half a turn; neither what is independent, nor what does not close on itself."""
    problem, turn = arm(), 2.0 * np.pi
    still, turning = (
        problem._replace(system=replace(problem.system, periodic=np.full(4, periodic))) for periodic in (False, True)
    )
    theta = np.array([[9.0, -9.0, y, z] for y, z in ((3.0, -3.0), (3.3, -3.3), (7.0, 20.0), (-9.0, 0.0))])
    found = tasks._turned(turning, theta, np.zeros_like(theta))
    stated = [[3.0, -3.0], [3.3 - turn, turn - 3.3], [7.0 - turn, 20.0 - 3 * turn], [turn - 9.0, 0.0]]
    np.testing.assert_allclose(found[:, 2:], stated, rtol=1e-13, atol=1e-13)
    np.testing.assert_array_equal(found[:, :2], theta[:, :2])
    about = tasks._turned(turning, theta, np.full_like(theta, 50.0))
    assert np.abs(about[:, 2:] - 50.0).max() <= np.pi
    np.testing.assert_allclose(np.exp(1j * about[:, 2:]), np.exp(1j * theta[:, 2:]), atol=1e-12)
    np.testing.assert_array_equal(tasks._turned(still, theta, np.zeros_like(theta)), theta)


@pytest.mark.parametrize("chunk", [1, 2, 3, 100])
def test_chunks_are_put_together_in_order(chunk):
    problem, cells = arm(), cells_of()
    runner = Runner(problem, None, None, threading.Event())
    direct, parted = prove(problem, cells), prove_cells(runner, cells, chunk)
    for one, other in zip((*direct.boxes, *direct[1:]), (*parted.boxes, *parted[1:]), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-15)
    first = circle_boxes((0.0, 0.0), (0.0, 0.0), (1.0, -1.0), (0.2, -0.2), (0.0, 0.0))
    second = circle_boxes((0.2, -0.2), (0.2, np.pi - 0.2), (1.2, -1.2), (0.0, 0.0), (0.2, -0.2))
    at, there = np.array([[0.1], [0.1], [0.1], [-0.1], [0.05]]), np.array([[-0.1], [-0.1], [-0.1], [0.1], [-0.15]])
    same = glue_boxes(Runner(CIRCLE, None, None, threading.Event()), first, at, second, there, chunk)
    assert same.tolist() == [True, False, True, True, False]
