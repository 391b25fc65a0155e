"""When two closed configurations are one pose to whoever looks at the mechanism.

A rod between two universal joints, or between a ball and a universal joint, closes with the universal joint turned one
way or the other: every other body stands as before, and the rod has turned half round about its own line. A rod between
two balls may have turned by any angle. Such configurations are counted as one.

**Definition.** Let X_i be the displacement of body i in the world from one configuration to the other; bodies without
mass (the cross of a universal joint) are looked through. The two are *alike* if

1. wherever bodies with different X meet, the point at which they meet is fixed by both X, and
2. bodies that moved, taken together where X is the same, meet others at two different points at least.

By 2 each such X is the identity or a turn about the line through these points, and by 1 nobody else notices.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, Indices, Mask
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import Tree

_SAME = 1e-6  # of the entries of 4×4 poses (m, or none): closed configurations differ by less
_LIGHT = 1e-6  # of the largest mass: a body with less has none and is not looked at
_POINTLESS = ("prismatic", "cylindrical", "planar", "in_plane")
_TURNING_ONLY = ("perpendicular",)
_ORIGIN = np.array([0.0, 0.0, 0.0, 1.0])  # a joint's own, homogeneous


class _BodyEnd(NamedTuple):
    """One end of a place where bodies meet: whose, where on it (homogeneous), and whether a slide makes it no point."""

    joint: int
    point: Array
    slides: bool


class Likeness:
    """Tells whether configurations of a tree whose loops are closed are alike; a pure function of them."""

    def __init__(self, tree: Tree, constraints: Constraints) -> None:
        self._scratch = constraints.scratch
        masses = np.array([inertia.mass for inertia in tree.model.inertias])
        seen = masses > _LIGHT * masses.max(initial=0.0)
        self._seen: Mask = seen if seen.any() else np.ones(len(masses), dtype=np.bool_)
        self._seen[0] = True
        groups = _meetings(tree, constraints, self._seen)
        self._group: Indices = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
        ends = [end for group in groups for end in group]
        self._owner: Indices = np.array([end.joint for end in ends], dtype=np.intp)
        self._points = np.array([end.point for end in ends]).reshape(-1, 4, 1)
        self._slides: Mask = np.array([end.slides for end in ends], dtype=np.bool_)
        # the first end of each group, and for each end that of its own
        first = {int(group): k for k, group in reversed(list(enumerate(self._group)))}
        self._first: Indices = np.array([first[int(group)] for group in self._group], dtype=np.intp)

    def poses(self, q_free: Array) -> Array:
        """What `alike` compares: the joints' poses, of shape (joints + 1, 4, 4)."""
        return np.asarray(joint_poses(self._scratch, q_free))

    def alike(self, a: Array, b: Array) -> bool:
        """Whether two configurations, given by their `poses`, are one pose."""
        change = b @ np.linalg.inv(a)
        moved = self._seen & (np.abs(b - a).max(axis=(1, 2)) > _SAME)
        if not moved.any():
            return True
        own = change[self._owner]
        places = (a[self._owner] @ self._points)[..., :3, :]
        apart = np.abs(own - own[self._first]).max(axis=(1, 2)) > _SAME
        crossed = np.isin(self._group, self._group[apart])
        stays = np.abs((own @ a[self._owner] @ self._points)[..., :3, :] - places).max(axis=(1, 2)) <= _SAME
        if np.any(crossed & (self._slides | ~stays)):
            return False
        return all(_hangs(change[joint], own[crossed], places[crossed, :, 0]) for joint in np.flatnonzero(moved))


def _hangs(change: Array, others: Array, places: Array) -> bool:
    """Whether bodies displaced by the same X meet others at two different points at least."""
    mine = places[np.abs(others - change).max(axis=(1, 2)) <= _SAME]
    return len(mine) > 1 and float(np.linalg.norm(mine - mine[0], axis=1).max()) > _SAME


def _meetings(tree: Tree, constraints: Constraints, seen: Mask) -> list[list[_BodyEnd]]:
    """Where bodies with mass meet: the ends of what joins them, directly or through bodies without mass."""
    edges = [
        (_BodyEnd(joint.parent, joint.placement[:, 3], any(joint.kind.slides)), _BodyEnd(joint.number, _ORIGIN, False))
        for joint in tree.joints
    ]
    for loop in constraints.loops:
        if loop.closure.kind not in _TURNING_ONLY:
            slides = loop.closure.kind in _POINTLESS
            ends = ((loop.joint_a, loop.frame_a[:, 3]), (loop.joint_b, loop.frame_b[:, 3]))
            edges.append((_BodyEnd(*ends[0], slides), _BodyEnd(*ends[1], slides)))
    through = list(range(len(seen)))
    for a, b in edges:
        if not seen[a.joint] and not seen[b.joint]:
            old, new = through[b.joint], through[a.joint]
            through = [new if group == old else group for group in through]
    groups: dict[object, list[_BodyEnd]] = {}
    for k, (a, b) in enumerate(edges):
        looked_through = [through[end.joint] for end in (a, b) if not seen[end.joint]]
        key = ("body", looked_through[0]) if looked_through else ("edge", k)
        groups.setdefault(key, []).extend(end for end in (a, b) if seen[end.joint])
    return [group for group in groups.values() if group]
