"""A box is carried on only where it is proved and proved to be glued, and starts only about the counted points."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering.cells import CellStatus
from ccpin.covering.faces import CellFaces
from ccpin.domain.sheets import cover as module
from ccpin.domain.sheets.cover import CountedRegion, Front, Members
from ccpin.proof.newton import Boxes

SYSTEM = SimpleNamespace(
    dependent=np.array([1]), independent=np.array([0]), periodic=np.array([False, False]), n=1, m=1
)


def boxes_at(centres):
    """Boxes of radius 1 about (q, 0), flat."""
    count = len(centres)
    one = np.ones((count, 1, 1))
    centre = np.column_stack([centres, np.zeros(count)])
    directions = np.tile([[1.0], [0.0]], (count, 1, 1))
    row = one[:, 0]
    return Boxes(centre, 0.5 * row, directions, one, one, row.copy(), row.copy(), np.full(count, 0.5))


@pytest.fixture
def front():
    """A front with two certified boxes over cell 0 and nothing else."""
    made = object.__new__(Front)
    made.runner, made.problem = None, SimpleNamespace(system=SYSTEM)
    made.region = SimpleNamespace(position=lambda at: at)
    made.tree = SimpleNamespace(status=np.full(3, CellStatus.UNREACHED, dtype=object))
    made.boxes, made.members = boxes_at([0.25, 0.25]), Members(np.array([0, 0]), np.array([0, 1]))
    return made


@pytest.mark.parametrize("proved", [(True, True), (True, False), (False, False)])
@pytest.mark.parametrize("glued", [(True, True), (True, False), (False, False)])
def test_boxes_are_carried_on_where_they_are_proved_and_glued(front, monkeypatch, proved, glued):
    asked, starts = [], []

    def proved_boxes(cells, start, turn_to):
        starts.append(start[:, 0].copy())
        return boxes_at([1.0, 1.0]), np.array(proved)

    def glue(runner, first, delta, second, other, chunk):
        asked.append((first.centre[:, :1] + delta, second.centre[:, :1] + other))
        return np.array(glued)[np.array(proved)]

    monkeypatch.setattr(module, "glue_boxes", glue)
    front._proved = proved_boxes
    face, turned = np.full((2, 1), 0.5), np.full((2, 1), 0.5 + 2 * np.pi)
    contacts = SimpleNamespace(cell=np.array([1, 1]), at_leaf=face, at_cell=turned)
    found = front._continued(contacts, np.array([0, 1]))
    np.testing.assert_array_equal(found.good, np.array(proved) & np.array(glued))
    ((first, second),) = asked
    np.testing.assert_array_equal(first, face[np.array(proved)])
    np.testing.assert_allclose(second, turned[np.array(proved)], rtol=1e-15)
    np.testing.assert_array_equal(starts[0], turned[:, 0])


@pytest.mark.parametrize(
    ("proved", "points", "y", "certified"),
    [
        (True, True, 0.5, True),
        (False, True, 0.5, False),
        (True, False, 0.5, False),
        (True, True, 0.95, False),  # the ball of 0.1 sticks out of the tube
        (True, True, -0.95, False),
    ],
)
def test_a_counted_cell_is_certified_where_its_points_lie_in_the_boxes(
    front, monkeypatch, proved, points, y, certified
):
    point = boxes_at([3.0, 3.0])._replace(centre=np.array([[3.0, 0.5], [3.0, y]]), radius=np.full((2, 1), 0.1))
    monkeypatch.setattr(
        module, "certify_points", lambda *_: SimpleNamespace(boxes=point, proved=np.array([True, points]))
    )
    monkeypatch.setattr(module, "place", lambda *_: (np.full((1, 1), 3.0), np.ones((1, 1))))
    leaning = boxes_at([3.0, 3.0])
    leaning.directions[:, 1] = 2.0
    front._proved = lambda cells, start, turn_to: (leaning, np.array([True, proved]))
    front._split = lambda cells: np.zeros(0, dtype=np.intp)
    front.parts = [CountedRegion(np.array([1]), 1, point.centre)]
    front._first(0)
    assert (front.tree.status[1] == CellStatus.CERTIFIED) == certified
    assert len(front.boxes.kappa) == 2 + 2 * certified


@pytest.mark.parametrize("bad", [0, 1, None])
def test_a_cell_is_certified_only_where_all_its_sheets_are_carried_on(front, bad):
    """One box that fails leaves its cell uncertified, whatever the other does."""
    good = np.array([True, True])
    if bad is not None:
        good[bad] = False
    split = []
    cells, face = np.array([1, 1]), np.zeros((2, 1))
    front._continued = lambda contacts, origin: module._Continued(
        cells, boxes_at([1.0, 1.0]), good, np.array([0, 1]), face, face
    )
    front._split = split.append
    front._carry = lambda found: split.append(found.cell)
    contacts = CellFaces(*(np.zeros((1, 1) if name.startswith("at") else 1, np.intp) for name in CellFaces._fields))
    front._try(contacts)
    assert (front.tree.status[1] == CellStatus.CERTIFIED) == (bad is None)


def test_a_part_without_solutions_is_empty(front, monkeypatch):
    monkeypatch.setattr(module, "place", lambda *_: (np.zeros((1, 1)), np.ones((1, 1))))
    front.parts = [CountedRegion(np.array([1, 2]), 1, np.zeros((0, 2)))]
    front._first(0)
    assert list(front.tree.status) == [CellStatus.UNREACHED, CellStatus.EMPTY, CellStatus.EMPTY]
