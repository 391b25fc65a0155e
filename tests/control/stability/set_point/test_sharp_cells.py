"""Cells: which share a face, what of them is covered, how they are laid, halved, proved, and glued where they meet."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.stability.set_point import certified_cells as module
from ccpin.control.stability.set_point.certified_cells import Cell, CellStore, _places_beside, aligned, holding
from ccpin.proof.newton import Boxes
from ccpin.proof.rounding import UNIT_ROUNDOFF
from tests.support.flat_cells import STRETCH, Flat, boxes_about

CORNERS = [((0.0, 0.0), (2.0, 2.0)), ((2.0, 1.0), (6.0, 3.0)), ((-1.0, 2.0), (1.0, 4.0))]


@pytest.mark.parametrize("answers", [(True, False), (False, True), (False, False)])
def test_cells_agree_where_they_are_glued_at_the_middle_of_their_face(monkeypatch, answers):
    asked = []

    def glued(problem, first, delta, second, other):
        asked.append((first.centre + delta, second.centre + other, first.centre, second.centre))
        return np.array(answers)

    monkeypatch.setattr(module, "glued", glued)
    system = SimpleNamespace(independent=np.array([0, 1]))
    reading = SimpleNamespace(problem=SimpleNamespace(system=system))
    store = CellStore(reading, None, None, None)
    for low, high in CORNERS:
        lower, upper = np.array(low), np.array(high)
        centre = 0.5 * (lower + upper)[None]
        box = Boxes(centre, *[centre] * 6, np.array([0.5]))
        store.cells.append(Cell(lower, upper, 0, None, box=box))
    assert store.agree(0, [1, 2]) == list(answers)
    ((first, second, others, own),) = asked
    np.testing.assert_array_equal(first, [[2.0, 1.5], [0.5, 2.0]])
    np.testing.assert_array_equal(second, first)
    np.testing.assert_array_equal(others, [[4.0, 2.0], [0.0, 3.0]])
    np.testing.assert_array_equal(own, [[1.0, 1.0], [1.0, 1.0]])
    assert store.agree(0, []) == []


def test_boxes_hold_points_to_half_of_what_theorem_ks_are_wider():
    """Of every coordinate, at both ends."""
    lower, upper = np.array([[2.0, -1.0], [8.0, 8.0]]), np.array([[4.0, 1.0], [9.0, 9.0]])
    room = 0.5 * (1e-14 + 4 * UNIT_ROUNDOFF * np.array([3.0 + 1.0, 0.0 + 1.0]))
    for k, sign, end in ((0, 1, 4.0), (0, -1, 2.0), (1, 1, 1.0), (1, -1, -1.0)):
        for share, held in ((0.8, True), (1.3, False), (1e13, False)):
            q = np.array([3.0, 0.0])
            q[k] = end + sign * share * room[k]
            assert (0 in holding(lower, upper, q)) is held
    assert holding(lower, upper, np.array([8.5, 8.5])).tolist() == [1]


def cells(*corners):
    """A store of cells with these corners."""
    store = CellStore(SimpleNamespace(problem=None), None, None, None)
    for low, high in corners:
        store.cells.append(Cell(np.array(low, float), np.array(high, float), 0, None))
    return store


def shared(*corners):
    """The corners of what two cells share, asked both ways."""
    store = cells(*corners)
    one, other = store.face(0, 1), store.face(1, 0)
    if one is None or other is None:
        assert one is other
        return None
    np.testing.assert_array_equal(one.lower, other.lower)
    np.testing.assert_array_equal(one.upper, other.upper)
    return one


def test_what_two_cells_share():
    """A face of positive area, flat in one coordinate; no corner, no edge, no inside."""
    one = ((0.0, 0.0), (2.0, 2.0))
    face = shared(one, ((2.0, 1.0), (4.0, 3.0)))
    np.testing.assert_array_equal([face.lower, face.upper], [[2.0, 1.0], [2.0, 2.0]])
    np.testing.assert_array_equal(face.middle, [2.0, 1.5])
    face = shared(((2.0, 1.0), (4.0, 3.0)), ((-3.0, 3.0), (3.0, 9.0)))
    np.testing.assert_array_equal([face.lower, face.upper], [[2.0, 3.0], [3.0, 3.0]])
    for other in (
        ((2.0, 2.0), (3.0, 3.0)), ((1.0, 1.0), (3.0, 3.0)), ((3.0, 0.0), (4.0, 2.0)), ((2.0, 2.5), (3.0, 3.0)),
    ):  # fmt: skip
        assert shared(one, other) is None
    space = shared(((0.0,) * 3, (1.0,) * 3), ((1.0, 0.5, -1.0), (2.0, 3.0, 0.25)))
    np.testing.assert_array_equal([space.lower, space.upper], [[1.0, 0.5, 0.0], [1.0, 1.0, 0.25]])


def test_corners_that_were_rounded_twice_are_one():
    """To 16 u(1 + |q|), the middle of what there is, and no chain of farther ones; others stay as they are."""
    near, far = 15.0 * UNIT_ROUNDOFF, 17.0 * UNIT_ROUNDOFF
    for at in (0.0, 3.0, -9.0):
        size = 1.0 + abs(at)
        lower = np.array([[at, 5.0], [at + near * size, 7.0], [at - 1.0, -2.0]])
        upper = np.array([[at + 2.0, 7.0], [at + 1.0, 8.0], [at, 5.0]])
        low, high = aligned(lower, upper)
        assert low[0, 0] == low[1, 0] == high[2, 0]
        assert at <= low[0, 0] <= at + near * size
        np.testing.assert_array_equal(low[:, 1], lower[:, 1])
        np.testing.assert_array_equal(high[:, 1], upper[:, 1])
        np.testing.assert_array_equal(high[:2, 0], upper[:2, 0])
        lower[1, 0] = at + 1.1 * far * size
        low, high = aligned(lower, upper)
        assert (low[0, 0], high[2, 0], low[1, 0]) == (at, at, lower[1, 0])


def test_faces_that_neighbours_cover():
    """The others of its faces are exposed, and of one what is left of it."""
    below, above = ((3.0, 1.0), (9.0, 2.0)), ((3.0, 2.0), (9.0, 4.0))
    store = cells(((1.0, 1.0), (3.0, 3.0)), below, above, ((5.0, 5.0), (6.0, 6.0)))
    store.cells[0].neighbours = {1, 2, 3}
    ends = {(1.0, 1.0, 1.0, 3.0), (1.0, 1.0, 3.0, 1.0), (1.0, 3.0, 3.0, 3.0)}
    assert {(*face.lower, *face.upper) for face in store.exposed(0)} == ends
    for neighbours, left in (({1}, (3.0, 2.0, 3.0, 3.0)), ({2}, (3.0, 1.0, 3.0, 2.0))):
        store.cells[0].neighbours = neighbours
        assert {(*face.lower, *face.upper) for face in store.exposed(0)} == ends | {left}


def test_places_of_a_lattice():
    assert sorted(_places_beside((5, -2, 0))) == [
        (4, -2, 0), (5, -3, 0), (5, -2, -1), (5, -2, 1), (5, -1, 0), (6, -2, 0),
    ]  # fmt: skip


def corners(cell):
    return (*cell.lower, *cell.upper)


def test_lattices_are_laid_cell_by_cell(monkeypatch):
    """Beside a cell's own place where there is none yet, edge to edge, each with its neighbours."""
    flat = Flat(monkeypatch, np.eye(2))
    store = flat.laid([1.0, 2.0])
    assert (store.proved, store.cells[0].state, corners(store.cells[0])) == (1, "proved", (-1.0, -2.0, 1.0, 2.0))
    store.extend(0)
    places = {cell.lattice: corners(cell) for cell in store.cells}
    assert places == {
        (0, 0): (-1.0, -2.0, 1.0, 2.0), (1, 0): (1.0, -2.0, 3.0, 2.0), (-1, 0): (-3.0, -2.0, -1.0, 2.0),
        (0, 1): (-1.0, 2.0, 1.0, 6.0), (0, -1): (-1.0, -6.0, 1.0, -2.0),
    }  # fmt: skip
    assert store.cells[0].neighbours == {1, 2, 3, 4}
    beside = next(k for k, cell in enumerate(store.cells) if cell.lattice == (1, 0))
    store.extend(beside)
    assert len(store.cells) == 8
    assert len({cell.lattice for cell in store.cells}) == 8
    corner = next(cell for cell in store.cells if cell.lattice == (1, 1))
    assert {store.cells[k].lattice for k in corner.neighbours} == {(1, 0), (0, 1)}
    apart = store._append(Cell(np.zeros(2), np.ones(2), 0, None))
    store.extend(apart)
    assert len(store.cells) == 9
    still = flat.store()
    still.add_first(boxes_about([0.0, 0.0], [1.0, 1.0]), -np.ones(2), np.ones(2))
    still.extend(0)
    assert len(still.cells) == 1


def test_halves_of_a_cell(monkeypatch):
    """Across the edge that σ stretches most; they take its place in the lattice and among its neighbours."""
    store = Flat(monkeypatch, np.eye(2)).laid([1.0, 2.0])
    store.extend(0)
    right = next(k for k, cell in enumerate(store.cells) if cell.lattice == (1, 0))
    first, second = store.split(right, np.array([3.0, 1.0]))
    assert (corners(store.cells[first]), corners(store.cells[second])) == ((1.0, -2.0, 2.0, 2.0), (2.0, -2.0, 3.0, 2.0))
    assert [store.cells[k].depth for k in (first, second)] == [1, 1]
    assert [store.cells[k].lattice for k in (first, second)] == [(1, 0)] * 2
    assert not store.cells[right].live
    assert right not in store.cells[0].neighbours
    assert first in store.cells[0].neighbours
    assert second not in store.cells[0].neighbours
    assert store.cells[first].neighbours == {0, second}
    assert store.cells[second].neighbours == {first}
    low, high = store.split(second, np.array([1.0, 1.0]))
    assert (corners(store.cells[low]), corners(store.cells[high])) == ((2.0, -2.0, 3.0, 0.0), (2.0, 0.0, 3.0, 2.0))
    assert [store.cells[k].depth for k in (low, high)] == [2, 2]
    store.extend(right)  # what is laid beside the place meets the halves that touch it
    far = next(cell for cell in store.cells if cell.lattice == (2, 0))
    assert far.neighbours == {low, high}
    over = next(cell for cell in store.cells if cell.lattice == (1, 1))
    assert {first, high} <= over.neighbours
    odd = cells(((-5.0, 0.0), (1.0, 3.0)))
    odd.split(0, np.array([1.0, 1.0]))
    assert corners(odd.cells[1]) == (-5.0, 0.0, -2.0, 3.0)
    assert odd.cells[1].neighbours == {2}


def test_cells_are_proved_from_others(monkeypatch):
    """Their own boxes, from σ at the common point; glued there to what they are proved from, or failed."""
    flat = Flat(monkeypatch, np.eye(2), proved=lambda centre, half: centre[1] < 3.0, same=lambda a, b: b[0] < 1.0)
    store = flat.laid([1.0, 2.0])
    store.extend(0)
    names = {cell.lattice: k for k, cell in enumerate(store.cells)}
    points = {(1, 0): [1.0, 0.5], (-1, 0): [-1.0, 0.25], (0, 1): [0.5, 2.0]}
    flat.asked.clear(), flat.glued.clear()
    store.prove_from([(0, np.array(point), names[place]) for place, point in points.items()])
    ((asked,), ((parents, at_parent, boxes, at_own),)) = flat.asked, flat.glued
    np.testing.assert_array_equal(asked.centre, [[2.0, 0.0], [-2.0, 0.0], [0.0, 4.0]])
    np.testing.assert_array_equal(asked.half, [[1.0, 2.0]] * 3)
    np.testing.assert_array_equal(asked.start[:, :2], list(points.values()))
    np.testing.assert_allclose(asked.start[:, 2], np.array(list(points.values())) @ STRETCH[:2] + 0.125)
    np.testing.assert_array_equal(asked.turn_to, np.zeros((3, 3)))
    np.testing.assert_array_equal(parents.centre[:, :2], np.zeros((2, 2)))
    np.testing.assert_array_equal(at_parent, [[1.0, 0.5], [-1.0, 0.25]])
    np.testing.assert_array_equal(boxes.centre[:, :2] + at_own, at_parent)
    np.testing.assert_array_equal(at_own, [[-1.0, 0.5], [1.0, 0.25]])
    assert [store.cells[names[p]].state for p in ((1, 0), (-1, 0), (0, 1), (0, -1))] == [
        "failed", "proved", "failed", "untried",
    ]  # fmt: skip
    assert store.proved == 2
    own = store.cells[names[-1, 0]]
    np.testing.assert_array_equal(own.box.centre[0, :2], [-2.0, 0.0])
    assert own.well.value == 2.0
    beyond = store.stretch(names[-1, 0])
    np.testing.assert_allclose(beyond, np.sqrt(1.0 + STRETCH[:2] ** 2))


@pytest.mark.parametrize("fails", [None, 0, 1])
def test_both_halves_are_proved_or_none(monkeypatch, fails):
    """Each at its own middle, from the whole."""
    sides = (-1.0, 1.0)
    flat = Flat(monkeypatch, np.eye(2), proved=lambda c, h: fails is None or np.sign(c[1]) != sides[fails])
    store = flat.laid([1.0, 2.0])
    flat.asked.clear(), flat.glued.clear()
    found = store.halve_proved(0)
    np.testing.assert_array_equal(flat.asked[0].centre, [[0.0, -1.0], [0.0, 1.0]])
    np.testing.assert_array_equal(flat.asked[0].start[:, :2], flat.asked[0].centre)
    assert found == ((1, 2) if fails is None else None)
    assert store.proved == (3 if fails is None else 2)
    if fails is None:
        np.testing.assert_array_equal(flat.glued[0][1], [[0.0, -1.0], [0.0, 1.0]])
        np.testing.assert_array_equal(flat.glued[0][3], np.zeros((2, 2)))
        assert store.halve_proved(2) == (3, 4)  # the upper half, whose middle is not 0
        np.testing.assert_array_equal(flat.asked[1].start[:, :2], [[0.0, 0.5], [0.0, 1.5]])
        np.testing.assert_array_equal(flat.asked[1].start[:, 2], STRETCH[1] * np.array([0.5, 1.5]) + 0.125)
        np.testing.assert_array_equal(flat.glued[1][1], [[0.0, -0.5], [0.0, 0.5]])


def test_cells_that_come_proved(monkeypatch):
    """Neighbours are those that touch and are told; none of it is work done here."""
    flat = Flat(monkeypatch, np.eye(2))
    store = flat.store()
    lower, upper = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.array([[1.0, 1.0], [2.0, 1.0], [1.0, 2.0]])
    store.add_proved(boxes_about(0.5 * (lower + upper), 0.5 * (upper - lower)), lower, upper, [(0, 1), (1, 2)])
    assert [cell.neighbours for cell in store.cells] == [{1}, {0}, set()]
    assert [cell.state for cell in store.cells] == ["proved"] * 3
    assert store.proved == 0
    store.part(0, 1)
    assert [cell.neighbours for cell in store.cells] == [set()] * 3
