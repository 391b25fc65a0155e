"""Axes that are parallel within a tolerance, made exactly so: what a drawing means and rounded angles no longer say.

Two axes fixed in one body that are parallel stay so in every pose: those of the joint that carries the body, of the
joints and closures it carries, and, where it only slides, of the bodies below it. They are visited from the root on,
and each is turned by the smallest rotation onto the first one it is nearly parallel to; a slide that is nearly
perpendicular to an axis is made exactly so. A chain of such pairs makes a loop planar, or a leg of Sarrus' linkage
keep its platform's heading, without a misfit of second order such as least squares on a pose's rows leave.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, cross, skew
from ccpin.description.model import frame
from ccpin.kinematics.loops import ResolvedClosure
from ccpin.kinematics.tree import TreeJoint
from ccpin.mechanism.repair.geometry import Change, ClusterGeometry, Relations

_AXES = {"revolute": False, "cylindrical": False, "planar": False, "prismatic": True}
"""Whether the z axis of a closure's frames slides, by its kind."""


class _Axis(NamedTuple):
    """A direction fixed in a body, and the sibling joint it belongs to (``None``: the body's own or a closure's)."""

    direction: Array
    sibling: str | None


def parallel_axes(shape: ClusterGeometry, angle: float) -> Relations:
    """Make axes parallel, and slides perpendicular to axes, that are so up to an angle (rad)."""
    return _Relating(shape, angle).relations()


class _Relating:
    def __init__(self, shape: ClusterGeometry, angle: float) -> None:
        self.shape, self.angle = shape, angle
        loops = shape.constraints.loops
        self.on_loop = {joint for loop in loops for joint in (*loop.path_a, *loop.path_b)}
        self.axes: dict[int, list[_Axis]] = {}
        self.found = Relations(Change({}, {}, {}), set(), set())

    def relations(self) -> Relations:
        """Visit the joints on loops from the root on, then the closures."""
        for joint in self.shape.part.tree.joints:
            if joint.number in self.on_loop:
                self.visit(joint)
        for loop in self.shape.constraints.loops:
            turns = [self.end(loop, end) for end in (0, 1)]
            if loop.closure.kind in ("fixed", "prismatic"):
                turns[0] = self.through(loop, turns)
            self.found.change.ends[loop.closure.name] = turns[0], turns[1]
        lengths = {c.name: 0.0 for c in self.shape.part.closures if c.length is not None}
        return self.found._replace(change=self.found.change._replace(lengths=lengths))

    def visit(self, joint: TreeJoint) -> None:
        """Relate a joint's axis to those of the body that carries it, and collect the axes of its own body."""
        carrying = self.axes.setdefault(joint.parent, [])
        turn, own = joint.placement[:3, :3], []
        steps = joint.kind.directions(joint.axis)
        if joint.kind.nv == 1 or joint.kind.name == "planar":
            direction, slides = steps[-1], joint.kind.slides[-1]
            turned = self.related(turn @ direction, slides, carrying, joint.name)
            motion = np.eye(3) if turned is None else turn.T @ turned @ turn
            self.found.change.joints[joint.name] = frame(np.zeros(3), motion)
            turn = turn @ motion
            own = [_Axis(direction, None)]
        if joint.kind.sliding:
            own += [_Axis(turn.T @ axis.direction, None) for axis in carrying if axis.sibling != joint.name]
        self.axes[joint.number] = own

    def related(self, direction: Array, slides: bool, carrying: list[_Axis], sibling: str | None) -> Array | None:
        """The rotation, in the body's axes, that relates a direction to those it carries; ``None`` if none is near."""
        for axis in carrying:
            if float(np.linalg.norm(cross(direction, axis.direction))) < self.angle:
                self.freeze(sibling, axis)
                return _onto(direction, axis.direction * np.sign(direction @ axis.direction))
        for axis in carrying if slides else ():
            along = float(direction @ axis.direction)
            if abs(along) < self.angle:
                self.freeze(sibling, axis)
                across = direction - along * axis.direction
                return _onto(direction, across / np.linalg.norm(across))
        if sibling is not None:
            carrying.append(_Axis(direction, sibling))
        return None

    def freeze(self, sibling: str | None, axis: _Axis) -> None:
        self.found.joints.update(name for name in (sibling, axis.sibling) if name is not None)

    def end(self, loop: ResolvedClosure, end: int) -> Array:
        """The turn of one of a closure's frames that relates its z axis to its body's axes, 4×4 in the frame's axes."""
        if loop.closure.kind not in _AXES:
            return np.eye(4)
        turn = (loop.frame_a, loop.frame_b)[end][:3, :3]
        carrying = self.axes.get((loop.joint_a, loop.joint_b)[end], [])
        turned = self.related(turn[:, 2], _AXES[loop.closure.kind], carrying, None)
        if turned is None:
            return np.eye(4)
        self.found.ends.add((loop.closure.name, end))
        return frame(np.zeros(3), turn.T @ turned @ turn)

    def through(self, loop: ResolvedClosure, turns: list[Array]) -> Array:
        """The turn of frame A with which a weld passes on its bodies' axes: those of A seen in A as those of B in B."""
        a, b = (
            (placement[:3, :3] @ turn[:3, :3]).T
            for placement, turn in zip((loop.frame_a, loop.frame_b), turns, strict=True)
        )
        for here in self.axes.get(loop.joint_a, []):
            for there in self.axes.get(loop.joint_b, []):
                x, y = a @ here.direction, b @ there.direction
                if float(np.linalg.norm(cross(x, y))) < self.angle:
                    self.found.ends.update({(loop.closure.name, 0), (loop.closure.name, 1)})
                    # A's frame turned by R sees Rᵀ x
                    return np.asarray(turns[0] @ frame(np.zeros(3), _onto(y * np.sign(x @ y), x)))
        return turns[0]


def _onto(direction: Array, goal: Array) -> Array:
    """The smallest rotation (3, 3) that takes a unit vector onto another, less than a right angle away."""
    k, c = skew(cross(direction, goal)), float(direction @ goal)
    return np.asarray(np.eye(3) + k + k @ k / (1.0 + c))
