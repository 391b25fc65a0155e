"""Boxes of a walk: only proved ones, each glued to the one before at the point where that ends."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.interpolate import PPoly

from ccpin.domain.paths import walker as module
from ccpin.domain.paths.walker import Walker
from ccpin.proof.chords import chord_of
from ccpin.proof.newton import Boxes

SYSTEM = SimpleNamespace(independent=np.array([0, 2]), dependent=np.array([1]), n=2, m=1, n_free=3)
PROBLEM = SimpleNamespace(system=SYSTEM)


def boxes_of(count, centre=(0.0, 0.0, 0.0), along=(0.0, 0.0, 0.0), half=(1.0, 0.5, 0.25)):
    """Boxes of a walk, numbered by their κ."""
    directions = np.zeros((count, 3, 3))
    directions[:, :, 0] = along
    one = np.ones((count, 1, 1))
    centre, half = np.tile(np.array(centre, float), (count, 1)), np.tile(np.array(half, float), (count, 1))
    return Boxes(centre, half, directions, one, one, one[:, 0], one[:, 0], np.arange(float(count)))


@pytest.fixture
def walker():
    """One that has yet to walk along (1, 2) in two coordinates."""
    made = object.__new__(Walker)
    made.problem, made.tube, made.theta = PROBLEM, np.array([0.125, 0.0625]), np.array([0.0, 5.0, 0.0])
    made.pieces = PPoly(np.array([[[1.0, 2.0]], [[0.0, 0.0]]]), np.array([0.0, 1.0]))
    made.times, made.tried, made._boxes = [0.0], 0, []
    made.point = boxes_of(1, centre=(0.5, 5.0, -0.25))._replace(half=np.zeros((1, 0)), directions=np.zeros((1, 3, 0)))
    return made


def test_where_a_box_ends_the_next_begins(walker):
    """At the start: where the point is; then at the end of the last box's chord."""
    np.testing.assert_array_equal(walker._seam(), [0.5, -0.25])
    walker._boxes = [boxes_of(1), boxes_of(1, (1.0, 9.0, 2.0), (0.25, 9.0, -0.5))]
    np.testing.assert_array_equal(walker._seam(), [1.25, 1.5])


@pytest.mark.parametrize("carried", [True, False])
@pytest.mark.parametrize(
    ("aside", "inside"),
    [((0.5, 0.25), True), ((-0.5, -0.25), True), ((0.51, 0.0), False), ((0.0, 0.26), False), ((0.0, 0.4), False)],
)
def test_a_box_goes_on_from_within_its_first_cross_section(walker, carried, aside, inside):
    """Where the last one ends is asked of it, at s = −1 and as far aside as that is."""
    walker._boxes = [boxes_of(1, (1.0, 9.0, 2.0), (0.25, 9.0, -0.5))]
    asked = []
    walker.carries = lambda box, delta: asked.append(delta.tolist()) or carried
    box = boxes_of(1, (1.25 + 2.0 - aside[0], 7.0, 1.5 - 4.0 - aside[1]), (2.0, 9.0, -4.0))
    assert walker._continues(box) is (inside and carried)
    if inside:
        np.testing.assert_allclose(asked, [[[-1.0, *aside]]], rtol=0, atol=1e-15)
    else:
        assert asked == []


@pytest.mark.parametrize(
    ("proved", "settled", "going", "found"),
    [
        ((1, 1, 1), (1, 1, 1), (1, 1, 1), 2), ((1, 1, 0), (1, 1, 1), (1, 1, 1), 1),
        ((1, 1, 1), (1, 1, 0), (1, 1, 1), 1), ((1, 1, 1), (1, 1, 1), (1, 0, 0), 0),
        ((1, 1, 1), (1, 1, 1), (0, 0, 0), None), ((0, 0, 0), (1, 1, 1), (1, 1, 1), None),
    ],
)  # fmt: skip
def test_the_longest_stretch_that_is_proved_and_goes_on(walker, monkeypatch, proved, settled, going, found):
    asked = []

    def certify(problem, theta, half, across):
        asked.append((theta, half, across))
        return SimpleNamespace(proved=np.array(proved, dtype=bool), boxes=boxes_of(3))

    monkeypatch.setattr(module, "extrapolate", lambda problem, theta, steps: steps)
    monkeypatch.setattr(
        module,
        "newton",
        lambda problem, theta, steps: SimpleNamespace(theta=theta, settled=np.array(settled, dtype=bool)),
    )
    monkeypatch.setattr(module, "certify_boxes", certify)
    walker.pieces = PPoly(np.array([[[0.0, 0.5]], [[1.0, 2.0]], [[0.0, 0.0]]]), np.array([0.0, 1.0]))
    walker.times, walker.theta = [0.25], np.array([0.125, 5.0, 0.25])
    begun = walker.pieces(0.25) + [0.125, -0.0625]
    walker.point = walker.point._replace(centre=np.array([[begun[0], 5.0, begun[1]]]))
    walker._continues = lambda box: bool(going[int(box.kappa[0])])
    step = walker.step(1.0, np.array([0.25, 0.5, 2.0]), walker.tube)
    ends = np.array([0.5, 0.75, 1.0])
    assert (None if step is None else (int(step.box.kappa[0]), step.end)) == (
        None if found is None else (found, ends[found])
    )
    steps, half, across = asked[0]
    first, last = walker.pieces(0.25), walker.pieces(ends)
    np.testing.assert_allclose(steps, 0.5 * (first + last) - walker.theta[[0, 2]], rtol=1e-14)
    np.testing.assert_allclose(across[:, :, 0], 0.5 * (last - first), rtol=1e-14)
    np.testing.assert_array_equal(across[:, :, 1:], np.tile(np.eye(2), (3, 1, 1)))
    bends = np.array([[0.0, chord_of(walker.pieces, 0.25, end).deviation[1]] for end in ends])
    assert np.all(bends[:, 1] >= 0.5 * (0.5 * (ends - 0.25)) ** 2)  # of ½t² from its chord, in the middle
    jump = np.abs(first - begun) * (1 + 1e-10)
    np.testing.assert_allclose(half, np.column_stack([np.ones(3), walker.tube + bends + jump]), rtol=1e-13)
    assert walker.tried == 3


def test_a_walker_that_goes_back_has_its_boxes_up_to_there(walker, monkeypatch):
    """And is where the last of these ends; at the point it began at where it has none."""
    monkeypatch.setattr(
        module,
        "solve_in_boxes",
        lambda problem, box, delta: SimpleNamespace(theta=np.append(delta[0], box.kappa)[None]),
    )
    three = boxes_of(3)
    walker._boxes, walker.times = [three.take(np.array([k])) for k in range(3)], [0.0, 0.25, 0.5, 1.0]
    back = walker.back(1)
    assert back.times == [0.0, 0.25, 0.5]
    assert back.boxes.kappa.tolist() == [0.0, 1.0]
    assert back.theta.tolist() == [1.0, 0.0, 0.0, 1.0]
    first = walker.back(3)
    assert (first.times, first.theta.tolist(), first.boxes.half.shape) == ([0.0], [0.5, 5.0, -0.25], (0, 3))
    assert first.boxes.directions.shape == (0, 3, 3)
    assert walker.boxes.kappa.tolist() == [0.0, 1.0, 2.0]
