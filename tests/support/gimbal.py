"""The Stewart platform whose first ball is three revolutes, and the same one written with a ball joint."""

from functools import cache

import pinocchio as pin

import ccpin
from tests.support import linkages

TRIPLE = ("platform_pitch", "platform_roll", "platform_yaw")


@cache
def stewart():
    """Of `models/`: leg 1's ball at the platform is three revolutes, which come to gimbal lock when it falls."""
    return ccpin.ReducedModel(ccpin.load("stewart"))


@cache
def stewart_on_balls():
    """Written with a ball there."""
    return ccpin.ReducedModel(ccpin.load(linkages.stewart_on_balls()))


def link_pose(mechanism, q_free, link):
    """Where a link is, as a 4×4 frame, by Pinocchio's forward kinematics."""
    data = mechanism.pin_model.createData()
    pin.forwardKinematics(mechanism.pin_model, data, q_free)
    at = mechanism.tree.attachments[link]
    return data.oMi[at.joint].homogeneous @ at.placement
