"""Sheets of parts merged: what the whole's say, a mode change that no part has, and what is refused."""

import json

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.cli import main
from ccpin.covering.cells import CellStatus
from ccpin.domain import SheetAtlas, certify_sheets, merge, split_region
from ccpin.errors import InvalidInputError
from tests.oracles import planar_3rpr as sextic
from tests.oracles import rpdr as five_bar
from tests.support.altered import changed
from tests.support.legs import load_slice, with_first_leg
from tests.support.long_cases import later

TORUS = np.full(2, -np.pi), np.full(2, np.pi)
REGION = np.array([[0.168, 0.247], [0.192, 0.271]])


@pytest.fixture(scope="module")
def quarters(rpdr):
    """The RPDR's torus in four."""
    return [certify_sheets(rpdr, part, max_depth=5) for part in split_region(TORUS, 4)]


@pytest.fixture(scope="module")
def torus(quarters):
    """The four as one."""
    return merge(quarters)


@pytest.mark.slow
def test_four_quarters_are_the_torus(rpdr, quarters, torus):
    """Two sheets, glued across every seam and where the torus closes, with the closed form's number everywhere."""
    whole, merged = certify_sheets(rpdr, TORUS, max_depth=6), torus
    assert np.all(merged.region.wrapped)
    assert merged.complete
    assert np.all(merged.verify())
    assert len(merged.sheets) == len(whole.sheets) == 2
    assert sorted(sheet.sign for sheet in merged.sheets) == [-1, 1]
    np.testing.assert_allclose(
        sorted(sheet.area for sheet in merged.sheets), sorted(sheet.area for sheet in whole.sheets), rtol=0.01
    )
    q = np.random.default_rng(0).uniform(*TORUS, (20_000, 2))
    counted = merged.number_of_solutions(q)
    reach = np.hypot(*five_bar.elbow_offset(q.T)) / (five_bar.A3 + five_bar.A4)
    assert np.all((counted < 0) | (counted == np.where(reach < 1.0, 2, 0)))
    assert np.mean(counted >= 0) == pytest.approx(merged.counted_fraction, abs=0.01)
    assert merged.counted_fraction == pytest.approx(np.mean([part.counted_fraction for part in quarters]), abs=1e-12)
    for status in (CellStatus.CERTIFIED, CellStatus.EMPTY, CellStatus.SINGULAR):
        share = np.mean([part.fraction(status) for part in quarters])
        assert merged.fraction(status) == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize("points", later(15, 40))
def test_each_configuration_is_that_of_a_part(quarters, torus, points):
    """Over points of any quarter: the same configurations, in boxes of the cell they lie over."""
    merged, rng = torus, np.random.default_rng(1)
    for part in quarters:
        q = rng.uniform(part.region.lower, part.region.upper, (points, 2))
        tried = 0
        for point in q[part.tree.status[part._cells(q)] == CellStatus.CERTIFIED]:
            ours, theirs = merged.solutions(point)[0], part.solutions(point)[0]
            gap = np.abs(np.exp(1j * ours[:, None]) - np.exp(1j * theirs[None])).max(axis=2)
            assert len(ours) == len(theirs) == 2
            assert np.all(gap.min(axis=1) < 1e-10)
            assert {merged.sheets[int(k)].sign for k in merged.solutions(point)[1]} == {-1, 1}
            tried += 1
        assert tried > 5


@pytest.mark.slow
def test_modes_change_on_a_way_through_all_parts():
    """A cusp within the region, cut into four: on each part assembly modes keep apart, on the whole they do not."""
    mechanism = load_slice()
    parts = [certify_sheets(mechanism, part, max_depth=4) for part in split_region(REGION, 4)]
    merged = merge(parts)
    q = np.random.default_rng(2).uniform(*REGION, (1000, 2))
    counted, (expected, doubtful) = merged.number_of_solutions(q), sextic.modes(with_first_leg(q))
    assert not np.any((counted >= 0) & (counted != expected) & ~doubtful)
    assert max(sheet.layers for sheet in merged.sheets) > max(s.layers for part in parts for s in part.sheets)
    change = merged.mode_change()
    path = domain.certify_path(mechanism, change.path, tube=1e-6, near=change.start)
    assert path.verdict == "proven"
    assert np.abs(np.exp(1j * path.sigma(path.reached)) - np.exp(1j * change.end)).max() < 1e-9
    assert np.abs(np.exp(1j * change.end) - np.exp(1j * change.start)).max() > 0.1
    assert np.allclose(change.path[0], change.path[-1])


@pytest.mark.slow
def test_merged_sheets_are_a_document(quarters, tmp_path):
    """Saved, read and audited; a box dropped at a seam is found; and merged sheets are merged on."""
    pytest.importorskip("flint")
    from ccpin.auditing import verify

    merged = merge([merge(quarters[:2]), merge(quarters[2:])])
    assert len(merged.sheets) == 2
    merged.save(tmp_path / "merged.json")
    again = SheetAtlas.load(tmp_path / "merged.json")
    assert repr(again).replace(", loaded", "") == repr(merged)
    audit = verify(tmp_path / "merged.json", sample=5)
    assert audit.holds, str(audit)
    assert [claim.checked for claim in audit.claims] == [*6 * [5], 2]

    def plant(arrays):
        rows = arrays["members_cell"] == cell
        arrays["members_box"][np.flatnonzero(rows)[0]] = arrays["members_box"][np.flatnonzero(~rows)[0]]

    counted = merged.tree.leaves(CellStatus.CERTIFIED)
    cell = int(counted[np.argmax(merged.tree.shares(counted))])
    with pytest.raises(InvalidInputError, match="members_box"):
        verify(changed(tmp_path / "merged.json", tmp_path, plant))


def test_what_does_not_belong_together_is_refused(rpdr, quarters):
    """A gap, a part twice, another mechanism, other limits, and atlases among sheets."""
    with pytest.raises(InvalidInputError, match="no part covers"):
        merge(quarters[:3])
    with pytest.raises(InvalidInputError, match="overlap"):
        merge([*quarters, quarters[0]])
    other = certify_sheets(ccpin.load("rpdr", independent=["joint1", "joint4"]), split_region(TORUS, 4)[1], max_depth=3)
    with pytest.raises(InvalidInputError, match="part 2 is about other closures"):
        merge([quarters[0], other])
    with pytest.raises(InvalidInputError, match=r"parts\[1\]"):
        merge([quarters[0], domain.certify(rpdr, np.radians((-108.0, -72.0)), max_depth=2)])
    halves = split_region((np.array([-1.0]), np.array([1.0])), 2)
    cranks = [ccpin.load("slider_crank", joints={"slider": {"lower": low, "upper": 0.2}}) for low in (0.1, 0.12)]
    with pytest.raises(InvalidInputError, match="part 2 counts between other limits"):
        merge([certify_sheets(crank, half) for crank, half in zip(cranks, halves, strict=True)])


def test_the_command(tmp_path, capsys):
    """`ccpin merge` of sheets, in words and as JSON."""
    halves = split_region((np.array([-np.pi]), np.array([np.pi])), 2)
    for k, half in enumerate(halves):
        certify_sheets(ccpin.load("slider_crank"), half).save(tmp_path / f"{k}.json")
    files = [str(tmp_path / f"{k}.json") for k in range(2)]
    assert main(["merge", *files, "--out", str(tmp_path / "both.json"), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["counts"] == [2]
    assert [sheet["sign"] for sheet in facts["sheets"]] in ([1, -1], [-1, 1])
    assert facts["counted_fraction"] == 1.0
    assert main(["merge", *files, "--out", str(tmp_path / "both.json")]) == 0
    assert "assembly modes over one q, proved: 2" in capsys.readouterr().out
    assert np.all(SheetAtlas.load(tmp_path / "both.json").region.wrapped)
