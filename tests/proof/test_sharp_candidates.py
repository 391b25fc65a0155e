"""Proposition N at equality: boxes narrowed to what rows that are told leave of them."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.proof import narrowing
from ccpin.proof.narrowing import Candidates, narrowed
from ccpin.proof.rounding import blur
from tests.support.straight import problem_by_hand, straight

PLANE = straight([[1.0], [2.0]])
SHARE, SLACK = 1e-12, 1 + 1e-10


def candidates(centre, half, slopes=((0.0,), (0.0,))):
    centre, half = np.atleast_2d(np.array(centre, dtype=float)), np.atleast_2d(np.array(half, dtype=float))
    return Candidates(np.arange(len(centre)), centre, half, np.tile(np.array(slopes, dtype=float), (len(centre), 1, 1)))


@pytest.fixture
def rows(monkeypatch):
    """φ, φ_θ and Y as they are told."""

    def told(phi, slope, rest):
        def bounds_of(problem, boxes):
            moves = np.abs(boxes.preconditioner @ slope @ boxes.directions) @ boxes.half[..., None]
            constant = np.abs(boxes.preconditioner @ phi[..., None])
            return SimpleNamespace(y=(constant + moves)[..., 0] + rest)

        monkeypatch.setattr(narrowing, "closure_values", lambda problem, theta: (phi, slope))
        monkeypatch.setattr(narrowing, "bounds_of", bounds_of)

    return told


def stated(c, L, h, E):
    """The interval of every δ that Proposition N leaves, with Y's share for roundings twice."""
    Y = np.abs(c) + np.abs(L) @ h + E
    low, high = -h.copy(), h.copy()
    for i in range(len(c)):
        for j in range(len(h)):
            others = (sum(abs(L[i, k]) * h[k] for k in range(len(h)) if k != j) + E[i] + 2 * SHARE * Y[i]) * SLACK
            if L[i, j]:
                low[j] = max(low[j], -c[i] / L[i, j] - others / abs(L[i, j]))
                high[j] = min(high[j], -c[i] / L[i, j] + others / abs(L[i, j]))
    return low, high


@pytest.mark.parametrize("size", [0.1, 1.0, 300.0])
def test_each_coordinate_is_narrowed_by_every_row(rows, size):
    """|δ_j + c_i/L_ij| ≤ (Σ_{k≠j} |L_ik|h_k + E_i)/|L_ij|, met with the box, by the rows that know of it."""
    rng, seen = np.random.default_rng(2), 0
    for _ in range(60):
        phi, slope = 0.2 * size * rng.normal(size=(1, 2)), rng.normal(size=(1, 2, 3))
        slope[0, 0, rng.integers(3)] = 0.0
        lean, h = rng.normal(size=(2, 1)), size * rng.uniform(0.5, 2.0, 3) * np.array([0.05, 1.0, 1.0])
        E = np.array([0.0, 0.01 * size])
        rows(phi, slope, E)
        D = np.eye(3)
        D[1:, :1] = lean
        low, high = stated(phi[0], slope[0] @ D, h, E)
        found = narrowed(problem_by_hand(PLANE), candidates([[0.5, 1.0, -1.0]], h, lean))
        if np.any(low > high):
            assert not len(found.cell)
            continue
        middle, width = 0.5 * (low + high)[1:], 0.5 * (high - low)[1:]
        width = width + blur(np.array([1.0, -1.0]) + middle)
        smaller, seen = width < h[1:], seen + 1
        close = {"rtol": 1e-13, "atol": 1e-14 * size}
        np.testing.assert_allclose(found.half[0, 1:], np.where(smaller, width, h[1:]), **close)
        np.testing.assert_allclose(found.centre[0, 1:], np.array([1.0, -1.0]) + np.where(smaller, middle, 0.0), **close)
        assert (found.half[0, 0], found.centre[0, 0], found.slopes[0].tolist()) == (h[0], 0.5, lean.tolist())
    assert seen > 20


@pytest.mark.parametrize("row", [0, 1])
def test_a_box_with_a_row_that_is_nowhere_zero_is_gone(rows, row):
    """|c_i| > Σ |L_ik|h_k + E_i: 0.5 + 0.25 here, by a part in 10⁹."""
    slope = np.zeros((1, 2, 3))
    slope[0, row, 1] = 1.0
    for much, gone in ((0.75 * (1 - 1e-9), False), (0.75 * (1 + 1e-9), True)):
        phi = np.zeros((1, 2))
        phi[0, row] = much
        rows(phi, slope, np.array([0.25, 0.25]))
        found = narrowed(problem_by_hand(PLANE), candidates([[0.0, 0.0, 0.0]], [1.0, 0.5, 1.0]))
        assert len(found.cell) == (not gone)
    rows(0.76 * np.eye(2)[[row]], 0.0 * slope, np.array([0.75, 0.75]))
    assert not len(narrowed(problem_by_hand(PLANE), candidates([[0.0, 0.0, 0.0]], [1.0, 0.5, 1.0])).cell)


def test_what_two_rows_leave_of_a_coordinate_is_what_both_do(rows):
    """δ between 0.5 and 0.6 is there; below 0.5 and above 0.6 is not."""
    slope = np.zeros((1, 2, 3))
    slope[0, :, 1] = 1.0
    rows(np.array([[-0.3, -0.8]]), slope, np.array([0.3, 0.3]))
    found = narrowed(problem_by_hand(PLANE), candidates([[0.0, 0.0, 0.0]], [1.0, 1.0, 1.0]))
    np.testing.assert_allclose(found.centre[0, 1] + np.array([-1, 1]) * found.half[0, 1], [0.5, 0.6], rtol=1e-9)
    rows(np.array([[-0.3, -0.8]]), slope, np.array([0.2, 0.2]))
    assert not len(narrowed(problem_by_hand(PLANE), candidates([[0.0, 0.0, 0.0]], [1.0, 1.0, 1.0])).cell)


def test_real_lines_are_kept():
    """y = (1, 2)q in both ways: corners that are solutions stay in what is left."""
    for inverse in (False, True):
        boxes = candidates([[0.25, 0.35, 0.45]], [0.25, 1.0, 1.0])
        found = narrowed(problem_by_hand(PLANE), boxes, inverse)
        for q in (0.0, 0.25, 0.5):
            off = np.array([q, 2 * q]) - found.centre[0, 1:] - found.slopes[0, :, 0] * (q - 0.25)
            assert np.all(np.abs(off) <= found.half[0, 1:])
        assert np.all(found.half[0, 1:] < 0.6)
        assert not len(
            narrowed(problem_by_hand(PLANE), candidates([[0.25, 1.8, 0.45]], [0.25, 1.0, 1.0]), inverse).cell
        )


@pytest.mark.parametrize(
    ("kappa", "gone"), [(0.4, True), (0.55, True), (0.95, True), (1.0, False), (1.05, False), (1.9, False)]
)
def test_regular_boxes_are_dropped_where_that_is_asked(monkeypatch, kappa, gone):
    """Those asked about on which Z contracts, and no others."""
    seen = []

    def weights_for(bounds, radius):
        seen.append(radius)
        return np.ones_like(radius), np.full(len(radius), kappa)

    monkeypatch.setattr(narrowing, "weights_for", weights_for)
    boxes = candidates(2 * [[0.0, 0.0, 0.0]], 2 * [[0.25, 1.0, 1.0]])
    found = narrowed(problem_by_hand(PLANE), boxes, inverse=True, regular=np.array([True, False]))
    assert found.cell.tolist() == ([1] if gone else [0, 1])
    assert seen[0].shape == (1, 2)
    assert not seen[0].any()


def test_boxes_that_lean_hold_what_they_held():
    """|S′ − S|h wider, where that is at most twice as wide; where it is more they stay."""
    boxes = candidates(2 * [[0.0, 0.0, 0.0]], [[0.5, 1.0, 1.0], [0.5, 1.0, 0.1]], [[1.0], [0.0]])
    slopes = np.array([[[2.5], [-1.0]], [[2.5], [-1.0]]])
    found = narrowing._leaning(problem_by_hand(PLANE), boxes, slopes)
    np.testing.assert_allclose(found.half, [[0.5, 1.75, 1.5], [0.5, 1.0, 0.1]], rtol=2e-10)
    assert np.all(found.half[0, 1:] >= [1.75, 1.5])
    assert found.slopes.tolist() == [[[2.5], [-1.0]], [[1.0], [0.0]]]


def test_what_is_not_narrowed_stays_as_it_is():
    boxes = candidates([[0.0, 0.5, 0.5]], [[0.5, 1.0, 2.0]])
    half = boxes.half
    found = narrowing._within(problem_by_hand(PLANE), boxes, -half, np.array([[0.5, 1.0, 1.0]]))
    assert found.half[0, :2].tolist() == [0.5, 1.0]
    assert found.centre[0].tolist() == [0.0, 0.5, 0.0]
    np.testing.assert_allclose(found.half[0, 2], 1.5 + blur(np.zeros(1))[0], rtol=1e-15)
    tiny = narrowing._within(problem_by_hand(PLANE), boxes, 0.0 * half, 0.0 * half)
    np.testing.assert_allclose(tiny.half[0, 1:], 2.0**-51 * 1.5, rtol=1e-12)
