"""Atlases far from zero, of a 3-RPR in millimetres and of the RPDR 64 turns on: no gaps, and the audit holds."""

from __future__ import annotations

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.covering.cells import CellStatus
from ccpin.domain import scalar_coordinates_at
from tests.oracles import cusped_3rpr as cusped
from tests.support.cusped import cusped_mechanism
from tests.support.long_cases import later

pytest.importorskip("flint")
from ccpin.auditing import verify


def three_rpr():
    """In millimetres: (mechanism, q₀, region)."""
    cusp = cusped.cusp()
    along = cusped.null_direction(cusp) / np.linalg.norm(cusped.null_direction(cusp))
    mechanism = cusped_mechanism(cusp + 0.3 * along, 1000.0)
    q = scalar_coordinates_at(mechanism, mechanism.q_reference)
    return mechanism, q, (q - 20.0, q + 20.0)


def far_rpdr():
    """64 turns on."""
    q = np.array([-1.9, -1.2]) + 128.0 * np.pi
    return ccpin.load("rpdr"), q, (q - 0.3, q + 0.3)


@pytest.mark.parametrize("made", later(three_rpr, far_rpdr))
def test_an_atlas_far_from_zero_is_proved_by_the_audit(made, tmp_path):
    """Of 2,007 faces 699 were proved and `holds` was False, on our own atlas."""
    mechanism, q, region = made()
    atlas = domain.certify(mechanism, q, region, max_depth=4, resolution=0.1)
    assert atlas.single_valued
    rng, cells = np.random.default_rng(2), atlas.tree.leaves(CellStatus.CERTIFIED)
    faces = atlas.region.position(atlas.tree.lower[cells])
    points = np.concatenate([faces, rng.uniform(*region, (300, 2))])
    known = atlas.status(points) == CellStatus.CERTIFIED
    assert np.array_equal(atlas.contains(points), known)
    atlas.save(tmp_path / "far.npz")
    audit = verify(tmp_path / "far.npz", sample=5)
    assert audit.holds, str(audit)
    assert audit.claims[1].checked == 5
