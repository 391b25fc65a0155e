"""A stated pose that is open may close in several ways: the notes name them, and what they name leads there."""

import re
import time
from dataclasses import replace

import numpy as np
import pytest

import ccpin
from ccpin.mechanism.poses import branches
from tests.support import families
from tests.support.backends import same_on_both
from tests.support.places import SHARED

pytestmark = same_on_both


def undecided(family, n):
    """Four-bars drawn open: nothing says whether the rockers stand up or down."""
    return replace(family(n), reference={})


def named(mechanism):
    """The joints that tell branches apart, each with its value on the other branch and here."""
    notes = [note for note in mechanism.notes if "close in other ways too" in note]
    return [(joint, float(there), float(here)) for joint, there, here in _choices(notes)]


def _choices(notes):
    return [choice for note in notes for choice in re.findall(r"(\S+) = (\S+) in place of (\S+) ", note)]


def rocker_angles(crank):
    """Both rocker angles over a crank angle, in closed form: rocker and coupler mirror each other at the diagonal."""
    ground, tip = families.GROUND, families.CRANK * np.array([np.cos(crank), np.sin(crank)])
    across = np.array([ground, 0.0]) - tip
    far, toward = np.hypot(*across), np.arctan2(-across[1], -across[0])
    cosine = (far**2 + families.ROCKER**2 - families.COUPLER**2) / (2.0 * far * families.ROCKER)
    return toward + np.arccos(cosine), toward - np.arccos(cosine)


@pytest.mark.parametrize("n", [1, 3])
def test_both_ways_to_close_a_four_bar_are_told(n):
    """The rocker's other angle is the closed form's, and stating it leads to that side."""
    mechanism = ccpin.load(undecided(families.parallel, n))
    by_name = dict(zip(mechanism.tree.names, mechanism.q_reference, strict=True))
    found = named(mechanism)
    assert [joint for joint, _, _ in found] == [f"rocker_joint{k}" for k in range(n)]
    for k, (joint, there, here) in enumerate(found):
        angles = np.angle(np.exp(1j * np.array(rocker_angles(by_name[f"crank_joint{k}"]))))
        np.testing.assert_allclose(sorted([there, here]), sorted(angles), rtol=2e-3)
        other = ccpin.load(undecided(families.parallel, n), reference={joint: there})
        turned = float(other.q_reference[other.tree.joint(joint).q][0])
        assert abs(turned - there) < abs(turned - here)


def test_a_pose_that_closes_is_a_choice():
    """Nothing is said of other branches then."""
    assert not named(ccpin.load(families.parallel(2)))
    assert not named(ccpin.load("rpdr"))


def test_few_starts_in_all(monkeypatch):
    """64 loops: the budget is shared, at most three are told one by one, and the cost stays below the load's."""
    spent, told = [], branches.told

    def timed(*arguments):
        begin = time.process_time()
        try:
            return told(*arguments)
        finally:
            spent.append(time.process_time() - begin)

    monkeypatch.setattr("ccpin.mechanism.loading.reference_search.told", timed)
    begin = time.process_time()
    mechanism = ccpin.load(undecided(families.serial, 64))
    whole = time.process_time() - begin
    assert len(named(mechanism)) == 3
    assert spent[0] < 0.4 * whole


@pytest.mark.parametrize("name", ["5bar_linkage_iso3d", "cassie_like"])
def test_files_of_others(name):
    """What is named leads to the other branch there too."""
    if not (SHARED / name).exists():
        pytest.skip(f"no {SHARED / name}: these files belong to others")
    for joint, there, here in named(ccpin.load(SHARED / name)):
        other = ccpin.load(SHARED / name, reference={joint: there})
        turned = float(other.q_reference[other.tree.joint(joint).q][0])
        assert abs(turned - there) < abs(turned - here)
