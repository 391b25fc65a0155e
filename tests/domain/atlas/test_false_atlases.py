"""Searches for atlases that go wrong: what they call empty, or proved, and is not, is no fact."""

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus
from ccpin.domain import Atlas, certify, kantorovich_radius
from ccpin.domain.atlas import certifying, emptying, square
from ccpin.domain.sheets.counting import all_solutions
from ccpin.errors import InvalidInputError
from tests.support.long_cases import later


@pytest.fixture(scope="module")
def honest(rpdr):
    """Part of the RPDR's q-space; over much of it nothing closes."""
    return certify(rpdr, [1.2, -1.2], ((-1.0, -3.0), (3.0, 1.0)), max_depth=7, exhaustive=True)


@pytest.fixture(params=later(25, 60))
def points(request):
    """At how many q it is looked."""
    return request.param


def nothing_false(atlas, points):
    """That no q of an empty cell has a closed configuration."""
    leaves = atlas.tree.leaves(CellStatus.EMPTY)
    for q in np.random.default_rng(2).uniform(atlas.region.lower, atlas.region.upper, (points, 2)):
        if int(atlas.tree.locate(atlas.region.cell_coordinates(q[None]))[0]) in leaves:
            ranges = emptying.all_values(atlas.reading, q, q)
            assert not len(all_solutions(atlas.problem, ranges, q).kappa)


def test_cells_are_empty_by_facts(honest, points):
    """One by closed forms, one by branch and prune; together they name every empty cell."""
    assert honest.empty_fraction > 0.05
    nothing_false(honest, points)
    named = np.any([fact.found["empty"] for fact in honest.proved.empty], axis=0)
    assert named[honest.tree.leaves(CellStatus.EMPTY)].all()


@pytest.mark.parametrize("name", later("search_empty", "prove_empty"))
def test_cells_called_empty_that_are_not(monkeypatch, rpdr, name, points):
    """They are undecided; nothing is refuted by them."""

    def all_empty(runner, *given):
        tree = given[0] if name == "prove_empty" else given[1]
        tree.status[tree.leaves(CellStatus.UNREACHED, CellStatus.UNDECIDED)] = CellStatus.EMPTY

    monkeypatch.setattr(certifying, name, all_empty)
    atlas = certify(rpdr, [1.2, -1.2], ((-1.0, -3.0), (3.0, 1.0)), max_depth=3, exhaustive=name == "search_empty")
    nothing_false(atlas, points)
    assert atlas.undecided_fraction > 0.0
    if atlas.witness is not None and atlas.witness.kind == "empty":
        leaf = atlas.tree.locate(atlas.region.cell_coordinates(atlas.witness.q[None]))[0]
        assert any(fact.found["empty"][leaf] for fact in atlas.proved.empty)


def test_a_file_that_calls_a_cell_empty(tmp_path, honest):
    """It is believed as a file is; replayed it is refused."""
    honest.save(tmp_path / "honest.npz")
    assert Atlas.load(tmp_path / "honest.npz", replay=True).empty_fraction == honest.empty_fraction
    status = honest.tree.status.copy()
    honest.tree.status[honest.tree.leaves(CellStatus.UNDECIDED, CellStatus.SINGULAR)[:1]] = CellStatus.EMPTY
    try:
        honest.save(tmp_path / "told.npz")
    finally:
        honest.tree.status[:] = status
    assert Atlas.load(tmp_path / "told.npz").proved is None
    with pytest.raises(InvalidInputError, match="empty is not proved"):
        Atlas.load(tmp_path / "told.npz", replay=True)


def test_a_square_that_is_not_proved_is_not_given(monkeypatch):
    """The largest is one that the kernel proves, whatever was tried."""
    model = ccpin.load("four_bar")
    radius = kantorovich_radius(model, model.q_reference)
    honest = square.certify_boxes

    def eager(problem, centre, half, across):
        tried = honest(problem, centre, half, across)
        return tried._replace(proved=np.ones_like(tried.proved))

    monkeypatch.setattr(square, "certify_boxes", eager)
    assert 0.0 < kantorovich_radius(model, model.q_reference) <= radius * (1.0 + 1e-6)
