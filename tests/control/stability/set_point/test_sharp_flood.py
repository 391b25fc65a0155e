"""Levels that floods find, where U is known: the least value on the boundary of what was taken, attained."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.stability.set_point.certified_cells import Cell, CellStore
from ccpin.control.stability.set_point.flood import Flood, FloodLimits
from ccpin.control.stability.set_point.well import Range
from tests.support.flat_cells import Flat, boxes_about

ORIGIN = np.zeros(2)
STIFF = np.diag([2.0, 8.0])  # U = x² + 4y²


def inside(x, y):
    return lambda centre, half: bool(np.all(np.abs(centre) + half <= [x, y]))


def flooded(store, depth=0, cells=999, good=lambda well: True, go_on=lambda told: True, tolerance=5e-3):
    return Flood(store, good, FloodLimits(depth, cells, tolerance), go_on).run(ORIGIN)


def test_the_level_is_the_least_value_on_the_edge_of_the_domain(monkeypatch):
    """25 cells [−2.5, 2.5] × [−1.25, 1.25], at the middle of whose four edges U is 6.25."""
    flat = Flat(monkeypatch, STIFF, proved=inside(2.5, 1.25))
    store = flat.laid([0.5, 0.25])
    found = flooded(store)
    assert found.level == pytest.approx(6.25, rel=1e-12)
    assert found.limit == "domain"
    assert flat.potential(found.point) == pytest.approx(6.25)
    assert len(found.members) == 25
    assert all(store[k].state == "proved" for k in found.members)
    narrow = Flat(monkeypatch, STIFF, proved=inside(2.5, 0.75)).laid([0.5, 0.25])
    assert flooded(narrow).level == pytest.approx(4.0 * 0.75**2, rel=1e-12)
    assert flooded(narrow).level == pytest.approx(4.0 * 0.75**2, rel=1e-12)  # again, of what is there


def test_levels_are_lower_by_what_wells_are_off(monkeypatch):
    flat = Flat(monkeypatch, STIFF, proved=inside(2.5, 1.25), remainder=lambda half: 0.125)
    assert flooded(flat.laid([0.5, 0.25])).level == pytest.approx(6.125, rel=1e-12)


def steep(centre, half):
    """‖∂g/∂q‖ = |x| at most."""
    return abs(centre[0]) + half[0]


@pytest.mark.parametrize(("depth", "level"), [(0, 2.25), (1, 2.25), (2, 4.0), (4, 4.0), (6, 4.0), (8, 2.0625**2)])
def test_cells_where_gravity_is_too_steep_are_halved(monkeypatch, depth, level):
    """Of |x| < 2.1 as much as halves, quarters, … of the lattice's cells do."""
    store = Flat(monkeypatch, STIFF, beta=steep).laid([0.5, 0.25])
    found = flooded(store, depth, good=lambda well: well.beta < 2.1)
    assert found.level == pytest.approx(level, rel=1e-12)
    assert found.limit == "gain"
    assert max(store[k].depth for k in found.members) == {2.25: 0, 4.0: 2}.get(level, depth)


def test_halving_ends_where_little_can_be_gained(monkeypatch):
    """What U rises across a cell is less than a tenth of the tolerance."""
    store = Flat(monkeypatch, STIFF, beta=steep).laid([0.5, 0.25])
    found = flooded(store, 60, good=lambda well: well.beta < 2.1, tolerance=0.2)
    assert 0.97 * 2.1**2 < found.level < 2.1**2
    assert found.limit == "gain"
    assert max(cell.depth for cell in store.cells) < 16


def test_levels_that_are_not_sharp_are_tightened(monkeypatch):
    """Members are halved until their wells bear the level out."""
    flat = Flat(monkeypatch, STIFF, proved=inside(2.5, 1.25), remainder=lambda half: half[0] ** 2)
    store = flat.laid([0.5, 0.25])
    assert flooded(store).level == pytest.approx(6.0)
    found = flooded(store, 30, tolerance=0.02)
    assert found.level == pytest.approx(6.25 - 0.125**2)  # 2 / 64 is below 2 % of it, 2 / 16 is not
    assert found.limit == "domain"


@pytest.mark.parametrize(("depth", "expected"), [(3, (0.0, "depth")), (4, (0.0625, "gain"))])
def test_floods_start_from_good_cells_around_the_set_point(monkeypatch, depth, expected):
    """All four of them that meet at it, halved as often as it takes."""
    flat = Flat(monkeypatch, STIFF, beta=lambda c, h: max(steep(c, h), 2.0 * (abs(c[1]) + h[1])))
    store = flat.laid([0.5, 0.25])
    found = flooded(store, depth, good=lambda well: well.beta < 0.3)
    assert (found.level, found.limit) == pytest.approx(expected) if expected[0] else (0.0, "depth")
    assert len(found.members) == (4 if depth == 4 else 0)
    again = flooded(store, 0, cells=20)  # of other cells, when some were halved
    assert all(store[k].live for k in again.members)


def test_floods_that_do_not_start(monkeypatch):
    """No cell there, none proved, none allowed, halves that fail, work that is over."""
    flat = Flat(monkeypatch, STIFF, beta=steep)
    store = flat.laid([0.5, 0.25])
    found = Flood(store, lambda well: True, FloodLimits(9, 99), lambda told: True).run(np.array([9.0, 0.0]))
    assert (found.level, found.members, found.limit) == (0.0, (), "domain")
    assert flooded(store, go_on=lambda told: False).limit == "interrupted"
    assert flooded(store, 9, 1, good=lambda well: False).limit == "budget"
    assert flooded(store, 9, 2, good=lambda well: False).limit == "budget"
    flat.proved = lambda centre, half: centre[1] < 0.0
    assert flooded(flat.laid([0.5, 0.25]), 9, good=lambda well: False).limit == "domain"
    untried = flat.store()
    untried.cells.append(Cell(-np.ones(2), np.ones(2), 0, None))
    assert flooded(untried, 9).limit == "domain"


def test_floods_end_when_they_are_to(monkeypatch):
    """What was proved until then stands; before every cell it is asked, with how far it is."""
    flat = Flat(monkeypatch, STIFF)
    spent = flooded(flat.laid([0.5, 0.25]), cells=30)
    assert spent.limit == "budget"
    assert 0.25 <= spent.level == pytest.approx(flat.potential(spent.point), rel=1e-12)
    told = []
    ended = flooded(flat.laid([0.5, 0.25]), go_on=lambda at: told.append(at) or len(told) < 12)
    assert ended.limit == "interrupted"
    assert ended.level == told[-1].level > 0.0
    assert [a.cells for a in told] == sorted(a.cells for a in told)
    store = flat.laid([0.5, 0.25])
    for proved, over in ((9, False), (10, True), (11, True)):
        store.proved = proved
        assert Flood(store, None, FloodLimits(9, 10), None)._spent() is over


def test_a_face_where_members_disagree_bounds_the_level(monkeypatch):
    """Between the cells about (1, 0.5) and (0, 0.5): at (0.5, 0.25), where U is ½."""
    flat = Flat(monkeypatch, STIFF)
    real = CellStore.agree

    def told(self, number, others):
        pair = {(0.0, 0.5), (1.0, 0.5)}
        centre = [tuple(0.5 * (self[k].lower + self[k].upper)) for k in (number, *others)]
        found = real(self, number, others)
        return [same and {centre[0], other} != pair for same, other in zip(found, centre[1:], strict=True)]

    monkeypatch.setattr(CellStore, "agree", told)
    store = flat.laid([0.5, 0.25])
    found = flooded(store, cells=60)
    assert found.level == pytest.approx(0.5, rel=1e-12)
    at = {tuple(0.5 * (cell.lower + cell.upper)): k for k, cell in enumerate(store.cells)}
    first, second = at[0.0, 0.5], at[1.0, 0.5]
    assert second not in store[first].neighbours
    assert first not in store[second].neighbours


@pytest.mark.parametrize(("lattice", "depth", "asks"), [(None, 0, False), (None, 1, True), ((0, 0), 0, True)])
def test_whom_new_members_are_asked_about(monkeypatch, lattice, depth, asks):
    """All members beside them, but an atlas's boxes, which are neighbours where they are glued."""
    flat = Flat(monkeypatch, np.eye(1))
    store = flat.store()
    low = np.array([[0.0], [1.0], [2.0]])
    store.add_proved(boxes_about(low + 0.5, np.full((3, 1), 0.5)), low, low + 1.0, [(0, 1), (1, 2)])
    for cell in store.cells:
        cell.lattice, cell.depth = lattice, depth
    asked = []
    monkeypatch.setattr(CellStore, "agree", lambda self, k, others: asked.append((k, others)) or [False] * len(others))
    flooding = Flood(store, lambda well: True, FloodLimits(9, 99), lambda told: True)
    for number in (0, 2, 1):
        flooding._add(number)
    assert asked == ([(0, []), (2, []), (1, [0, 2])] if asks else [])
    assert [cell.neighbours for cell in store.cells] == ([set()] * 3 if asks else [{1}, {0, 2}, {1}])
    edges = {(e.inside, float(e.face.lower[0])) for e in flooding._heap if e.beyond == -1}
    outer = {(0, 0.0), (2, 3.0)}
    assert edges == (outer | {(0, 1.0), (1, 1.0), (1, 2.0), (2, 2.0)} if asks else outer)
    assert list(flooding._members.items()) == [(0, 1), (2, 2), (1, 3)]


# Chains: cells [k, k + 1] with values of U told at their ends.


class Told:
    """A well of one coordinate whose values at the ends of the cell are told, and its least."""

    def __init__(self, values, least, beta=1.0):
        self.values, self.least, self.beta, self.effort = values, least, beta, 1.0

    def range_over(self, lower, upper):
        value = self.values[float(lower[0])] if lower[0] == upper[0] else self.least
        return Range(value, value, lower)


def chain(monkeypatch, values, betas=None):
    """Glued cells between 0, 1, …, at which U is as told."""
    flat = Flat(monkeypatch, np.eye(1))
    store = flat.store()
    count = len(values) - 1
    for k in range(count):
        betas_k = 1.0 if betas is None else betas[k]
        well = Told({float(k): values[k], float(k + 1): values[k + 1]}, min(values[k : k + 2]) - 0.25, betas_k)
        store.cells.append(Cell(np.array([float(k)]), np.array([k + 1.0]), 0, None, state="proved", well=well))
        store.cells[k].neighbours = {j for j in (k - 1, k + 1) if 0 <= j < count}
    return store


def along(store, start, good=lambda well: True):
    return Flood(store, good, FloodLimits(0, 99), lambda told: True).run(np.array([start]))


def test_the_highest_of_the_lowest_faces_is_kept(monkeypatch):
    """With the members of then: what is taken later is not proved to be below it."""
    found = along(chain(monkeypatch, [2.0, 1.0, 1.5, 0.9]), 0.5)
    assert (found.level, found.members, found.limit) == (1.5, (0, 1), "domain")
    assert float(found.point[0]) == 3.0
    found = along(chain(monkeypatch, [0.9, 1.5, 1.0, 2.0]), 2.5)  # into the cell of number 0
    assert (found.level, found.members) == (1.5, (2, 1))
    found = along(chain(monkeypatch, [4.0, 1.0, 3.0, 2.0, 5.0]), 1.5)
    assert (found.level, sorted(found.members)) == (4.0, [0, 1, 2, 3])


@pytest.mark.parametrize("level", [0.0, -0.5])
def test_levels_that_are_not_positive_prove_nothing(monkeypatch, level):
    found = along(chain(monkeypatch, [1.0, level]), 0.5)
    assert (found.level, found.members) == (0.0, ())


def test_cells_that_are_not_good_are_boundary(monkeypatch):
    found = along(
        chain(monkeypatch, [4.0, 1.0, 3.0, 2.0, 5.0], [1.0, 1.0, 7.0, 1.0]), 1.5, lambda well: well.beta < 7.0
    )
    assert (found.level, sorted(found.members), found.limit) == (3.0, [0, 1], "gain")


def test_entries_of_what_is_no_boundary_any_more(monkeypatch):
    """From members only; to cells that are there and are none."""
    store = chain(monkeypatch, [4.0, 1.0, 3.0, 2.0, 5.0])
    flooding = Flood(store, lambda well: True, FloodLimits(0, 99), lambda told: True)
    flooding._members = {0: 1, 1: 2}
    store.cells[3].live = False
    for inside_of, beyond, current in ((2, -1, False), (1, -1, True), (1, 2, True), (1, 0, False), (1, 3, False)):
        entry = SimpleNamespace(inside=inside_of, beyond=beyond)
        assert flooding._current(entry) is current
