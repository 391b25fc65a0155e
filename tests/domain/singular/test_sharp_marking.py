"""Cells are marked where singular configurations are proved, with their errors stretched as q moves with s."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering.cells import CellStatus
from ccpin.domain.singular import marking as module
from ccpin.domain.singular import sampled
from ccpin.domain.singular.folds import SearchedLines
from ccpin.domain.singular.sampled import SingularCurve

INDEPENDENT = np.array([1, 3])


class InPlace:
    """A region that turns its points by one."""

    @staticmethod
    def reduce(q):
        return q + 1.0


def points(theta, error, proved):
    theta = np.asarray(theta, dtype=float)
    none = np.zeros(len(theta))
    proved = np.asarray(proved, dtype=bool)
    return SearchedLines(theta, none, none[:, None], np.asarray(error, dtype=float), proved, None)


def marked(monkeypatch, found, leaves, status, stretch):
    tree, asked = SimpleNamespace(status=np.array(status)), []
    monkeypatch.setattr(
        module, "leaves_holding", lambda tree, region, q, error: asked.append((q, error)) or np.array(leaves)
    )
    cells = module._marked(tree, InPlace(), found, INDEPENDENT, np.asarray(stretch, dtype=float))
    return tree, cells, asked[0]


def test_cells_hold_proved_points_with_all_their_error(monkeypatch):
    """r max |d|, and r where that is less than one; what is not proved or no number marks nothing."""
    theta = np.arange(24.0).reshape(6, 4)
    theta[3, 0] = np.nan
    found = points(theta, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6], [1, 0, 1, 1, 1, 1])
    undecided, certified = CellStatus.UNDECIDED, CellStatus.CERTIFIED
    tree, cells, (q, error) = marked(
        monkeypatch, found, [0, 1, -1, 0], [undecided, certified, undecided], [3.0, 1.0, 0.5, 1.0, 1.0, 1.5]
    )
    kept = [0, 2, 4, 5]
    turned = theta[kept]
    turned[:, INDEPENDENT] += 1.0
    np.testing.assert_array_equal(q, turned[:, INDEPENDENT])
    rounded = error - np.array([[0.3], [0.3], [0.5], [0.9]])  # what rounds a q before it is turned
    np.testing.assert_allclose(rounded, 4.0 * 2.0**-53 * (1.0 + np.abs(theta[kept][:, INDEPENDENT])), atol=2e-16)
    np.testing.assert_array_equal(cells[0], [0])
    np.testing.assert_array_equal(cells[1], turned[:1])
    assert tree.status.tolist() == [CellStatus.SINGULAR, certified, undecided]


def test_points_outside_mark_nothing(monkeypatch):
    """−1 is no cell, be the last one undecided."""
    tree, cells, _ = marked(monkeypatch, points(np.zeros((1, 4)), [0.1], [1]), [-1], [CellStatus.UNDECIDED] * 2, [1.0])
    assert len(cells[0]) == 0
    assert tree.status.tolist() == [CellStatus.UNDECIDED] * 2
    tree, cells, _ = marked(monkeypatch, points(np.zeros((1, 4)), [0.1], [1]), [0], [CellStatus.UNDECIDED] * 2, [1.0])
    assert tree.status.tolist() == [CellStatus.SINGULAR, CellStatus.UNDECIDED]


def stretched(monkeypatch, mark):
    """With which stretch points along d = (0.1, −3) are marked."""
    asked, directions = [], np.array([[0.1, -3.0], [0.2, 0.3]])
    folds = SimpleNamespace(
        directions=lambda: [directions],
        bending=lambda problem, start: None,
        along=lambda bending, d: SearchedLines(*(np.zeros(2) for _ in SearchedLines._fields)),
    )
    monkeypatch.setattr(module.Folds, "near", staticmethod(lambda problem, theta: folds))
    monkeypatch.setattr(module, "singular_points", lambda *_: "found")
    monkeypatch.setattr(module, "_marked", lambda tree, region, found, q, stretch: asked.append((found, stretch)))
    problem = SimpleNamespace(system=SimpleNamespace(independent=INDEPENDENT, m=2, n_free=4))
    runner = SimpleNamespace(problem=problem, check=lambda: None)
    tree = SimpleNamespace(
        status=np.full(2, CellStatus.UNDECIDED),
        lower=np.zeros((2, 2)),
        size=np.ones((2, 2)),
        leaves=lambda status: None,
    )
    list(mark(runner, tree))
    ((found, stretch),) = asked
    assert found == "found"
    np.testing.assert_array_equal(stretch, [3.0, 0.3])


def test_errors_are_stretched_by_the_longest_component(monkeypatch):
    """max |d| of each, from a face and from a cell."""
    contacts = SimpleNamespace(cell=np.arange(2))
    monkeypatch.setattr(module, "beside_certified", lambda *_: contacts)
    monkeypatch.setattr(module, "sigma_at", lambda *_: np.zeros((2, 4)))
    monkeypatch.setattr(module, "rows_of", lambda some, rows: some)
    region = SimpleNamespace(position=lambda corner: corner)
    stretched(monkeypatch, lambda runner, tree: module.mark_singular(runner, tree, region, None))
    stretched(
        monkeypatch, lambda runner, tree: module.mark_in_cells(runner, tree, region, np.arange(2), np.zeros((2, 4)))
    )


@pytest.mark.parametrize(("error", "verdict"), [((0.1, 0.2), "proven"), ((0.1, np.nan), "undecided")])
def test_sampled_curves_are_proven_where_all_points_are(error, verdict):
    assert SingularCurve("fold", np.zeros((2, 2)), np.zeros((2, 4)), False, np.array(error)).verdict == verdict


def test_sampled_points_are_as_near_as_proved(monkeypatch):
    """How far the proved one is in its worst coordinate, and its error; within 1e-6, the best of all directions."""
    near, far = np.zeros((6, 2)), np.zeros((6, 2))
    near[:, 1] = [3e-7, 1e-7, -3e-7, 9e-7, 0.999e-6, 1.001e-6]
    far[:, 0] = [1e-7, 2e-7, 2e-7, 1.5e-6, 1.9e-6, 1.5e-6]
    errors = [[1e-7, 1e-7, 1e-7, 2e-7, 0.0, 0.0], [1e-7] * 6]
    proved = [[1, 0, 1, 1, 1, 1], [1, 1, 1, 1, 1, 1]]
    results = [points(x, e, p) for x, e, p in zip((near, far), errors, proved, strict=True)]
    monkeypatch.setattr(sampled.Folds, "near", staticmethod(lambda *_: SimpleNamespace(directions=lambda: [0, 1])))
    monkeypatch.setattr(sampled, "singular_points", lambda problem, theta, which: results[which])
    reading = SimpleNamespace(problem=None, theta=lambda q_free: q_free)
    monkeypatch.setattr(sampled, "reading_of", lambda *_: SimpleNamespace(bounded=lambda name: reading))
    found = sampled._proved_near(SimpleNamespace(q_reference=None), SimpleNamespace(q_free=np.zeros((6, 2))))
    np.testing.assert_allclose(found, [2e-7, 3e-7, 3e-7, np.nan, 0.999e-6, np.nan], rtol=1e-12)
    shifted = sampled._proved_near(SimpleNamespace(q_reference=None), SimpleNamespace(q_free=np.full((6, 2), 5e-7)))
    expected = np.abs(near - 5e-7).max(axis=1) + errors[0]
    assert shifted[0] == pytest.approx(min(expected[0], np.abs(far[0] - 5e-7).max() + 1e-7), rel=1e-12)
