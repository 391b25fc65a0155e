"""Cells are glued at a point that both hold, in the coordinates of each, and only where that is proved."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.control.stability.set_point import certified_cells as module
from ccpin.control.stability.set_point.certified_cells import Cell, CellStore
from ccpin.proof.newton import Boxes

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
