"""Loading mechanisms of many loops: cluster by cluster, in linear cost, and with no scratch memory of the whole."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings

import ccpin
from ccpin.kinematics.clusters import cut
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.scratch import Scratch
from ccpin.kinematics.tree import build_tree
from ccpin.mechanism.loading.reference_search import stated_pose
from tests.support import families
from tests.support.backends import same_on_both
from tests.support.long_cases import later
from tests.support.strategies import mechanisms

pytestmark = same_on_both

every_family = pytest.mark.parametrize("family", [families.serial, families.parallel])


@settings(max_examples=40)
@given(mechanisms(max_loops=3))
def test_parts_are_the_blocks_of_the_whole(drawn):
    """φ and φ_q′ of the clusters are those of the whole tree, and outside the clusters' columns it is zero."""
    description = drawn.description
    tree = build_tree(description)
    whole = Constraints(tree, description.closures, ())
    q_free = stated_pose(tree, description)
    value, rows = whole.value(q_free), whole.row_slices()
    seen = np.zeros((whole.size, tree.model.nv), dtype=bool)
    for part in cut(tree, description.closures, ()):
        own = Constraints(part.tree, part.closures, ())
        found = own.value(q_free[part.q])
        for name, window in own.row_slices().items():
            # rows in the common ancestor's axes are as they were; the ancestor may be the part's world
            np.testing.assert_allclose(found.phi[window], value.phi[rows[name]], rtol=0, atol=1e-12)
            block = value.jacobian[rows[name]][:, part.v]
            np.testing.assert_allclose(found.jacobian[window], block, rtol=0, atol=1e-12)
            seen[rows[name], part.v[:, None].T] = True
    assert not np.any(value.jacobian[~seen])


@every_family
def test_every_four_bar_is_at_its_closed_form(family):
    """40 four-bars: the cranks are independent in their order, and every loop sits where the closed form says."""
    mechanism = ccpin.load(family(40))
    assert mechanism.independent == mechanism.actuated == tuple(f"crank_joint{k}" for k in range(40))
    coupler, rocker = families.four_bar_angles()
    by_name = dict(zip(mechanism.tree.names, mechanism.q_reference, strict=True))
    for k in range(40):
        found = [by_name[f"{part}_joint{k}"] for part in ("crank", "coupler", "rocker")]
        np.testing.assert_allclose(found, [families.START, coupler, rocker], rtol=0, atol=1e-10)
    assert mechanism.mobility == (120, 80, 80, 40, (), ())


@pytest.mark.parametrize("family", later(families.serial, families.parallel))
def test_no_scratch_memory_of_the_whole_tree(family, monkeypatch):
    """Pinocchio's Data of 400 joints takes 3.5 GB; a load asks for that of single clusters only."""
    sizes = []
    lent = Scratch.lent
    monkeypatch.setattr(Scratch, "lent", lambda self: sizes.append(self.model.nv) or lent(self))
    assert ccpin.load(family(134)).n_free == 402
    assert max(sizes) == 3


@pytest.mark.parametrize("family", later(families.parallel, families.serial))
def test_the_cost_grows_in_proportion(family):
    """Four times the loops make at most 4^1.1 times the calls."""

    def calls(n):
        count, description = 0, family(n)

        def tally(frame, event, _):
            nonlocal count
            count += event == "call"

        sys.setprofile(tally)
        try:
            ccpin.load(description)
        finally:
            sys.setprofile(None)
        return count

    calls(1)
    assert calls(64) <= 4**1.1 * calls(16)


def test_many_loops_on_one_shaft_are_closed_one_after_another():
    """42 loops that share a crank close from the zero pose, where none of the starts closes all at once."""
    mechanism = ccpin.load(families.walker(14))
    assert (mechanism.n_free, mechanism.mobility.rank, mechanism.n) == (85, 84, 1)
    assert np.abs(mechanism.constraints().residual(mechanism.q_reference)).max() <= 1e-11


def test_limits_that_exclude_every_closed_pose_are_told():
    """Where nothing that closes is within the limits the search ends after a few starts, and says so."""
    mechanism = ccpin.load(families.walker(14, limit=0.5))
    assert "the reference configuration lies outside some joint limits: none inside was found" in mechanism.notes


def test_a_closed_pose_outside_the_limits_is_moved_into_them():
    """A leg closed outside its limits slides along its own motion into them, on the branch it is on."""
    free = ccpin.load(families.walker(1))
    stated = free.q_reference[list(free.tree.names).index("shaft")]
    description = families.walker(1)
    shaft, *others = description.joints
    limited = (replace(shaft, lower=stated + 0.2, upper=stated + 0.6), *others)
    pose = dict(zip(free.tree.names, ((x,) for x in free.q_reference), strict=True))
    mechanism = ccpin.load(replace(description, joints=limited, reference=pose))
    assert "the loops were closed from the stated pose, moved into the joint limits" in mechanism.notes
    found = mechanism.q_reference[list(mechanism.tree.names).index("shaft")]
    assert stated + 0.2 <= found <= stated + 0.6
    assert np.abs(mechanism.q_reference - free.q_reference).max() < 1.0
