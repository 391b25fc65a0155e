"""Ranges in the auditor: gears, rails and far slides, derived by code of its own."""

import numpy as np
import pytest

from ccpin import domain
from ccpin.domain import scalar_coordinates_at
from tests.oracles.five_bar import FiveBar
from tests.support.altered import changed
from tests.support.carriages import double_slider, five_bar_with_rotor, rail, two_carriages
from tests.support.long_cases import later

pytest.importorskip("flint")

from ccpin.auditing import closures, empty_cells, reading, verify

BAR = FiveBar(0.3, 0.25, 0.2, 0.15, 0.2)
FAR = ([-2.4, -1.8], [-1.4, -0.8])
MADE = {
    "rotor": (lambda: five_bar_with_rotor(BAR, 5.0), FAR),
    "far": (lambda: double_slider(0.5, 0.3), ([10.0], [12.0])),
    "far within limits": (lambda: double_slider(0.5, 0.3, lower=10.2), ([10.0], [12.0])),
    "rail": (lambda: rail(0.3, 0.5, 0.1, upper=0.1), ([2.0, -1.0], [4.0, 1.5])),
    "carriages": (lambda: two_carriages(0.5, 3.0), ([5.0], [6.0])),
}


@pytest.mark.parametrize("made", [*later("carriages", "far", "rail"), "rotor", "far within limits"])
def test_counts_of_what_goes_far_are_audited(made, tmp_path):
    """The auditor finds the same ranges, searches them, and proves the counts."""
    build, region = MADE[made]
    domain.certify_sheets(build(), region, max_depth=4).save(tmp_path / "sheets.json")
    audit = verify(tmp_path / "sheets.json", sample=3)
    assert audit.holds, str(audit)


@pytest.mark.parametrize("made", ["far", "carriages"])
def test_counts_over_less_than_there_is_are_found(made, tmp_path):
    """Two configurations said to be one, with a range that leaves the other out, and none told of."""
    build, region = MADE[made]
    domain.certify_sheets(build(), region, max_depth=2).save(tmp_path / "sheets.json")
    file = reading.read(tmp_path / "sheets.json")
    slide = int(np.flatnonzero(np.all(file.ranges.reasons == 3, axis=1))[0])

    def narrow(arrays):
        arrays["ranges_lower"][slide] = 0.5 * (arrays["ranges_lower"][slide] + arrays["ranges_upper"][slide])

    audit = verify(changed(tmp_path / "sheets.json", tmp_path, narrow), sample=2)
    assert not audit.holds


@pytest.mark.slow
def test_curves_of_a_geared_five_bar_are_audited(tmp_path):
    """The rotor's range is the image of the region; a narrower one is not proved."""
    geared = five_bar_with_rotor(BAR, 1.0)
    domain.certify_singularities(geared, FAR).save(tmp_path / "curves.json")
    audit = verify(tmp_path / "curves.json", sample=4)
    assert audit.holds, str(audit)

    def narrow(arrays):
        rotor = int(np.flatnonzero(arrays["range_reasons"][:, 0] == 2)[0])
        arrays["range_upper"][rotor] -= 0.1

    assert not verify(changed(tmp_path / "curves.json", tmp_path, narrow), sample=1).holds


def test_a_geared_elbow_without_limits_is_not_held_still(tmp_path):
    """Nothing bounds the elbow; a cell that is certified is not proved to be empty all the same."""
    geared = five_bar_with_rotor(BAR, 5.0, driver="joint3")
    q0 = scalar_coordinates_at(geared, geared.q_reference)
    domain.certify(geared, q0, (q0 - 0.01, q0 + 0.01), max_depth=1).save(tmp_path / "atlas.json")
    file = reading.read(tmp_path / "atlas.json")
    look = empty_cells.Emptiness(closures.BallClosures(file), file)
    assert not look.searched
    assert not look._all_apart([look.whole(file.lower, file.upper)])
