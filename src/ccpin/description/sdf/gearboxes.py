"""A gearbox joint as a coupling of the two joints in which its bodies turn."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from ccpin.arrays import Array
from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import Coupling, CouplingTerm, Joint
from ccpin.description.sdf.joints import Gearbox
from ccpin.description.xml import fail

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
    tree = _Tree({joint.child: joint for joint in joints})
    return tuple(_coupling(gear, tree, poses) for gear in gears)


def _coupling(gear: Gearbox, tree: _Tree, poses: Mapping[str, Array]) -> Coupling:
    (driven, theta_2), (driver, theta_1) = (
        _angle(gear, link, axis, tree, poses) for link, axis in ((gear.child, gear.axis2), (gear.parent, gear.axis))
    )
    terms = CouplingTerm(driven, (0.0, theta_2)), CouplingTerm(driver, (0.0, gear.ratio * theta_1))
    return Coupling(gear.name, terms)


def _angle(gear: Gearbox, link: str, axis: Array, tree: _Tree, poses: Mapping[str, Array]) -> tuple[str, float]:
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


class _Tree:
    """The joints of a tree by their child links, and how many stand above each link; a circle is cut somewhere."""

    def __init__(self, by_child: Mapping[str, Joint]) -> None:
        self.by_child = by_child
        self._depth: dict[str, int] = {}
        for link in by_child:
            way = []
            while link in by_child and link not in self._depth:
                way.append(link)
                self._depth[link] = 0  # a circle of joints, refused later on, ends here
                link = by_child[link].parent
            above = self._depth.get(link, 0)
            self._depth |= {below: above + k for k, below in enumerate(reversed(way), start=1)}

    def moving_between(self, link: str, other: str) -> Iterator[tuple[Joint, float]]:
        """The joints that move one link in the other: 1 on the way up from the one, −1 on that from the other."""
        for _ in range(2 * len(self.by_child)):
            if link == other or not (link in self.by_child or other in self.by_child):
                return
            up = link in self.by_child and self._depth[link] >= self._depth.get(other, 0)
            joint = self.by_child[link if up else other]
            if joint.kind != FIXED:
                yield joint, 1.0 if up else -1.0
            link, other = (joint.parent, other) if up else (link, joint.parent)


def _to_world(joint: Joint, by_child: Mapping[str, Joint], poses: Mapping[str, Array]) -> Array:
    """The rotation (3, 3) of a joint's frame in the world at zero displacement."""
    turn, link = joint.placement[:3, :3], joint.parent
    while link not in poses:
        turn, link = by_child[link].placement[:3, :3] @ turn, by_child[link].parent
    return np.asarray(poses[link][:3, :3] @ turn)
