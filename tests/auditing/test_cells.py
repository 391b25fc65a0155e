"""Cells called empty or singular: what is true is proved, what was planted is found."""

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus
from ccpin.domain import certify, scalar_coordinates_at
from ccpin.errors import InvalidInputError
from tests.oracles import rpdr as oracle
from tests.support.legs import WHOLE, load_slice

pytest.importorskip("flint")

from ccpin.auditing import closures, empty_cells, reading, singular_points, verify
from tests.support.altered import changed, claim, without_boxes
from tests.support.long_cases import later

TORUS = np.full(2, -np.pi), np.full(2, np.pi)


@pytest.fixture(scope="module")
def torus(tmp_path_factory):
    """An atlas of the RPDR's branch, and its file."""
    atlas = certify(ccpin.load("rpdr"), np.radians((-108.0, -72.0)), TORUS, max_depth=5)
    path = tmp_path_factory.mktemp("cells") / "atlas.json"
    atlas.save(path)
    return atlas, path


@pytest.mark.parametrize("sample", later(8, 20))
def test_empty_and_singular_cells_are_proved(torus, sample):
    """As many as there are of both, a sample of each."""
    atlas, path = torus
    audit = verify(path, sample=sample)
    assert audit.holds, str(audit)
    for word, status in (("without a closed", CellStatus.EMPTY), ("with a singular", CellStatus.SINGULAR)):
        assert claim(audit, word).of == len(atlas.tree.leaves(status)) >= 60
        assert claim(audit, word).checked == sample


def test_cells_that_are_not_empty_are_found(torus, tmp_path, monkeypatch):
    """Certified and singular cells called empty, and cells half empty: none is proved."""
    monkeypatch.setattr(empty_cells, "_BUDGET", 500)
    atlas, path = torus
    leaves = atlas.tree.leaves()
    low = atlas.region.position(atlas.tree.lower[leaves])
    high = atlas.region.position(atlas.tree.lower[leaves] + atlas.tree.size[leaves])
    corners = [np.array([x, y]) for x in (0, 1) for y in (0, 1)]
    reach = np.array(
        [np.hypot(*oracle.elbow_offset((low + c * (high - low)).T)) / (oracle.A3 + oracle.A4) for c in corners]
    )
    planted = leaves[np.any(reach < 0.999, axis=0) & (atlas.tree.status[leaves] != CellStatus.EMPTY)]
    assert len(planted) > 500
    planted = np.random.default_rng(0).choice(planted, 40, replace=False)

    def plant(arrays):
        arrays["tree_status"][planted] = CellStatus.EMPTY
        without_boxes(arrays, np.intersect1d(planted, atlas.tree.leaves(CellStatus.CERTIFIED)))
        kept = ~np.isin(arrays["singular_cell"], planted)
        arrays["singular_cell"], arrays["singular_theta"] = (
            arrays["singular_cell"][kept],
            arrays["singular_theta"][kept],
        )

    read = reading.read(changed(path, tmp_path, plant, radius=0.0))
    look = empty_cells.Emptiness(closures.BallClosures(read), read)
    rows = np.flatnonzero(np.isin(read.empty.number, planted))
    assert len(rows) == 40
    assert not any(look.proved(int(k)) for k in rows[:3])


def test_configurations_that_are_not_singular_are_found(torus, tmp_path):
    """Witnesses over other cells, regular ones, and cells called singular without any."""
    atlas, path = torus
    certified = atlas.tree.leaves(CellStatus.CERTIFIED)[:5]
    regular = atlas.boxes.centre[atlas.tree.box[certified]]

    def plant(arrays):
        arrays["tree_status"][certified] = CellStatus.SINGULAR
        without_boxes(arrays, certified)
        arrays["singular_theta"] = np.roll(arrays["singular_theta"], 7, axis=0)
        arrays["singular_cell"] = np.concatenate([arrays["singular_cell"], certified])
        arrays["singular_theta"] = np.concatenate([arrays["singular_theta"], regular])

    read = reading.read(changed(path, tmp_path, plant, radius=0.0))
    own = closures.BallClosures(read)
    count = len(read.singular.number)
    for k in [*range(0, count - 5, 40), *range(count - 5, count)]:
        assert not singular_points.singular(own, read, k)

    def bare(arrays):
        arrays["tree_status"][certified] = CellStatus.SINGULAR
        without_boxes(arrays, certified)

    with pytest.raises(InvalidInputError, match="without a singular configuration"):
        reading.read(changed(path, tmp_path, bare, radius=0.0))


@pytest.mark.slow
def test_cells_emptied_by_search_are_proved(tmp_path):
    """Of the 3-RPR's slice, where the triangle inequality says nothing; the search takes some seconds a cell."""
    mechanism = load_slice()
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    atlas = certify(mechanism, q0, WHOLE, max_depth=5, exhaustive=True)
    atlas.save(tmp_path / "legs.npz")
    read = reading.read(tmp_path / "legs.npz")
    look = empty_cells.Emptiness(closures.BallClosures(read), read)
    assert look.searched
    largest = np.argsort(-np.prod(read.empty.upper - read.empty.lower, axis=1))[:4]
    assert all(look.proved(int(k)) for k in largest)


@pytest.fixture(scope="module")
def legs(tmp_path_factory):
    """An atlas of a 3-RRR, cells of which are empty although no two of its points are too far apart; its file."""
    mechanism = ccpin.load("planar_3rrr")
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    atlas = certify(mechanism, q0, max_depth=2, exhaustive=True, resolution=0.1)
    path = tmp_path_factory.mktemp("legs") / "atlas.json"
    atlas.save(path)
    return atlas, path


@pytest.mark.slow
def test_cells_emptied_by_theorem_e_are_proved(legs):
    """All of a 3-RRR's."""
    atlas, path = legs
    assert atlas.empty_fraction > 0.0
    read = reading.read(path)
    look = empty_cells.Emptiness(closures.BallClosures(read), read)
    assert all(look.proved(k) for k in range(len(read.empty.number)))


def test_what_there_is_no_way_to_look_at_is_no_failure(legs, monkeypatch):
    """Without legs of a body, and with more dependent coordinates than are searched: neither proved nor failed."""
    monkeypatch.setattr(empty_cells.Legs, "of", lambda reach: None)
    monkeypatch.setattr(empty_cells, "_MOST", 5)
    audit = verify(legs[1], sample=1)
    assert (claim(audit, "without a closed").checked, claim(audit, "without a closed").failed) == (0, ())
    assert audit.holds
    assert not audit.whole
