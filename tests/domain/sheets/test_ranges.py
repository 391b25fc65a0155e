"""Ranges of a search: what goes farther than the lengths of a mechanism is counted all the same."""

from functools import cache

import numpy as np
import pytest

import ccpin
from ccpin.domain import certify_sheets, certify_singularities, merge
from ccpin.errors import InvalidInputError, UnsupportedMechanismError
from ccpin.proof.ranges import Reason
from tests.oracles import five_bar as oracle
from tests.support.carriages import double_slider, five_bar_with_rotor, rail, two_carriages
from tests.support.five_bars import load_five_bar
from tests.support.long_cases import later
from tests.support.places import ROOT

BAR = oracle.FiveBar(0.3, 0.25, 0.2, 0.15, 0.2)
FAR = ([-2.4, -1.8], [-1.4, -0.8])


def assembled(bar, q):
    """How many configurations a five-bar has over q (K, 2), and which q are near where that changes."""
    far = np.abs(oracle.elbows(bar, *q.T))
    least, most = abs(bar.a3 - bar.a4), bar.a3 + bar.a4
    return 2 * ((far > least) & (far < most)), np.minimum(np.abs(far - least), np.abs(far - most)) < 1e-9


def wrong(sheets, q, counts):
    """How many counts that are said are not those of a closed form."""
    said = sheets.number_of_solutions(q)
    return int(np.sum((said >= 0) & (said != counts)))


@cache
def of_the_bare_bar():
    """What is counted of the five-bar without a rotor, and how many singular curves it has."""
    bare = load_five_bar(BAR)
    return certify_sheets(bare, FAR, max_depth=5).counted_fraction, len(certify_singularities(bare, FAR).curves)


@pytest.mark.parametrize("ratio", later(50.0, -0.5, 5.0))
def test_a_rotor_turns_farther_than_the_mechanism_is_long(ratio):
    """A rotor on arm 1 takes part in nothing: counts and curves are those of the five-bar without it."""
    q = np.random.default_rng(0).uniform(*FAR, (2000, 2))
    counts, near = assembled(BAR, q)
    geared, (counted, number) = five_bar_with_rotor(BAR, ratio), of_the_bare_bar()
    sheets = certify_sheets(geared, FAR, max_depth=5)
    assert not wrong(sheets, q[~near], counts[~near])
    assert sheets.counted_fraction > counted - 0.05 > 0.6
    if ratio < 50.0:
        curves = certify_singularities(geared, FAR)
        assert len(curves.curves) == number > 0
        assert curves.verdict == "proven"


@pytest.mark.parametrize("turns", [1.0, pytest.param(2.5, marks=pytest.mark.slow)])
def test_configurations_a_turn_apart_are_others_for_a_rotor(turns):
    """Over a region of several turns of a coupled joint every turn is counted by itself."""
    geared = five_bar_with_rotor(BAR, 5.0)
    region = [-turns * np.pi, 0.9], [turns * np.pi, 1.0]
    sheets = certify_sheets(geared, region, max_depth=6)
    q = np.random.default_rng(1).uniform(*region, (4000, 2))
    counts, near = assembled(BAR, q)
    assert not wrong(sheets, q[~near], counts[~near])
    assert sheets.counted_fraction > 0.6
    assert not np.any(sheets.region.wrapped)


def test_a_rotor_on_a_joint_that_nothing_bounds_is_refused_by_name():
    """A dependent elbow may turn for ever, and its rotor shows how often; with limits there is an end."""
    geared = five_bar_with_rotor(BAR, 5.0, driver="joint3")
    with pytest.raises(UnsupportedMechanismError, match=r"'joint3' has no range .* give the joint a lower"):
        certify_sheets(geared, FAR, max_depth=3)


@pytest.mark.parametrize("file", ["sdf_gearbox.sdf", "mjcf_joint.xml", "sdf_mimic.sdf"])
def test_gears_of_the_documentation_have_one_configuration(file):
    """Whatever the crank's angle, the rocker has its own, two radians a radian."""
    sheets = certify_sheets(ccpin.load(ROOT / "docs/elements" / file), ([-9.0], [9.0]))
    assert sheets.counted_fraction == sheets.certified_fraction == 1.0
    assert np.all(sheets.number_of_solutions(np.linspace(-9.0, 9.0, 41)[:, None]) == 1)


def test_a_double_slider_far_from_its_origin():
    """Two configurations at every point of [10, 12], a rod's length before and behind the drive."""
    sheets = certify_sheets(double_slider(0.5, 0.3), ([10.0], [12.0]))
    assert np.all(sheets.number_of_solutions(np.linspace(10.0, 12.0, 41)[:, None]) == 2)
    reasons = sheets.ranges.reasons[~sheets.ranges.turning]
    assert np.all(reasons == Reason.LENGTHS)


@pytest.mark.parametrize(
    ("lower", "upper"), [(10.2, 11.3), (10.2, np.inf), (-np.inf, 11.3), (-1.0, 1.0), (-50.0, 50.0)]
)
def test_limits_of_a_far_slide_are_part_of_what_is_counted(lower, upper):
    """s = q ± 0.4 within the limits; what is said agrees, and only cells at the limits' q are not counted."""
    sheets = certify_sheets(double_slider(0.5, 0.3, lower=lower, upper=upper), ([10.0], [12.0]))
    q = np.linspace(10.0, 12.0, 4001)[1:-1]
    slides = q[:, None] + np.array([-0.4, 0.4])
    counts = np.sum((slides >= lower) & (slides <= upper), axis=1)
    assert not wrong(sheets, q[:, None], counts)
    assert sheets.counted_fraction > 0.98


@pytest.mark.parametrize("limits", [{}, {"lower": -3.2, "upper": 0.1}])
def test_a_rail_that_travels(limits):
    """The slider goes back by as much as its rail is carried on: x = cos ± √(…), s = x − travel."""
    crank, rod, across = 0.3, 0.5, 0.1
    region = [2.0, -1.0], [4.0, 1.5]
    sheets = certify_sheets(rail(crank, rod, across, **limits), region, max_depth=5)
    q = np.random.default_rng(2).uniform(*region, (5000, 2))
    root = np.sqrt(rod**2 - (across - crank * np.sin(q[:, 1])) ** 2)
    slides = (crank * np.cos(q[:, 1]) - q[:, 0])[:, None] + root[:, None] * [-1.0, 1.0]
    counts = np.sum((slides >= limits.get("lower", -9.0)) & (slides <= limits.get("upper", 9.0)), axis=1)
    assert not wrong(sheets, q, counts)
    assert sheets.counted_fraction > (0.8 if limits else 0.99)


def test_two_carriages():
    """The second goes three times as far: the slider on it comes back, b + s − a = ±rod, turned or not."""
    sheets = certify_sheets(two_carriages(0.5, 3.0), ([5.0], [6.0]))
    assert np.all(sheets.number_of_solutions(np.linspace(5.0, 6.0, 41)[:, None]) == 2)
    reasons = {Reason(int(reason)) for reason in sheets.ranges.reasons.ravel()}
    assert reasons == {Reason.TURN, Reason.COUPLING, Reason.LENGTHS}


def test_parts_of_a_region_have_ranges_of_their_own_and_the_whole_has_its():
    """Farther regions have longer ranges: merged sheets have those of all of it; other limits are refused."""
    parts = [certify_sheets(double_slider(0.5, 0.3), ([low], [low + 1.0])) for low in (10.0, 11.0)]
    both = merge(parts)
    assert both.ranges.upper.max() == pytest.approx(parts[1].ranges.upper.max())
    assert np.all(both.number_of_solutions(np.linspace(10.0, 12.0, 41)[:, None]) == 2)
    limited = certify_sheets(double_slider(0.5, 0.3, lower=9.0, upper=13.0), ([11.0], [12.0]))
    with pytest.raises(InvalidInputError, match="other limits"):
        merge([parts[0], limited])
