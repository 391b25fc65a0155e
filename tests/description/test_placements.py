"""Frames given in Python: 4×4 matrices, SE3 and (xyz, rpy) are one frame in three spellings."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import ccpin
from ccpin.description import Joint, Part, Shape, Visual, combine
from ccpin.errors import DescriptionError, InvalidInputError

XYZ, RPY = (0.1, -0.2, 0.3), (0.4, -1.1, 2.5)


def pose():
    """The frame as Pinocchio makes it."""
    return pin.SE3(pin.rpy.rpyToMatrix(*RPY), np.array(XYZ))


@pytest.mark.parametrize("spelt", [pose(), (XYZ, RPY), [list(XYZ), list(RPY)], np.array([XYZ, RPY])])
def test_every_spelling_is_the_same_frame(spelt):
    """Also of joints, shapes and parts; rpy turns about fixed axes."""
    matrix = pose().homogeneous
    np.testing.assert_allclose(matrix[:3, :3], Rotation.from_euler("xyz", RPY).as_matrix(), atol=1e-15)
    closure = ccpin.LoopClosure("loop", "fixed", "a", "b", spelt, placement_b=spelt)
    np.testing.assert_allclose(closure.placement_a, matrix, atol=1e-15)
    np.testing.assert_allclose(closure.placement_b, matrix, atol=1e-15)
    assert not closure.placement_a.flags.writeable
    np.testing.assert_allclose(Joint("j", "revolute", "a", "b", spelt).placement, matrix, atol=1e-15)
    np.testing.assert_allclose(Visual(Shape("sphere", (1.0,)), spelt).placement, matrix, atol=1e-15)
    whole = combine("two", {"": Part(ccpin.load("rpdr").description, spelt)})
    np.testing.assert_allclose(whole.joints[0].placement, matrix, atol=1e-15)


@pytest.mark.parametrize("wrong", [XYZ, np.eye(3), "0 0 0", None, (XYZ, RPY, XYZ), 3.0])
def test_anything_else_is_refused(wrong):
    """With the spellings there are."""
    with pytest.raises(
        InvalidInputError, match=r"LoopClosure\.placement_a must be a 4×4 matrix, .*SE3 or \(xyz, rpy\)"
    ):
        ccpin.LoopClosure("loop", "fixed", "a", "b", wrong)


def test_a_closure_is_no_tuple(rpdr):
    """The place in the list is told; so it is within a description."""
    with pytest.raises(InvalidInputError, match=r"closures\[0\] must be a LoopClosure, not tuple"):
        ccpin.load("rpdr", closures=[("loop", "fixed", "link1", "link2")])
    from dataclasses import replace

    with pytest.raises(DescriptionError, match=r"closures\[0\]: must be a LoopClosure, not tuple"):
        ccpin.load(replace(rpdr.description, closures=(("loop", "fixed"),)))


def test_a_closure_by_se3_closes_the_same_loop(rpdr):
    """The case study without its loop, closed again from Python."""
    from dataclasses import replace

    (loop,) = rpdr.closures
    ends = (pin.SE3(placement) for placement in (loop.placement_a, loop.placement_b))
    again = ccpin.LoopClosure(loop.name, loop.kind, loop.link_a, loop.link_b, *ends)
    back = ccpin.load(replace(rpdr.description, closures=()), closures=[again])
    np.testing.assert_allclose(back.q_reference, rpdr.q_reference, atol=1e-12)
