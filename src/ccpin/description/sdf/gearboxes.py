"""A gearbox joint as a coupling of the two joints in which its bodies turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import islice

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.joint_tree import JointTree
from ccpin.description.elements.xml import fail
from ccpin.description.model import Coupling, CouplingTerm, Joint
from ccpin.description.sdf.joints import Gearbox

_PARALLEL = 1e-2  # files turn frames by 1.57: the axis tells which joint is meant


def gear_couplings(
    gears: Sequence[Gearbox], joints: Sequence[Joint], poses: Mapping[str, Array]
) -> tuple[Coupling, ...]:
    """θ₂ + ratio θ₁ = 0 of each: θ₁ turns the parent link about the first axis from the reference link, θ₂ the child.

    Exact where one joint of the tree turns each link in the reference link about the axis stated, which is what the
    gearbox asks for; anything else is refused.

    Args:
        gears: The gearboxes.
        joints: Those of the tree.
        poses: The poses of links (4, 4) in the world at zero displacement, as far as they are stated.

    Raises:
        DescriptionError: No such joint turns a link.
    """
    tree = JointTree(joints)
    return tuple(_coupling(gear, tree, poses) for gear in gears)


def _coupling(gear: Gearbox, tree: JointTree, poses: Mapping[str, Array]) -> Coupling:
    (driven, theta_2), (driver, theta_1) = (
        _angle(gear, link, axis, tree, poses) for link, axis in ((gear.child, gear.axis2), (gear.parent, gear.axis))
    )
    terms = CouplingTerm(driven, (0.0, theta_2)), CouplingTerm(driver, (0.0, gear.ratio * theta_1))
    return Coupling(gear.name, terms)


def _angle(gear: Gearbox, link: str, axis: Array, tree: JointTree, poses: Mapping[str, Array]) -> tuple[str, float]:
    """The joint that turns a link in the reference link, and the sign of its angle about the axis."""
    moving = list(islice(tree.moving_between(link, gear.reference), 2))
    if len(moving) == 1 and moving[0][0].kind in ("revolute", "continuous"):
        joint, sign = moving[0]
        along = _to_world(joint, tree.by_child, poses) @ joint.axis
        if np.linalg.norm(np.cross(along, axis)) < _PARALLEL:
            return joint.name, sign * float(np.sign(along @ axis))
    raise fail(
        gear.element,
        f"no single revolute joint of the tree turns '{link}' in '{gear.reference}' about the axis stated: "
        "this gearbox cannot be expressed",
    )


def _to_world(joint: Joint, by_child: Mapping[str, Joint], poses: Mapping[str, Array]) -> Array:
    """The rotation (3, 3) of a joint's frame in the world at zero displacement."""
    turn, link = joint.placement[:3, :3], joint.parent
    while link not in poses:
        turn, link = by_child[link].placement[:3, :3] @ turn, by_child[link].parent
    return np.asarray(poses[link][:3, :3] @ turn)
