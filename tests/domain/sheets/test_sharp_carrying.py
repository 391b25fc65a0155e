"""How boxes are carried from cell to cell and glued: whose they are, where they meet, and which cells are tried."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering.cells import CellStatus, CellTree, place
from ccpin.covering.region import Region
from ccpin.domain.sheets import cover as module
from ccpin.domain.sheets.cover import CountedRegion, Front, Glued, Members, glued_pairs, parts_of
from ccpin.proof.cell_tree import LEVELS
from ccpin.proof.newton import Boxes

SYSTEM = SimpleNamespace(
    dependent=np.array([1]), independent=np.array([0]), periodic=np.array([False, False]), n=1, m=1, n_free=2
)
PROBLEM = SimpleNamespace(system=SYSTEM)
REGION = Region(np.array([0.0]), np.array([4.0]), np.array([False]))
UNREACHED, CERTIFIED, UNDECIDED, EMPTY = (
    CellStatus.UNREACHED, CellStatus.CERTIFIED, CellStatus.UNDECIDED, CellStatus.EMPTY
)  # fmt: skip
LEAVES = np.array([3, 4, 5, 6])  # over [0, 1], [1, 2], [2, 3], [3, 4]


def quarters(*statuses):
    """The region in four cells."""
    tree = CellTree.whole(1)
    tree.split(np.array([0]), np.array([0]))
    tree.split(np.array([1, 2]), np.array([0, 0]))
    tree.status[LEAVES] = statuses or (UNREACHED,) * 4
    return tree


def boxes_at(centres):
    """Flat boxes about (q, 0), told apart by their q."""
    centres = np.asarray(centres, dtype=float)
    count = len(centres)
    one = np.ones((count, 1, 1))
    row, directions = one[:, 0], np.tile([[1.0], [0.0]], (count, 1, 1))
    centre = np.column_stack([centres, np.zeros(count)])
    return Boxes(centre, row, directions, one, one, row.copy(), row.copy(), np.full(count, 0.5))


def glued_of(count):
    numbers = np.arange(count)
    return Glued(numbers, numbers, np.zeros((count, 1)), np.zeros((count, 1)))


def front_over(tree, centres=(), cells=()):
    """A front with boxes over cells."""
    made = object.__new__(Front)
    made.runner, made.problem, made.region, made.tree = None, PROBLEM, REGION, tree
    made.boxes, made.members = boxes_at(centres), Members(np.array(cells, dtype=int), np.arange(len(cells)))
    made.glued, made._passed, made._smallest = glued_of(0), set(), 1
    made.part = np.full(len(tree.child), -1)
    made.part[LEAVES] = 0
    return made


def contacts_at(cells):
    cells = np.array(cells)
    zero = np.zeros((len(cells), 1))
    return module._Continued(
        cells, boxes_at(10.0 + cells), np.ones(len(cells), bool), cells * 0, zero + 1.0, zero + 2.0
    )


# Parts


def test_parts_are_what_hangs_together():
    """Three of four cells in a row; then, of a full turn, all that are beside the seam too."""
    tree, regular = quarters(), np.array([3, 5, 6])
    assert [part.tolist() for part in parts_of(tree, REGION, regular)] == [[5, 6], [3]]
    wrapped = Region(REGION.lower, REGION.upper, np.array([True]))
    assert [part.tolist() for part in parts_of(tree, wrapped, regular)] == [[3, 5, 6]]
    assert parts_of(tree, REGION, regular[:0]) == []


def test_a_front_knows_the_parts(monkeypatch):
    """And begins with none of their cells reached; the smallest cells are those of the depth told."""
    empty = SimpleNamespace(boxes=SimpleNamespace(without_rows=lambda n: boxes_at(())))
    monkeypatch.setattr(module, "certify_points", lambda *_: empty)
    tree = quarters(*(UNDECIDED,) * 4)
    parts = [CountedRegion(np.array([3, 4]), 3, None), CountedRegion(np.array([6]), 6, None)]
    front = Front(SimpleNamespace(problem=PROBLEM), REGION, tree, parts, 5, None)
    assert front.part.tolist() == [-1, -1, -1, 0, 0, -1, 1]
    assert tree.status[LEAVES].tolist() == [UNREACHED, UNREACHED, UNDECIDED, UNREACHED]
    assert front._smallest * 2**5 == 2**LEVELS


# Which cells are tried


def test_cells_beside_certified_ones_of_their_part_are_tried():
    """From each side once, those that were not tried before."""
    for statuses, parts, tried in (
        ((CERTIFIED, UNREACHED, UNREACHED, UNREACHED), (0, 0, 0, 0), [4]),
        ((UNREACHED, CERTIFIED, UNREACHED, UNREACHED), (0, 0, 0, 0), [3, 5]),
        ((CERTIFIED, UNREACHED, CERTIFIED, UNREACHED), (0, 0, 0, 0), [4, 6]),
        ((CERTIFIED, UNREACHED, UNREACHED, UNREACHED), (0, 1, 1, 1), []),
        ((CERTIFIED, UNDECIDED, CERTIFIED, CERTIFIED), (0, 0, 0, 0), []),
    ):
        front, asked = front_over(quarters(*statuses)), []
        front.part[LEAVES] = parts
        front._try = lambda contacts, asked=asked: asked.extend(contacts.cell.tolist())
        assert front._wave() == bool(tried)
        assert sorted(asked) == tried


def test_single_sheets_are_carried_over_what_is_neither_certified_nor_empty():
    """Each from a box once; whether any was new."""
    front = front_over(quarters(CERTIFIED, UNDECIDED, CERTIFIED, EMPTY), (0.5, 2.5, 1.25), (3, 5, 4))
    front.members = Members(np.array([3, 4, 5]), np.array([0, 2, 1]))
    asked, known = [], [False]

    def continued(contacts, origin):
        asked.extend(zip(contacts.cell.tolist(), origin.tolist(), strict=True))
        return contacts_at(contacts.cell)

    front._continued = continued
    front._known = lambda cells, boxes: np.full(len(cells), known[0])
    front._passed = {(4, 0)}
    assert front._pass()
    assert asked == [(4, 1)]
    assert len(front.boxes.kappa) == 4
    assert not front._pass()
    assert asked == [(4, 1)]
    front._passed, known[0] = {(4, 0)}, True
    assert not front._pass()
    assert len(front.boxes.kappa) == 4


@pytest.mark.parametrize("agree", [(False, True, False, False, False), (False, False, False, False, True)])
def test_a_box_is_known_where_it_is_glued_to_one_of_its_cell(monkeypatch, agree):
    """All that agree as computed are tried, at the cell's middle."""
    front = front_over(quarters(), (0.25, 0.625, 1.75), (3, 3, 4))
    asked = []

    def glue(runner, one, delta, other, there, chunk):
        asked.append((one.centre[:, 0], delta[:, 0], other.centre[:, 0], there[:, 0]))
        return np.array(agree)

    monkeypatch.setattr(module, "glue_boxes", glue)
    monkeypatch.setattr(module, "_near", lambda problem, one, other: np.ones(len(one[1]), dtype=bool))
    known = front._known(np.array([3, 4, 3]), boxes_at((0.125, 1.125, 0.875)))
    ((one, delta, other, there),) = asked
    assert one.tolist() == [0.125, 0.125, 1.125, 0.875, 0.875]
    assert other.tolist() == [0.25, 0.625, 1.75, 0.25, 0.625]
    np.testing.assert_array_equal(one + delta, [0.5, 0.5, 1.5, 0.5, 0.5])
    np.testing.assert_array_equal(other + there, [0.5, 0.5, 1.5, 0.5, 0.5])
    assert known.tolist() == [agree[0] or agree[1], agree[2], agree[3] or agree[4]]


# Whose boxes are whose


def test_boxes_of_cells_are_found():
    front = front_over(quarters())
    front.members = Members(np.array([3, 3, 5, 6, 6, 6]), np.array([4, 0, 2, 5, 1, 3]))
    rows, box = front._over(np.array([6, 4, 3, 5, 6]))
    assert rows.tolist() == [0, 0, 0, 2, 2, 3, 4, 4, 4]
    assert box.tolist() == [5, 1, 3, 4, 0, 2, 5, 1, 3]


def test_boxes_that_are_added_are_their_cells():
    """Numbered behind those there are, and glued to what they came from."""
    front = front_over(quarters(), (0.5, 3.5, 2.5), (3, 5, 6))
    found = contacts_at([4, 3])._replace(origin=np.array([2, 1]))
    front.glued = glued_of(1)
    front._carry(found)
    assert front.members.cell.tolist() == [3, 3, 4, 5, 6]
    assert front.members.box.tolist() == [0, 4, 3, 1, 2]
    assert front.boxes.centre[:, 0].tolist() == [0.5, 3.5, 2.5, 14.0, 13.0]
    assert front.glued.first.tolist() == [0, 2, 1]
    assert front.glued.second.tolist() == [0, 3, 4]
    assert front.glued.at_first.tolist() == [[0.0], [1.0], [1.0]]
    assert front.glued.at_second.tolist() == [[0.0], [2.0], [2.0]]


def test_cells_are_halved_down_to_the_smallest():
    """Along the longest edge; those that cannot be are undecided; halves are of their cell's part."""
    tree = CellTree.whole(2)
    tree.split(np.array([0]), np.array([0]))
    front = front_over(quarters())
    front.tree, front.part, front._smallest = tree, np.array([-1, 3, 4]), 1 << (LEVELS - 1)
    assert front._split(np.array([1, 2])).tolist() == [3, 4, 5, 6]
    assert front.part.tolist() == [-1, 3, 4, 3, 3, 4, 4]
    assert tree.cut[[1, 2]].tolist() == [1, 1]
    assert front._split(np.array([3, 6])).tolist() == []
    assert tree.status[[3, 4, 5, 6]].tolist() == [UNDECIDED, UNREACHED, UNREACHED, UNDECIDED]


@pytest.mark.parametrize("bad", [None, 4])
def test_all_pairs_at_faces_are_tried(monkeypatch, bad):
    """Boxes of two cells that share a face, each with each, at the face's middle in the coordinates of either."""
    tree, over = quarters(), {3: (0, 3), 4: (1, 2, 4), 6: (5,)}
    cells, numbers = zip(*((cell, box) for cell, boxes in over.items() for box in boxes), strict=True)
    centres = np.array([0.125, 1.125, 1.25, 0.75, 1.75, 3.875, 9.0])
    asked = []

    def glue(runner, one, delta, other, there, chunk):
        asked.append(
            (one.centre[:, 0], one.centre[:, 0] + delta[:, 0], other.centre[:, 0], other.centre[:, 0] + there[:, 0])
        )
        return other.centre[:, 0] != centres[bad or 6]

    monkeypatch.setattr(module, "glue_boxes", glue)
    monkeypatch.setattr(module, "_near", lambda problem, one, other: np.ones(len(one[1]), dtype=bool))
    wrapped = Region(REGION.lower, REGION.upper, np.array([True]))
    members = Members(np.array(cells), np.array(numbers))
    found = glued_pairs(SimpleNamespace(problem=PROBLEM), wrapped, tree, members, boxes_at(centres))
    pairs = sorted([(a, b, 1.0, 1.0) for a in over[3] for b in over[4]] + [(5, a, 4.0, 0.0) for a in over[3]])
    tried = [(list(centres).index(a), list(centres).index(b), c, d) for a, c, b, d in zip(*asked.pop(), strict=True)]
    assert sorted(tried) == pairs
    told = zip(found.first, found.second, found.at_first[:, 0], found.at_second[:, 0], strict=True)
    assert sorted(told) == [pair for pair in pairs if pair[1] != bad]


def test_places_of_cells():
    """As the tests above have them."""
    centre, half = place(quarters(), REGION, LEAVES)
    np.testing.assert_array_equal(centre[:, 0], [0.5, 1.5, 2.5, 3.5])
    np.testing.assert_array_equal(half[:, 0], np.full(4, 0.5))
