"""Regions, their cells and what waits in them, against real numbers and brute force: nothing is lost at any border."""

from fractions import Fraction
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering import pruning
from ccpin.covering.cells import Cells, CellStatus, CellTree, Growing, leaves_about, leaves_holding, place
from ccpin.covering.faces import _across
from ccpin.covering.region import Region, points_of
from ccpin.errors import InvalidInputError
from ccpin.proof.cell_tree import WHOLE
from ccpin.proof.rounding import blur
from tests.support.straight import problem_by_hand, straight
from tests.support.waiting import candidates, ranges_of

U = 2.0**-53


def region_of(rng, n, size=1.0, held=False):
    lower = size * rng.normal(size=n)
    upper = lower + size * rng.uniform(0.5, 1.5, n)
    if held:
        upper[-1] = lower[-1]
    return Region(lower, upper, np.zeros(n, dtype=bool))


def exact(region, corner, i):
    a, b = Fraction(region.lower[i]), Fraction(region.upper[i])
    return a + (b - a) * Fraction(int(corner), WHOLE)


@pytest.mark.parametrize("size", [1e-3, 1.0, 1e3])
def test_positions_are_nearest_doubles(size):
    """Or next to it: within u|x|, and u² of the region."""
    rng = np.random.default_rng(1)
    for _ in range(200):
        region, corner = region_of(rng, 3, size), rng.integers(0, WHOLE + 1, 3)
        for i, x in enumerate(region.position(corner)):
            stated = exact(region, corner[i], i)
            assert abs(Fraction(float(x)) - stated) <= Fraction(U) * abs(stated) * (1 + 4 * Fraction(U)) + Fraction(
                U**2 * 4 * size
            )


def test_points_are_in_the_cells_whose_borders_they_are_between():
    """A border is in the cell above it, the double below it in the one below; what is outside is in none."""
    rng = np.random.default_rng(2)
    for _ in range(200):
        region = region_of(rng, 2, 10.0 ** rng.integers(-2, 3))
        corner = rng.integers(1, WHOLE, 2)
        at = region.position(corner)
        below = np.nextafter(at, -np.inf)
        assert region.cell_coordinates(at[None]).tolist() == [corner.tolist()]
        assert region.cell_coordinates(below[None]).tolist() == [(corner - 1).tolist()]
        assert region.cell_coordinates(region.lower[None]).tolist() == [[0, 0]]
        assert region.cell_coordinates(region.upper[None]).tolist() == [[WHOLE - 1, WHOLE - 1]]
        for k in range(2):
            for beyond in (np.nextafter(region.lower, -np.inf), np.nextafter(region.upper, np.inf)):
                q = at.copy()
                q[k] = beyond[k]
                assert region.cell_coordinates(q[None]).tolist() == [[-1, -1]]
    held = region_of(rng, 2, held=True)
    assert held.cell_coordinates(held.lower[None]).tolist() == [[0, 0]]
    assert (held.span[1], held.width[1]) == (1.0, 0.0)
    np.testing.assert_allclose(held.volume, held.upper[0] - held.lower[0])


def test_whole_turns_lead_into_the_region():
    turn = Region(np.array([1.0, 0.0]), np.array([1.0 + 2.0 * np.pi, 1.0]), np.array([True, False]))
    for turns in (-3, 0, 2):
        np.testing.assert_allclose(turn.reduce(np.array([[2.5 + 2.0 * np.pi * turns, 7.0]])), [[2.5, 7.0]], rtol=1e-14)
    inside = np.array([[1.0, 0.0], [6.5, 0.0], [1.0 + 2.0 * np.pi - 1e-9, 0.0]])
    np.testing.assert_allclose(turn.reduce(inside), inside, rtol=1e-15)
    assert turn.cell_coordinates(np.array([[2.5 - 2 * np.pi, 2.0]])).tolist() == [[-1, -1]]


NAMES = ("a", "b")


@pytest.mark.parametrize(("corners", "slices", "fine"), [
    (([0.0, 0.0], [1.0, 1.0]), False, True), (([-3.0, -3.0], [-2.0, -2.0]), False, True),
    (([1.0, 1.0], [1.5, 1.5]), False, True),
    (([0.0, 0.0], [1.0, 0.0]), True, True), (([0.0, 0.0], [1.0, 0.0]), False, False),
    (([0.0, 0.0], [0.0, 0.0]), True, False), (([0.0, 2.0], [1.0, 1.5]), True, False),
    (([0.0, np.nan], [1.0, 1.0]), True, False), (([0.0, 0.0], [1.0, np.inf]), False, False),
    (([0.0], [1.0]), False, False), (([0.0, 0.0, 0.0], [1.0, 1.0, 1.0]), False, False), ("words", False, False),
])  # fmt: skip
def test_corners_are_below_one_another(corners, slices, fine):
    from ccpin.covering.region import corners_of

    if fine:
        np.testing.assert_array_equal(corners_of(corners, NAMES, slices), corners)
    else:
        with pytest.raises(InvalidInputError):
            corners_of(corners, NAMES, slices)


# Trees.


def grown(rng, n, cuts):
    tree = CellTree.whole(n)
    assert (tree.lower.tolist(), tree.size.tolist()) == ([[0] * n], [[WHOLE] * n])
    while cuts > 0:
        leaves = rng.permutation(tree.leaves())[: 1 + cuts // 3]
        cells, before = tree.split(leaves, rng.integers(0, n, len(leaves))), tree.cells
        assert cells.tolist() == list(range(len(before.child) - 2 * len(leaves), len(before.child)))
        cuts -= len(leaves)
    return tree


@pytest.fixture(params=[1, 2, 3])
def tree(request):
    return grown(np.random.default_rng(request.param), request.param, 40)


def holds(tree, cell, point):
    return np.all((tree.lower[cell] <= point) & (point < tree.lower[cell] + tree.size[cell]))


def test_halves_are_halves_and_leaves_tile(tree):
    assert tree.share(tree.leaves()) == 1.0
    for cell in np.flatnonzero(tree.child >= 0):
        low, high, k = tree.child[cell], tree.child[cell] + 1, tree.cut[cell]
        assert tree.lower[low].tolist() == tree.lower[cell].tolist()
        assert (tree.lower[high] - tree.lower[cell])[k] * 2 == tree.size[cell, k]
        assert (tree.size[low] + tree.size[high] - tree.size[cell]).tolist() == [
            x * (i != k) for i, x in enumerate(tree.size[cell])
        ]
        assert tree.status[cell] == CellStatus.SPLIT
    assert set(tree.leaves().tolist()) == set(np.flatnonzero(tree.child < 0).tolist())
    tree.status[tree.leaves()[:2]] = CellStatus.EMPTY
    assert tree.leaves(CellStatus.EMPTY).tolist() == tree.leaves()[:2].tolist()


def test_points_and_boxes_find_all_their_leaves(tree):
    rng, n = np.random.default_rng(3), tree.lower.shape[1]
    leaves = tree.leaves()
    points = np.concatenate(
        [rng.integers(0, WHOLE, (60, n)), tree.lower[leaves], tree.lower[leaves] + tree.size[leaves] - 1]
    )
    for point, leaf in zip(points, tree.locate(points), strict=True):
        assert tree.child[leaf] < 0
        assert holds(tree, leaf, point)
    beyond = np.full((1, n), 5)
    beyond[0, 0] = -1
    assert tree.locate(beyond).tolist() == [-1]
    low = points[:30]
    high = np.minimum(low + rng.integers(1, WHOLE // 3, low.shape), WHOLE)
    low[:5], high[:5] = tree.lower[leaves[:5]], tree.lower[leaves[:5]] + tree.size[leaves[:5]]
    found = set(zip(*(x.tolist() for x in tree.overlapping(low, high)), strict=True))
    stated = {
        (b, leaf) for b in range(30) for leaf in leaves.tolist()
        if np.all((tree.lower[leaf] < high[b]) & (low[b] < tree.lower[leaf] + tree.size[leaf]))
    }  # fmt: skip
    assert found == stated


def test_cells_are_where_their_numbers_say(tree):
    rng, n = np.random.default_rng(4), tree.lower.shape[1]
    region, leaves = region_of(rng, n), tree.leaves()
    centre, half = place(tree, region, leaves)
    for row, leaf in enumerate(leaves):
        for i in range(n):
            ends = [exact(region, tree.lower[leaf, i] + s * tree.size[leaf, i], i) for s in (0, 1)]
            assert abs(Fraction(centre[row, i]) - sum(ends) / 2) < Fraction(4e-16)
            assert abs(Fraction(half[row, i]) - (ends[1] - ends[0]) / 2) < Fraction(4e-16)
    for error in (0.9, 1.1):
        found = leaves_holding(tree, region, centre, error * half)
        assert np.array_equal(found, leaves if error < 1.0 else np.where(found == leaves, -1, found))
        assert error < 1.0 or not np.any(found == leaves)
    for side, error in product((-0.5, 0.5), (0.499, 0.501)):
        found = leaves_holding(tree, region, centre + side * half, error * half)
        assert np.array_equal(found == leaves, np.full(len(leaves), error < 0.5))
    assert leaves_about(tree, region, centre)[:, 0].tolist() == leaves.tolist()
    assert leaves_about(tree, region, centre).shape[1] == 1


def test_turned_points_may_be_on_either_side_of_a_border():
    """Those that are a turn away, and as far as that rounds them."""
    tree = CellTree.whole(2)
    tree.split(np.array([0]), np.array([0]))
    tree.split(np.array([1, 2]), np.array([1, 1]))
    region = Region(np.array([0.0, 0.0]), np.array([2.0 * np.pi, 1.0]), np.array([True, False]))
    q = np.array([[np.pi, 0.25], [3.0 * np.pi, 0.25], [2.0 + 2.0 * np.pi, 0.75], [1.0, 0.25]])
    found = [sorted(set(row)) for row in leaves_about(tree, region, q).tolist()]
    assert found == [[5], [3, 5], [4], [3]]
    off = float(blur(np.array(3.0 * np.pi)))
    for far, both in ((0.9, True), (1.2, False)):
        at = np.array([[3.0 * np.pi + far * off, 0.25]])
        assert (len(set(leaves_about(tree, region, at)[0].tolist())) == 2) == both


@pytest.mark.parametrize("far", [-1.05, -0.95, 0.95, 1.05])
def test_what_a_turned_point_may_be_off_by_is_its_blur(far):
    """4u (1 + |q|) of a point a thousand turns away, to either side of the border between two halves."""
    tree = CellTree.whole(1)
    tree.split(np.array([0]), np.array([0]))
    q = np.array([[2.0 * np.pi * 1000.3]])
    off, lower = float(blur(q)[0, 0]), 0.0
    for _ in range(3):
        region = Region(np.array([lower]), np.array([lower + 2.0 * np.pi]), np.ones(1, dtype=bool))
        gap = region.position(np.array([WHOLE // 2]))[0] - region.reduce(q)[0, 0]
        lower -= gap - far * off
    assert gap == pytest.approx(far * off, rel=0.01, abs=0.0)
    assert (len(set(leaves_about(tree, region, q)[0].tolist())) == 2) == (abs(far) < 1.0)


def test_trees_grow_by_what_is_put():
    tree, other = grown(np.random.default_rng(5), 2, 3), grown(np.random.default_rng(6), 2, 2)
    leaf, count = int(tree.leaves()[0]), len(tree.child)
    cells = other.cells
    tree.put(leaf, cells)
    assert len(tree.child) == count + len(cells.child) - 1
    for name in Cells._fields:
        assert np.array_equal(getattr(tree, name)[[leaf, *range(count, len(tree.child))]], getattr(cells, name))
    rows = Growing(Cells(*(array.copy() for array in cells)))
    for _ in range(200):
        rows.add(cells)
    assert np.array_equal(rows.rows.size, np.tile(cells.size, (201, 1)))


@pytest.mark.parametrize("wrapped", [False, True])
def test_faces_are_all_that_leaves_share(tree, wrapped):
    """Both ways, with their middles and areas, across the seam where there is one."""
    n = tree.lower.shape[1]
    region = Region(np.zeros(n), np.ones(n), np.full(n, wrapped))
    leaves = tree.leaves()
    for k, upper in product(range(n), (False, True)):
        found = _across(tree, region, leaves, k, upper)
        columns = (found.cell, found.leaf, found.at_cell, found.at_leaf, found.area)
        told = {
            (c, leaf): (tuple(a), tuple(b), area)
            for c, leaf, a, b, area in zip(*(column.tolist() for column in columns), strict=True)
        }
        stated = {}
        for cell, leaf in product(leaves.tolist(), leaves.tolist()):
            ends = tree.lower[cell] + tree.size[cell], tree.lower[leaf] + tree.size[leaf]
            mine, its = (ends[0][k], tree.lower[leaf, k]) if upper else (tree.lower[cell, k], ends[1][k])
            low, high = np.maximum(tree.lower[cell], tree.lower[leaf]), np.minimum(*ends)
            others = np.arange(n) != k
            if np.all((high > low)[others]) and (mine == its or (wrapped and mine % WHOLE == its % WHOLE)):
                middle = 0.5 * (low + high)
                at = np.where(others, middle, mine), np.where(others, middle, its)
                stated[cell, leaf] = tuple(at[0]), tuple(at[1]), float(np.prod(((high - low) / WHOLE)[others]))
        assert told == stated
        assert len(found.cell) == len(told)
        assert found.upper.tolist() == [upper] * len(told)


# What waits in cells.

LINE, PLANE = straight([[1.0]]), straight([[1.0], [2.0]])


def test_a_search_gives_back_all_it_does_not_drop(monkeypatch):
    """What is stuck and what still waits, when its rounds, its budget or its boxes are over."""
    runner = SimpleNamespace(
        problem=problem_by_hand(PLANE),
        map=lambda task, chunks: [task(problem_by_hand(PLANE), chunk) for chunk in chunks],
    )
    monkeypatch.setattr(pruning, "narrowed_both", lambda problem, ranges, waiting, singular: waiting)
    monkeypatch.setattr(
        pruning, "to_halve", lambda problem, waiting: (np.ones(len(waiting.cell), dtype=int), waiting.half[:, 1] > 0.3)
    )
    ranges = ranges_of([-9.0, -9.0], [9.0, 9.0])
    count = pruning._CHUNK + 5
    boxes = candidates(np.zeros((count, 3)), np.full((count, 3), 1.0), np.zeros((count, 2, 1)))
    for rounds, budget, kept, over in (
        (0, 10**6, 1, False),
        (1, 10**6, 2, False),
        (9, 10**6, 4, False),
        (9, 10, 1, True),
        (9, count, 2, True),
    ):
        search = pruning.Pruning(runner, ranges, budget)
        found = search.settled(boxes, rounds)
        assert (len(found.cell), search.over, search.complete) == (kept * count, over, True)
        np.testing.assert_allclose(np.bincount(found.cell, found.half[:, 1]), np.ones(count), rtol=1e-12)
    for budget, over in ((0, True), (1, False)):
        assert pruning.Pruning(runner, ranges, budget).over == over


def test_points_have_a_finite_number_for_each_coordinate():
    """One point or K of them, of as many columns as there are names."""
    assert points_of([1.0, 2.0], ("a", "b")).tolist() == [[1.0, 2.0]]
    assert points_of([[1.0], [2.0]], ("a",)).tolist() == [[1.0], [2.0]]
    for wrong in (1.0, [1.0], [1.0, 2.0, 3.0], [[[1.0, 2.0], [3.0, 4.0]]], [1.0, np.nan], [[np.inf, 0.0], [0.0, 0.0]]):
        with pytest.raises(InvalidInputError, match=r"2 finite columns \(a, b\)"):
            points_of(wrong, ("a", "b"))
