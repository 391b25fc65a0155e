"""Leaves out of reach: each is asked of with its own middle, half widths and weights, and told apart from others."""

import numpy as np
import pytest

from ccpin.proof import exhausted as module
from ccpin.proof.exhausted import Unreachable
from ccpin.proof.facts import NotProvedError, prove
from tests.support.straight import straight

ARM = straight([[1.0, 0.0]])
QUARTERS = {"cut": (0, 1, 1, 0, 0, 0, 0), "child": (1, 3, 5, -1, -1, -1, -1)}


@pytest.fixture(autouse=True)
def two_links(monkeypatch):
    """What reaches q with |q| ≤ 2, and no farther; each coordinate moves it by as much."""
    monkeypatch.setattr(module, "groups_of", lambda system: system)
    monkeypatch.setattr(
        module, "empty_cells", lambda system, groups, q, half: np.linalg.norm(q, axis=1) - half.sum(axis=1) > 2.0
    )


def whole_numbers(values):
    return np.array(values, dtype=np.int64)


def claim(lower, upper, cell, cut=(0, 0, 0), child=(1, -1, -1), weights=None, equations=ARM, wrapped=(False, False)):
    cell = whole_numbers(cell)
    weights = np.zeros((len(cell), 0)) if weights is None else weights
    return Unreachable(
        equations, np.array(lower), np.array(upper), np.array(wrapped), whole_numbers(cut), whole_numbers(child), cell,
        weights,
    )  # fmt: skip


def empty(*given, **more):
    return np.flatnonzero(prove(claim(*given, **more)).found["empty"]).tolist()


def test_a_cell_is_out_of_reach_where_its_nearest_point_is():
    """The outer half of [−2a, 2a] begins at 0; of [0, 4a] at 2a."""
    for gap, found in ((1e-6, True), (-1e-6, False)):
        far = 2.0 * (2.0 + gap)
        assert empty((0.0, 0.0), (far, 0.0), (1, 2)) == [2] * found
        assert empty((-far, 0.0), (0.0, 0.0), (1, 2)) == [1] * found
        assert empty((far, 0.0), (far + 1.0, 0.0), (1, 2)) == [1, 2]


def test_half_widths_of_both_coordinates_count():
    """A quarter's centre at (3, 0) with edges 0.5 each way is 3 − 2·0.5 from reach at least, by the sum of moves."""
    for half, found in ((0.499, [0]), (0.501, [])):
        assert empty((3.0 - half, -half), (3.0 + half, half), (0,), cut=(0,), child=(-1,)) == found


def test_each_leaf_is_told_apart():
    """Of four quarters those that are asked of and out of reach."""
    corners = (1.0, 1.0), (3.0, 3.0)
    assert empty(*corners, (3, 4, 5, 6), **QUARTERS) == [6]
    assert empty(*corners, (3, 4, 5), **QUARTERS) == []
    assert empty((4.0, 4.0), (5.0, 5.0), (4, 6), **QUARTERS) == [4, 6]


@pytest.mark.parametrize("chunk", [1, 2, 3, 100])
def test_leaves_are_looked_at_a_few_at_a_time(monkeypatch, chunk):
    monkeypatch.setattr(module, "_AT_ONCE", chunk)
    assert empty((4.0, 4.0), (5.0, 5.0), (3, 4, 5, 6), **QUARTERS) == [3, 4, 5, 6]


def test_what_nobody_reaches_is_no_leaf():
    """A cell that is no part of the tree is called nothing."""
    assert empty((4.0, 4.0), (5.0, 5.0), (1, 2, 3), cut=(0, 0, 0, 0), child=(1, -1, -1, -1)) == [1, 2]


def test_weights_are_asked_of_a_platform_alone(monkeypatch):
    """As many as it has legs; where they prove nothing, or are others, the triangle inequality stands alone."""
    platform = type("Legs", (), {"lengths": np.ones(3)})()
    monkeypatch.setattr(module, "platform_of", lambda system: platform)
    asked = []

    def ends(system, legs, centre, half):
        assert legs is platform
        return centre, half

    def by(legs, ends, weights):
        asked.append((*ends, weights.copy()))
        return weights[:, 0] > 0.5, None

    monkeypatch.setattr(module, "ends_over", ends)
    monkeypatch.setattr(module, "empty_by", by)
    weights = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    assert empty((0.0, 0.0), (1.0, 2.0), (1, 2), weights=weights) == [1]
    centre, half, given = asked.pop()
    np.testing.assert_array_equal(centre, [[0.25, 1.0], [0.75, 1.0]])
    np.testing.assert_array_equal(half, [[0.25, 1.0], [0.25, 1.0]])
    np.testing.assert_array_equal(given, weights)
    assert empty((0.0, 0.0), (1.0, 2.0), (1, 2), weights=weights[:, :2]) == []
    assert asked == []
    monkeypatch.setattr(module, "platform_of", lambda system: None)
    assert empty((0.0, 0.0), (1.0, 2.0), (1, 2), weights=weights) == []


@pytest.mark.parametrize("change", [
    {"cell": (3,)}, {"cell": (4,)}, {"cell": (0,)}, {"cell": (-1,)}, {"upper": (3.0, 4.0)}, {"child": (1, 1, -1)},
    {"weights": np.full((1, 3), np.nan)}, {"weights": np.zeros((2, 3))}, {"wrapped": (True, False)},
])  # fmt: skip
def test_what_is_no_claim_is_refused(change):
    """A cell that is none or no leaf, exchanged corners, no tree, weights that are none."""
    given = {"lower": (4.0, 4.0), "upper": (5.0, 5.0), "cell": (2,)} | change
    with pytest.raises(NotProvedError):
        prove(claim(**given))


def test_premises_are_none_of_its():
    fact = prove(claim((4.0, 4.0), (5.0, 5.0), (1, 2)))
    with pytest.raises(NotProvedError, match="rests on nothing"):
        prove(claim((4.0, 4.0), (5.0, 5.0), (1, 2)), fact)
