"""Ways between the links of a tree of joints, walked without ways to the root."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import Joint


class JointTree:
    """Joints by their child links, and how many stand above each link.

    Args:
        joints: Those of a tree. A circle of joints, which is refused elsewhere, is cut somewhere.
    """

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.by_child = {joint.child: joint for joint in joints}
        self.links = {link for joint in joints for link in (joint.parent, joint.child)}
        self._depth: dict[str, int] = {}
        for link in self.by_child:
            way = []
            while link in self.by_child and link not in self._depth:
                way.append(link)
                self._depth[link] = 0  # where a circle ends
                link = self.by_child[link].parent
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
