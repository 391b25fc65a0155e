"""How many configurations sheets have over a cell: what is true is proved, what was planted is found."""

import numpy as np
import pytest

import ccpin
from ccpin.covering.cells import CellStatus
from ccpin.domain import certify_sheets
from ccpin.errors import InvalidInputError

pytest.importorskip("flint")

from ccpin.auditing import closures, counts, empty_cells, gluing, reading, verify
from ccpin.auditing.looking import _faces as audit_faces
from tests.support.altered import changed, without_members
from tests.support.legs import WHOLE, load_slice

TORUS = np.full(2, -np.pi), np.full(2, np.pi)


@pytest.fixture(scope="module")
def sheets(tmp_path_factory):
    """The RPDR's two sheets, and their file."""
    found = certify_sheets(ccpin.load("rpdr"), TORUS, max_depth=5)
    path = tmp_path_factory.mktemp("counts") / "sheets.json"
    found.save(path)
    return found, path


def looker(path):
    """The document in a file, and the search of the auditor for it."""
    read = reading.read(path)
    return read, empty_cells.Emptiness(closures.BallClosures(read), read)


def row_of(read, cell):
    """The place of a cell among those counted."""
    return int(np.flatnonzero(read.counts.cells.number == cell)[0])


@pytest.mark.slow
def test_sheets_are_audited(sheets, tmp_path):
    """Boxes, the faces said to be glued, cells that are empty, singular and counted; wrong faces are found."""
    found, path = sheets
    audit = verify(path, sample=5)
    assert audit.holds, str(audit)
    assert [claim.checked for claim in audit.claims] == [*6 * [5], 2]
    assert audit.claims[5].of == len(found.tree.leaves(CellStatus.CERTIFIED))
    second = found.members.box[found.members.cell == found.members.cell[0]]
    assert len(second) == 2

    def crossed(arrays):
        other = {int(second[0]): second[1], int(second[1]): second[0]}
        rows = np.isin(arrays["glued_first"], second)
        arrays["glued_first"][rows] = [other[int(k)] for k in arrays["glued_first"][rows]]

    read = reading.read(changed(path, tmp_path, crossed))
    own, faces = closures.BallClosures(read), audit_faces(read)
    wrong = [c for c in faces if c.first in second]
    assert wrong
    assert not any(gluing.same_solution(own, read, c) for c in wrong)


@pytest.fixture(scope="module")
def cell(sheets):
    """A certified cell, the largest."""
    tree = sheets[0].tree
    cells = tree.leaves(CellStatus.CERTIFIED)
    return int(cells[np.argmax(tree.shares(cells))])


def test_solutions_over_a_middle_are_those_of_the_producer(sheets, cell):
    read, look = looker(sheets[1])
    k = row_of(read, cell)
    low, high = reading.corners(read, read.counts.cells, k)
    q = 0.5 * (low + high)
    kept = look.remaining([look.whole(low, high)], keep=True)
    found = sorted(np.cos(theta).tolist() for theta, _ in counts._over(look, kept, q))
    theta = [sheets[0].reading.theta(c) for c in sheets[0].solutions(q)[0]]
    np.testing.assert_allclose(found, sorted(np.cos(theta).tolist()), atol=1e-12)


@pytest.mark.parametrize("planted", ["dropped", "dropped and counted", "twice", "one more", "elsewhere", "no more"])
def test_wrong_counts_are_found(sheets, cell, tmp_path, planted):
    """A box dropped, counted or not, one that stands twice, one that is none of the cell's, other numbers: refused."""
    found, path = sheets
    row = int(np.flatnonzero(found.members.cell == cell)[0])

    def plant(arrays):
        if planted.startswith("dropped"):
            for name in ("members_cell", "members_box"):
                arrays[name] = np.delete(arrays[name], row)
        if planted == "dropped and counted":
            arrays["count"][cell] -= 1
        if planted == "twice":
            arrays["members_box"][row + 1] = arrays["members_box"][row]
        if planted == "elsewhere":
            arrays["members_box"][row] = arrays["members_box"][(row + 20) % len(arrays["members_box"])]
        if planted == "one more":
            arrays["count"][cell] += 1
        if planted == "no more":
            arrays["count"][cell] = -1

    with pytest.raises(InvalidInputError, match=r"count: not as many|members_box|is not the box of cell"):
        reading.read(changed(path, tmp_path, plant))


def test_a_wrong_number_is_found(sheets, cell):
    """One more and one less than there are over a cell that is not certified."""
    read, look = looker(sheets[1])
    row = row_of(read, cell)
    read.counts.certified[row] = False
    assert counts.counted(look, row)
    for wrong in (1, 3):
        read.counts.said[row] = wrong
        assert counts.counted(look, row) is False


def test_boxes_that_are_none_are_refused(sheets, tmp_path):
    def plant(arrays):
        arrays["members_box"][0] = len(arrays["box_centre"])

    with pytest.raises(InvalidInputError, match="members_box"):
        reading.read(changed(sheets[1], tmp_path, plant))


@pytest.mark.slow
def test_counts_of_cells_that_have_other_numbers_are_found(sheets, tmp_path, monkeypatch):
    """Cells that hold a fold, and empty ones, said to hold two; and two, said to be empty."""
    monkeypatch.setattr(empty_cells, "_BUDGET", 1000)
    found, path = sheets
    folded, empty = (found.tree.leaves(kind)[:1] for kind in (CellStatus.SINGULAR, CellStatus.EMPTY))
    two = found.tree.leaves(CellStatus.CERTIFIED)[:2]

    def plant(arrays):
        arrays["count"][np.concatenate([folded, empty])] = 2
        arrays["tree_status"][empty] = CellStatus.UNDECIDED
        arrays["count"][two] = 0
        arrays["tree_status"][two] = CellStatus.EMPTY
        without_members(arrays, two)

    read, look = looker(changed(path, tmp_path, plant))
    for cell in (*folded, *empty):
        assert not counts.counted(look, row_of(read, cell))
    assert not np.any(np.isin(two, read.counts.cells.number))
    assert not any(look.proved(int(k)) for k in np.flatnonzero(np.isin(read.empty.number, two)))


@pytest.mark.slow
def test_workers_count_the_same(sheets):
    alone, shared = (verify(sheets[1], sample=1, workers=workers).claims for workers in (1, 2))
    assert alone == shared
    assert alone[5].checked == 1


@pytest.mark.slow
def test_counts_of_the_3rpr(tmp_path):
    """Cells of its slice with four configurations and with two, some seconds each; four said to be two are found."""
    found = certify_sheets(load_slice(), WHOLE, max_depth=5)
    path = tmp_path / "legs.json"
    found.save(path)
    read, look = looker(path)
    cells = [read.counts.cells.number[read.counts.said == number][0] for number in (4, 2)]
    assert all(counts.counted(look, row_of(read, cell)) for cell in cells)

    row = row_of(read, cells[0])
    read.counts.said[row], read.counts.certified[row] = 2, False
    assert counts.counted(look, row) is False


@pytest.mark.slow
def test_all_of_the_rpdrs_sheets(tmp_path):
    """Every claim of the document that `certify_sheets` writes of the torus, some 16,000, in three minutes."""
    certify_sheets(ccpin.load("rpdr"), TORUS).save(tmp_path / "sheets.json")
    audit = verify(tmp_path / "sheets.json")
    assert audit.whole
    assert audit.holds, str(audit)
