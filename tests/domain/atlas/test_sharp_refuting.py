"""What refutes that σ reaches all of a region: from which certified box, at which point of it, to which corners."""

from types import SimpleNamespace

import numpy as np
import pytest

from ccpin.covering.cells import CellStatus, CellTree
from ccpin.covering.faces import CellFaces
from ccpin.covering.region import Region
from ccpin.domain.atlas import refuting as module
from ccpin.proof.cell_tree import WHOLE

REGION = Region(np.array([0.0, 10.0]), np.array([4.0, 18.0]), np.zeros(2, dtype=bool))
READING = SimpleNamespace(
    problem=SimpleNamespace(system=SimpleNamespace(independent=np.array([0, 1]))),
    system=SimpleNamespace(independent=np.array([0, 1])),
)


def halves():
    tree = CellTree.whole(2)
    tree.split(np.array([0]), np.array([0]))
    return tree


def test_an_empty_cell_refutes_by_its_middle():
    tree = halves()
    tree.split(np.array([2]), np.array([1]))
    tree.status[[1, 3, 4]] = CellStatus.CERTIFIED, CellStatus.EMPTY, CellStatus.CERTIFIED
    witness = module.refutation_of(READING, tree, REGION, None)
    assert (witness.kind, witness.q.tolist(), witness.q_free) == ("empty", [3.0, 12.0], None)


@pytest.mark.parametrize("count", [0, 1, 3, 12])
@pytest.mark.parametrize("found", [0, 2, None])
def test_cells_beside_certified_ones_are_tried_one_by_one(monkeypatch, count, found):
    """From the middle of the common face, in the coordinates of the certified box there."""
    tree = halves()
    tree.status[[1, 2]] = CellStatus.CERTIFIED, CellStatus.SINGULAR
    tree.box[:] = [9, 3, 9]
    numbers = np.arange(count)
    at_leaf = np.tile([WHOLE / 2, WHOLE / 4], (count, 1))
    contacts = CellFaces(numbers + 5, np.ones(count, int), at_leaf, at_leaf, numbers * 1.0, numbers > 0)
    boxes = SimpleNamespace(centre=np.arange(10.0)[:, None] * np.ones(2))
    asked = []
    monkeypatch.setattr(module, "boxes_of", lambda solutions: boxes if solutions == ("solutions",) else None)
    monkeypatch.setattr(module, "closures_of", lambda problem: "equations")
    monkeypatch.setattr(module, "beside_certified", lambda tree, region, status: contacts)
    monkeypatch.setattr(module, "sigma_at", lambda problem, tree, region, boxes, one: one.cell[None] * 1.0)

    def witness(reading, tree, region, theta, cell, met, solutions):
        numbers = met.first.tolist(), met.second.tolist(), met.point.tolist()
        assert (met.equations, solutions, numbers) == ("equations", ("solutions",), ([3], [3], [0]))
        np.testing.assert_array_equal(met.at_first, met.at_second)
        asked.append((theta.tolist(), cell, met.at_first.tolist()))
        return "found" if cell - 5 == found else None

    monkeypatch.setattr(module, "_witness_from", witness)
    assert module.refutation_of(READING, tree, REGION, ("solutions",)) == (
        "found" if found is not None and found < count else None
    )
    tried = min(count, 8) if found is None else min(count, found + 1)
    assert asked == [([5.0 + k], 5 + k, [[2.0 - 3.0, 12.0 - 3.0]]) for k in range(tried)]


@pytest.mark.parametrize("same", [True, False])
def test_from_the_certified_boxs_solution_to_the_corners_of_a_cell(monkeypatch, same):
    """The point that is walked from is asked to lie in the box."""
    asked = []
    monkeypatch.setattr(module, "Walker", lambda problem, pieces, tube, theta: SimpleNamespace(start="point"))
    monkeypatch.setattr(module, "prove_some", lambda *args: asked.append(args) or (None, np.array([same])))
    monkeypatch.setattr(module, "singular_witness", lambda walker, reading, targets: targets)
    targets = module._witness_from(READING, halves(), REGION, np.array([1.0, 11.0, 9.0]), 2, "met", ("boxes",))
    assert asked == [("met", "point", "boxes")]
    if same:
        assert sorted(target.tolist() for target in targets) == [[2, 10], [2, 18], [4, 10], [4, 18]]
    else:
        assert targets is None
