"""Emptiness by search against closed forms, where the triangle inequality proves nothing."""

import numpy as np
import pytest

import ccpin
from ccpin import domain
from ccpin.covering.cells import CellStatus
from ccpin.domain import scalar_coordinates_at
from ccpin.domain.closures.searchable import all_values
from ccpin.domain.closures.system import reading_of
from tests.oracles import planar_3rpr as oracle
from tests.oracles import planar_3rrr
from tests.support.legs import WHOLE, load_slice, with_first_leg
from tests.support.places import ROOT


@pytest.mark.slow
def test_nothing_empty_closes():
    """Of 20,000 points none that is called empty has a real root of the sextic; most that have none are called so.

    Certified, empty, singular, undecided and unreached add up to the region.
    """
    mechanism = load_slice()
    q0 = scalar_coordinates_at(mechanism, mechanism.q_reference)
    legs = domain.certify(mechanism, q0, WHOLE, max_depth=6, exhaustive=True)
    q = np.random.default_rng(0).uniform(*WHOLE, (20_000, 2))
    empty = legs.status(q) == CellStatus.EMPTY
    modes, doubtful = oracle.modes(with_first_leg(q))
    assert not np.any(modes[empty & ~doubtful])
    assert empty.mean() > 0.8 * (modes == 0).mean() > 0.1
    parts = legs.certified_fraction, legs.empty_fraction, legs.singular_fraction, legs.undecided_fraction
    assert sum(parts) + legs.unreached_fraction == pytest.approx(1.0, abs=1e-12)


def test_slides_are_bounded_by_the_loops():
    """The 3-RRR's platform slides go no farther than all links of a leg in a row, and at least as far as both less."""
    mechanism = ccpin.load("planar_3rrr")
    reading = reading_of(mechanism, mechanism.q_reference)
    system, ranges = reading.system, all_values(reading, np.full(3, -np.pi), np.full(3, np.pi))
    slides = ~system.periodic[system.dependent]
    assert np.count_nonzero(slides) == 2
    reach = planar_3rrr.BASE_RADIUS + planar_3rrr.PROXIMAL + planar_3rrr.DISTAL + planar_3rrr.PLATFORM_RADIUS
    assert np.all(ranges.upper[slides] >= planar_3rrr.PROXIMAL + planar_3rrr.DISTAL)
    assert np.all(ranges.upper[slides] <= reach * 1.001)


def test_chains_that_do_not_bound_their_slides_are_left_alone():
    """The slider-crank's slide is bounded by its loop; ball joints have no ranges."""
    crank = ccpin.load("slider_crank")
    assert all_values(reading_of(crank, crank.q_reference), np.full(1, -np.pi), np.full(1, np.pi)) is not None
    ankle = ccpin.load(ROOT / "docs/howto/ankle.urdf")
    assert all_values(reading_of(ankle, ankle.q_reference), np.full(2, -1.0), np.full(2, 1.0)) is None
