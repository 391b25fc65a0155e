"""What a fold between two sheets rests on: each condition of Proposition T is asked, of the right boxes and ends."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.domain.sheets import seams as module
from ccpin.domain.sheets.seams import cross, near_folds
from ccpin.errors import SingularConfigurationError

SYSTEM = SimpleNamespace(dependent=np.array([1, 2]), independent=np.array([0]), n=1, m=2)
PROBLEM = SimpleNamespace(system=SYSTEM)


class Told:
    """Boxes that are known by their numbers."""

    def __init__(self, numbers):
        self.numbers = list(numbers)
        self.kappa = np.zeros(len(self.numbers))

    def take(self, index):
        return Told([self.numbers[k] for k in index])


class Curve:
    """What `cross` asks of a curve of boxes, and what it is told.

    Args:
        times: The parameters between the boxes.
        start: In which box of the first sheet the first point lies.
        holding: Which boxes hold the singular configuration.
        end: Which of the others hold the last point.
        ends: What walking gives: the knot that was not reached.
        proved: Whether the kernel makes a fact of the walk.
    """

    def __init__(self, monkeypatch, times, start=True, holding=(0,), end=(), ends=None, starts=True, proved=True):
        self.times, self.walked, self.asked = times, [], []

        def walker(line, pieces, tube, theta):
            if not starts:
                raise SingularConfigurationError("", q_free=theta, rcond=0.0)
            self.walked.append((line, float(pieces(0.0)[0]), float(pieces(1.0)[0]), pieces.x.tolist(), tube.tolist()))
            boxes = SimpleNamespace(premises=("boxes",)) if proved else None
            return SimpleNamespace(times=times, proved=lambda: boxes, walk=lambda stride: ends)

        def lies_in(problem, join, line, box, side):
            self.asked.append((join.numbers[0], box.numbers[0], side))
            return start if join.numbers[0] == "first" else join.numbers[0] in end

        def held(line, box, singular, error):
            self.asked.append(("held", box.numbers[0], error))
            return box.numbers[0] in holding

        monkeypatch.setattr(module, "boxes_of", lambda facts: Told(range(len(times) - 1)))
        monkeypatch.setattr(module, "Walker", walker)
        monkeypatch.setattr(module, "lies_in", lies_in)
        monkeypatch.setattr(module, "holds", held)
        monkeypatch.setattr(module, "line_problem", lambda problem, theta, direction, j: (direction.tolist(), j))

    def cross(self, singular=1.5, error=1e-9, others=("a", "b", "c")):
        theta, kernel = np.array([0.0, 0.25, 1.0]), np.array([0.5, -1.0])
        fold = np.array([0.125, 0.25, singular]), kernel, error
        return cross(PROBLEM, (theta, Told(["first"])), np.array([2.0]), fold, Told(others))


TIMES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)  # the fold is in the third box


@pytest.mark.parametrize(
    ("told", "found"),
    [
        ({"end": "b"}, 1), ({"end": "bc"}, 1), ({"end": "a"}, 0), ({}, None),
        ({"end": "b", "start": False}, None), ({"end": "b", "ends": 1.0}, None), ({"end": "b", "holding": ()}, None),
        ({"end": "b", "holding": (0,)}, None), ({"end": "b", "holding": (4,)}, None),
        ({"end": "b", "starts": False}, None), ({"end": "b", "proved": False}, None),
        ({"end": "b", "holding": (1,)}, 1), ({"end": "b", "holding": (3,)}, 1),
    ],
)  # fmt: skip
def test_two_sheets_touch_where_all_of_it_is_proved(monkeypatch, told, found):
    """In the fold's box or one beside it the singular configuration; at the curve's two ends boxes of the sheets."""
    curve = Curve(monkeypatch, TIMES, **{"holding": (2,)} | told)
    assert curve.cross() == found
    if found is not None:
        assert curve.asked[0] == ("first", 0, -1.0)
        assert curve.asked[-1] == ("abc"[found], 4, 1.0)


@pytest.mark.parametrize(
    ("times", "box"),
    [((0.0, 1.0), 0), ((0.0, 0.6, 1.0), 0), ((0.0, 0.4, 1.0), 1), ((0.0, 0.3, 0.45, 1.0), 2), ((0, 0.2, 0.52, 1), 1)],
)
def test_the_folds_own_box_is_asked_first(monkeypatch, times, box):
    """It is halfway along the curve, whose last box is asked for the other sheet."""
    curve = Curve(monkeypatch, times, holding=(box,), end="a")
    assert curve.cross() == 0
    assert curve.asked[1] == ("held", box, 1e-9)
    assert curve.asked[-1] == ("a", len(times) - 2, 1.0)
    beside = Curve(monkeypatch, times, holding=(), end="a")
    assert beside.cross() is None
    assert sorted(k for _, k, _ in beside.asked[1:]) == [k for k in (box - 1, box, box + 1) if 0 <= k < len(times) - 1]


def test_the_curve_goes_as_far_beyond_as_before(monkeypatch):
    """With the coordinate as the parameter that moves most at the fold; not where that is not known from the start."""
    curve = Curve(monkeypatch, TIMES, holding=(2,), end="b")
    assert curve.cross(1.5) == 1
    assert curve.walked == [(([2.0], 2), 1.0, 2.0, [0.0, 1.0], [0.0])]
    curve.cross(0.5)
    assert curve.walked[1][1:3] == (1.0, 0.0)
    assert curve.cross(1.5, error=1e-2 + 1e-6) is None
    assert curve.cross(1.5, error=1e-2 - 1e-6) == 1


def test_folds_that_are_not_proved_are_not_followed(monkeypatch):
    found = SimpleNamespace(proved=np.array([True, False, True]), theta=np.array([[0.0], [0.0], [9.0]]))
    directions = np.arange(6.0).reshape(2, 3, 1)
    monkeypatch.setattr(module.Folds, "near", lambda *_: SimpleNamespace(directions=lambda: directions))
    asked = []
    monkeypatch.setattr(module, "singular_points", lambda problem, theta, along: asked.append(along) or found)
    rows = near_folds(PROBLEM, np.full((3, 1), 0.5), np.full((3, 1), 0.25))[2]
    assert rows.tolist() == [0]
    np.testing.assert_array_equal(asked[0], directions[0])
