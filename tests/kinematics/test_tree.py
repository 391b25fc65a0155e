"""The tree: joints in Pinocchio's order, one support mask, and nothing in it that can be written to."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest

from ccpin.arrays import FrozenMapping
from ccpin.errors import InvalidInputError
from ccpin.kinematics.tree import ROOT_JOINT, Tree, build_tree
from tests.support.strategies import Growth

KINDS = ("revolute", "continuous", "prismatic", "spherical", "planar", "floating")


@pytest.fixture(scope="module")
def tree():
    """Two branches on a floating base, one joint of each kind."""
    growth = Growth(np.random.default_rng(41))
    growth.grow(growth.grow("base", KINDS[:2]), KINDS[2:4])
    growth.grow("base", (*KINDS[4:], "fixed"))
    return build_tree(growth.drawn().description, floating_base=True)


def test_joints_are_pinocchios(tree):
    """Numbers, parents, windows and placements are the model's; axes are what its joints turn or slide about."""
    model = tree.model
    assert tree.names == tuple(model.names)[1:]
    assert tree.joints[0].name == ROOT_JOINT
    for number, joint in enumerate(tree.joints, start=1):
        added = model.joints[number]
        assert (joint.number, joint.parent, tree.joint(joint.name)) == (number, model.parents[number], joint)
        assert (joint.q.start, joint.v.start) == (added.idx_q, added.idx_v)
        assert (joint.q.stop - joint.q.start, joint.v.stop - joint.v.start) == (added.nq, added.nv)
        np.testing.assert_array_equal(joint.placement, model.jointPlacements[number].homogeneous)
        if joint.kind.nv == 1:
            part = slice(0, 3) if joint.kind.sliding else slice(3, 6)
            np.testing.assert_allclose(np.ravel(added.createData().S)[part], joint.axis, atol=1e-15)


def test_support_is_the_path_from_the_world(tree):
    """1 exactly for the components of the joints between the world and a joint."""
    model = tree.model
    np.testing.assert_array_equal(tree.support(0), np.zeros(model.nv))
    for joint in tree.joints:
        mask = np.zeros(model.nv)
        for number in list(model.supports[joint.number])[1:]:
            mask[tree.joints[number - 1].v] = 1.0
        np.testing.assert_array_equal(tree.support(joint.number), mask)


@pytest.mark.parametrize("pickled", [False, True])
def test_nothing_can_be_written(tree, pickled):
    """Neither fields, mappings nor arrays, before and after pickling."""
    kept = pickle.loads(pickle.dumps(tree)) if pickled else tree
    assert isinstance(kept, Tree)
    assert isinstance(kept.attachments, FrozenMapping)
    assert list(kept.attachments) == list(tree.attachments)
    with pytest.raises(FrozenInstanceError):
        kept.joints = ()
    with pytest.raises(TypeError):
        kept.attachments["base"] = kept.attachments["l0"]
    arrays = [array for joint in kept.joints for array in (joint.placement, joint.axis)]
    arrays += [attachment.placement for attachment in kept.attachments.values()]
    arrays += [kept.support(joint.number) for joint in kept.joints]
    for array in arrays:
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


def test_unknown_joint(tree):
    """The message says which joints there are."""
    with pytest.raises(InvalidInputError, match="'hip' is not a movable joint; there are root_joint, "):
        tree.joint("hip")
