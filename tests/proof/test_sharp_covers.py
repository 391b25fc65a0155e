"""Trees of halves and the faces that their leaves share: what the kernel works out of them, against every pair."""

import numpy as np
import pytest

from ccpin.proof.cell_tree import WHOLE, faces_of, tree_of
from ccpin.proof.covers import one_function
from ccpin.proof.facts import NotProvedError


def grown(rng, n, cuts):
    """A tree of some random cuts: the coordinate each cell is halved along, and its lower half's number (−1: none)."""
    cut, child = np.zeros(1, dtype=np.int64), np.full(1, -1)
    for _ in range(cuts):
        leaf = rng.choice(np.flatnonzero(child < 0))
        cut[leaf], child[leaf] = rng.integers(n), len(cut)
        cut, child = np.append(cut, [0, 0]), np.append(child, [-1, -1])
    return cut, child


def pairs_that_touch(tree, leaves, wrapped):
    """(leaf, leaf, axis, seam) of every two leaves one of whose upper faces meets the other's lower one in an area."""
    found = set()
    for a in leaves:
        for b in leaves:
            for axis in range(len(wrapped)):
                others = np.arange(len(wrapped)) != axis
                low = np.maximum(tree.lower[a], tree.lower[b])
                high = np.minimum(tree.lower[a] + tree.size[a], tree.lower[b] + tree.size[b])
                if np.all((high > low)[others]):
                    end = tree.lower[a, axis] + tree.size[a, axis]
                    if end == tree.lower[b, axis]:
                        found.add((a, b, axis, False))
                    if wrapped[axis] and end == WHOLE and tree.lower[b, axis] == 0:
                        found.add((a, b, axis, True))
    return found


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize("cuts", [0, 1, 2, 7, 30])
def test_leaves_tile_the_region_and_all_their_faces_are_found_once(n, cuts):
    """Whatever is halved in whatever order, with coordinates that close on themselves and without."""
    rng = np.random.default_rng(100 * n + cuts)
    cut, child = grown(rng, n, cuts)
    wrapped = rng.random(n) < 0.5
    tree = tree_of(cut, child, n)
    assert tree.reached.all()
    leaves = np.flatnonzero(child < 0)
    volume = np.prod(tree.size[leaves] / WHOLE, axis=1).sum()
    assert volume == 1.0
    for cell in np.flatnonzero(child >= 0):
        low, high = child[cell], child[cell] + 1
        assert np.array_equal(tree.lower[low], tree.lower[cell])
        assert np.array_equal(tree.lower[high] + tree.size[high], tree.lower[cell] + tree.size[cell])
    faces = faces_of(tree, cut, child, wrapped)
    found = list(zip(*(column.tolist() for column in faces), strict=True))
    assert len(found) == len(set(found))
    assert set(found) == pairs_that_touch(tree, leaves.tolist(), wrapped)
    turns = faces.turns(n)
    assert np.array_equal(np.flatnonzero(turns.any(axis=1)), np.flatnonzero(faces.seam))
    assert np.array_equal(turns[np.arange(len(turns)), faces.axis], faces.seam)


@pytest.mark.parametrize(
    ("cut", "child"),
    [
        ([], []),
        ([0], [0]),
        ([0, 0, 0], [2, -1, -1]),
        ([0, 0, 0], [1, 1, -1]),
        ([0, 0, 0], [1, 0, -1]),
        ([2, 0, 0], [1, -1, -1]),
        ([0, 0, 0, 0, 0], [1, 3, 3, -1, -1]),
        ([0, 0, 0, 0], [1, 2, -1, -1]),
    ],
)
def test_what_is_no_tree_is_refused(cut, child):
    """No cell, one that is its own part, parts beyond the arrays, two parents, the root as a part, another axis."""
    with pytest.raises(NotProvedError):
        tree_of(np.array(cut, dtype=np.int64), np.array(child, dtype=np.int64), 2)


def test_an_edge_is_halved_down_to_one_unit():
    """32 times along one coordinate, and no further."""
    for times in (32, 33):
        cut = np.zeros(2 * times + 1, dtype=np.int64)
        child = np.full(2 * times + 1, -1)
        child[[0, *range(1, 2 * times - 1, 2)]] = np.arange(1, 2 * times + 1, 2)
        if times == 33:
            with pytest.raises(NotProvedError):
                tree_of(cut, child, 1)
        else:
            assert tree_of(cut, child, 1).size.min() == 1


def test_what_is_not_reached_is_no_cell():
    """Numbers that no cell has as a part are no cells."""
    assert tree_of(np.zeros(3, dtype=np.int64), np.full(3, -1), 2).reached.tolist() == [True, False, False]
    cut, child = np.zeros(6, dtype=np.int64), np.array([1, -1, -1, 4, -1, -1])
    tree = tree_of(cut, child, 1)
    assert tree.reached.tolist() == [True] * 3 + [False] * 3
    assert faces_of(tree, cut, child, np.zeros(1, dtype=bool)).upper.tolist() == [1]


def test_one_function_leaves_out_what_is_torn():
    """Of a torn pair the later box, never the seed's; then all that no way over the other faces joins to the seed's."""
    faces = np.array([[0, 1], [1, 2], [2, 3], [3, 0], [4, 5]])
    everything, none = [True] * 4 + [False] * 2, np.zeros((0, 2), dtype=int)
    assert one_function(faces, none, 0, 6).tolist() == everything
    assert one_function(faces, np.array([[2, 1]]), 0, 6).tolist() == [True, True, False, True, False, False]
    assert one_function(faces, np.array([[2, 1]]), 2, 6).tolist() == [True, False, True, True, False, False]
    assert one_function(faces, np.array([[1, 2], [2, 3]]), 1, 6).tolist() == [True, True, False, True, False, False]
    assert one_function(faces[:2], np.array([[0, 1]]), 0, 3).tolist() == [True, False, False]
    assert not one_function(faces, none, -1, 6).any()
