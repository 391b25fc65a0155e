"""Dependent slides in the auditor: how far loops let them go, and counts of configurations that have them."""

import numpy as np
import pytest

import ccpin
from ccpin.domain import certify, certify_sheets, scalar_coordinates_at
from tests.oracles import slider_crank as oracle
from tests.support.altered import changed

pytest.importorskip("flint")

from ccpin.auditing import closures, counts, empty_cells, reading, verify


def looker(path):
    """The document in a file, and the auditor's search for it."""
    read = reading.read(path)
    return read, empty_cells.Emptiness(closures.BallClosures(read), read)


def sliding(read):
    """The dependent coordinates that are no plain angles."""
    return read.dependent[~read.periodic[read.dependent]]


@pytest.fixture(scope="module")
def limited(tmp_path_factory):
    """Sheets of a slider-crank whose slider may be between 10 and 15 cm: one configuration, or none; and their file."""
    crank = ccpin.load("slider_crank", joints={"slider": {"lower": 0.1, "upper": 0.15}})
    path = tmp_path_factory.mktemp("slides") / "sheets.json"
    found = certify_sheets(crank)
    found.save(path)
    return found, path


def test_a_slide_goes_as_far_as_its_loop(tmp_path):
    """Crank, rod and offset in a line; the auditor knows no limits."""
    certify_sheets(ccpin.load("slider_crank"), max_depth=2).save(tmp_path / "sheets.json")
    read, look = looker(tmp_path / "sheets.json")
    assert look.searched
    np.testing.assert_allclose(look.bounds.high[sliding(read)], oracle.CRANK + oracle.ROD - oracle.OFFSET, rtol=1e-7)


def test_no_pose_slides_farther(tmp_path):
    """A 3-RRR's platform, which slides both ways: poses everywhere are within the bounds."""
    mechanism = ccpin.load("planar_3rrr")
    model, rng = ccpin.ReducedModel(mechanism), np.random.default_rng(0)
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    certify(mechanism, q0, (q0 - 1e-3, q0 + 1e-3), max_depth=1).save(tmp_path / "box.json")
    read, look = looker(tmp_path / "box.json")
    slides = sliding(read)
    assert len(slides) == 2
    found = 0
    while found < 6:
        try:
            pose = model.sigma(q0 + rng.uniform(-1.2, 1.2, 3))
        except ccpin.errors.CcpinError:
            continue
        found += 1
        assert np.all(np.abs(pose[slides]) <= look.bounds.high[slides])


def test_counts_within_limits_are_those_of_the_closed_form(limited):
    """Every cell that is counted is proved to have one where Pythagoras has one within the limits, else none."""
    path = limited[1]
    audit = verify(path)
    assert audit.holds, str(audit)
    assert audit.whole
    read, _ = looker(path)
    assert set(read.counts.said.tolist()) <= {0, 1}
    for k, said in enumerate(read.counts.said):
        low, high = reading.corners(read, read.counts.cells, k)
        sliders = np.array([oracle.sigma(q)["slider"] for q in np.linspace(low[0], high[0], 50)[1:-1]])
        assert np.all((sliders >= 0.1) & (sliders <= 0.15)) == said
    assert len(read.empty.number) > 0


@pytest.mark.parametrize("planted", ["wider", "narrower", "another number"])
def test_wrong_ranges_and_numbers_are_found(limited, tmp_path, planted):
    """Ranges that hold the other configuration too, or none, and another number."""
    read, _ = looker(limited[1])
    cell = int(read.counts.cells.number[0])

    def plant(arrays):
        slide = np.flatnonzero(arrays["ranges_upper"] - arrays["ranges_lower"] < 1.0)[0]
        if planted == "wider":
            arrays["ranges_limits"][slide, 0] = -0.2
        if planted == "narrower":
            arrays["ranges_limits"][slide, 1] = 0.1001

    read, look = looker(changed(limited[1], tmp_path, plant))
    row = int(np.flatnonzero(read.counts.cells.number == cell)[0])
    read.counts.said[row] += planted == "another number"
    assert counts.counted(look, row) is False


def test_an_empty_cell_is_not_empty_beyond_the_limits(limited, tmp_path, monkeypatch):
    """What is empty within limits is not proved to be so once they are taken away."""
    monkeypatch.setattr(empty_cells, "_BUDGET", 500)
    read, look = looker(limited[1])
    assert all(look.proved(k) for k in range(len(read.empty.number)))

    def plant(arrays):
        slide = np.flatnonzero(arrays["ranges_upper"] - arrays["ranges_lower"] < 1.0)[0]
        arrays["ranges_limits"][slide] = -0.2, 0.2

    read, look = looker(changed(limited[1], tmp_path, plant))
    assert not any(look.proved(k) for k in range(min(3, len(read.empty.number))))


def ranges_failed(path):
    """The coordinates whose ranges `verify` does not prove."""
    audit = verify(path, sample=1)
    return next(claim for claim in audit.claims if "within the limits stated" in claim.what).undecided


@pytest.mark.parametrize(
    "planted",
    [
        "narrower",
        pytest.param("limit without a limit", marks=pytest.mark.slow),
        "limit without its end",
        "a turn",
        "lengths within lengths",
    ],
)
def test_ranges_that_do_not_follow_are_found(limited, tmp_path, planted):
    """What a document searched is what lengths, couplings and the limits it states leave; nothing else is believed."""
    crank = limited[1]
    if planted == "lengths within lengths":
        crank = tmp_path / "crank.json"
        certify_sheets(ccpin.load("slider_crank"), max_depth=2).save(crank)

    def plant(arrays):
        slide = np.flatnonzero(arrays["ranges_upper"] - arrays["ranges_lower"] < 1.0)[0]
        arrays["ranges_upper"][slide] -= 1e-3 * (planted in ("narrower", "lengths within lengths"))
        if planted == "limit without a limit":
            arrays["ranges_limits"][slide] = np.finfo(float).max * np.array([-1.0, 1.0])
        if planted == "limit without its end":
            arrays["ranges_limits"][slide, 0] += 1e-4
        if planted == "a turn":
            arrays["ranges_reasons"][slide] = 0

    assert not ranges_failed(crank)
    assert len(ranges_failed(changed(crank, tmp_path, plant))) == 1
