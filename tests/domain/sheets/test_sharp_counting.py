"""Counting over one q: what is proved alone, within the ranges, the same or another, at the ends of each inequality."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.domain.sheets import counting as module
from ccpin.domain.sheets.counting import all_solutions
from ccpin.proof.narrowing import Candidates
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import SLACK

TURN = 2.0 * np.pi


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
        np.column_stack([np.zeros(count), y]),
        np.zeros((count, 1)),
        directions,
        modes,
        modes,
        radius * one,
        one,
        one[:, 0],
    )


def candidates_at(y, half):
    y, half = np.atleast_2d(y), np.atleast_2d(half)
    zero = np.zeros(len(y))
    return Candidates(
        zero.astype(int), np.column_stack([zero, y]), np.column_stack([zero, half]), np.zeros((len(y), y.shape[1], 1))
    )


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
    found = module._within(problem_of(3), ranges, boxes)
    assert [bool(mask[0]) for mask in found] == [inside, beyond]


# The same, or another


def test_the_same_where_one_lies_alone_in_the_other(monkeypatch):
    """What is asked: all that one box may carry, turned to the other, within its tube."""
    asked = []
    monkeypatch.setattr(module, "alone_in", lambda problem, boxes, held: asked.append((boxes, held)) or [answer])
    problem = problem_of(2, (True, False))
    one = boxes_at((0.5 + TURN, 1.0), [[1, -2], [0, 1]], 0.25, 3.0)
    other = boxes_at((0.5 + 5e-7, 1.0 - 5e-7), np.eye(2), 1.0)
    for answer in (True, False):
        assert module._same(problem, one, other) is answer
    boxes, held = asked[0]
    assert boxes is other
    np.testing.assert_allclose(held.centre, [[0.0, 0.5, 1.0]], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(held.half, [[0.0, 0.75, 0.25]])
    np.testing.assert_array_equal(held.slopes, np.full((1, 2, 1), 3.0))


@pytest.mark.parametrize("k", [0, 1])
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("radii", [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.25, 0.75)])
def test_different_beyond_both_spreads(k, side, radii):
    """From the sum of what both may be off by, 1e-13 and the slack, turns not counted, in one coordinate."""
    problem = problem_of(2, (True, False))
    most = 2.0 * sum(radii) * SLACK + 1e-13
    for share, different in ((1.0 - 1e-3, False), (1.0 + 1e-3, True)):
        y = np.array([0.25, -0.5]) if sum(radii) else np.zeros(2)
        moved = y.copy()
        moved[k] += side * most * share
        moved[0] += TURN if sum(radii) else 0.0
        one, other = boxes_at(moved, [[2, 0], [0, -2]], radii[0]), boxes_at(y, [[2, 0], [0, 2]], radii[1])
        assert module._different(problem, one, other) is different


# All there are


def counted(monkeypatch, found, left, alike=()):
    """What is said where boxes are found, and how many candidates are left of two."""
    monkeypatch.setattr(module, "over_all", lambda *_: candidates_at([[0.0], [1.0]], [[1.0], [1.0]]))
    monkeypatch.setattr(module, "narrowed_both", lambda problem, ranges, waiting: waiting)
    monkeypatch.setattr(module, "to_halve", lambda problem, waiting: np.zeros((2, len(waiting.cell)), dtype=bool))
    monkeypatch.setattr(module, "halved", lambda problem, waiting, cut: waiting)
    boxes = [boxes_at((float(k),), [[1.0]], 0.125) for k in range(found)]

    def solved(problem, ranges, waiting, so_far):
        so_far.extend(boxes)
        return np.arange(2) >= left

    monkeypatch.setattr(module, "_solved", solved)
    pair = [tuple(boxes[k].centre[0, 1] for k in pair) for pair in alike]
    monkeypatch.setattr(
        module, "_different", lambda problem, one, other: (one.centre[0, 1], other.centre[0, 1]) not in pair
    )
    return all_solutions(problem_of(1), None, np.zeros(1))


@pytest.mark.parametrize(
    ("found", "left", "alike", "complete"),
    [
        (1, 0, [], True), (3, 0, [], True), (3, 1, [], False), (0, 2, [], False),
        (3, 0, [(1, 2)], False), (2, 0, [(0, 1)], False),
    ],
)  # fmt: skip
def test_all_where_nothing_is_left_and_all_differ(monkeypatch, found, left, alike, complete):
    result = counted(monkeypatch, found, left, alike)
    assert result.complete is complete
    assert result.theta.tolist() == [[0.0, float(k)] for k in range(found)]


def solved(monkeypatch, alone, inside, beyond, found=(), same=(), turned=0.0):
    """What becomes of three candidates, of which the second is no solution; which boxes were tried and are kept."""
    problem, waiting = problem_of(1, True), candidates_at([[1.0], [2.0], [4.0]], [[0.5], [0.5], [0.5]])
    theta = waiting.centre + np.array([0.0, 0.125 + turned])
    ended = SimpleNamespace(settled=np.array([True, False, True]), theta=theta)
    monkeypatch.setattr(module, "newton", lambda problem, theta, steps: ended)
    tried = []

    def certify(problem, centre, half, across):
        tried.append(centre[:, 1].copy())
        return SimpleNamespace(proved=np.ones(2, dtype=bool), boxes=boxes_at(centre[:, 1:], [[1.0]], 0.25))

    monkeypatch.setattr(module, "certify_boxes", certify)
    monkeypatch.setattr(module, "alone_in", lambda problem, boxes, held: np.array(alone))
    monkeypatch.setattr(module, "_within", lambda problem, ranges, boxes: (np.array(inside), np.array(beyond)))
    monkeypatch.setattr(module, "_same", lambda problem, one, other: other in same)
    kept = list(found)
    done = module._solved(problem, None, waiting, kept)
    return done.tolist(), [float(box.centre[0, 1]) for box in kept[len(found) :]], tried[0]


BOTH, NEITHER, FIRST = (True, True), (False, False), (True, False)


@pytest.mark.parametrize(
    ("alone", "inside", "beyond", "done", "kept"),
    [
        (BOTH, BOTH, NEITHER, [True, False, True], [1.125, 4.125]),
        (FIRST, BOTH, NEITHER, [True, False, False], [1.125]),
        (BOTH, FIRST, NEITHER, [True, False, False], [1.125]),
        (BOTH, NEITHER, FIRST, [True, False, False], []),
        (BOTH, FIRST, (False, True), [True, False, True], [1.125]),
        (NEITHER, BOTH, BOTH, [False] * 3, []),
    ],
)
def test_a_candidate_is_done_where_one_is_alone_and_in_or_out(monkeypatch, alone, inside, beyond, done, kept):
    assert solved(monkeypatch, alone, inside, beyond)[:2] == (done, kept)


def test_solutions_are_tried_without_their_turns(monkeypatch):
    for turns in (-7, 1, 7):
        _, kept, tried = solved(monkeypatch, BOTH, BOTH, NEITHER, turned=turns * TURN)
        np.testing.assert_allclose(tried, [1.125, 4.125], rtol=0, atol=1e-12)
        assert len(kept) == 2


@pytest.mark.parametrize("which", [0, 1])
def test_one_that_is_found_already_is_not_counted_again(monkeypatch, which):
    """The same as either of two that are known."""
    found = ["first", "second"]
    done, kept, _ = solved(monkeypatch, BOTH, BOTH, NEITHER, found, same=(found[which],))
    assert (done, kept) == ([True, False, True], [])
