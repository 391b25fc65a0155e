"""A drawn skeleton for mechanisms whose file has no pictures: limbs, joints and loop points from kinematics alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import Shape, Visual, frame, rotation_to
from ccpin.description.xml import Colour
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import TreeJoint
from ccpin.mechanism.mechanism import Mechanism

GROUND: Colour = (0.36, 0.39, 0.43, 1.0)
JOINT: Colour = (0.20, 0.22, 0.26, 1.0)
LOOP: Colour = (0.85, 0.22, 0.16, 1.0)
LIMBS: tuple[Colour, ...] = (
    (0.16, 0.44, 0.74, 1.0),
    (0.93, 0.52, 0.16, 1.0),
    (0.20, 0.62, 0.50, 1.0),
    (0.55, 0.40, 0.70, 1.0),
    (0.80, 0.66, 0.22, 1.0),
)
LIMB_RADIUS = 0.014
"""Of the mechanism's extent."""
LONGEST_RAIL, SHORT_RAIL = 50.0, 10.0
"""In limb radii: travel drawn in full up to the first, else this much on both sides of the reference."""


class Body(NamedTuple):
    """Something drawn that moves as one: its name, the joint that carries it, its 4×4 frame there, its visuals."""

    name: str
    joint: int
    placement: Array
    visuals: tuple[Visual, ...]


class _Points(NamedTuple):
    """Where a body is held, in its joint's frame: by child joints, by loop closures, each a list of (3,) points."""

    joints: list[Array]
    loops: list[Array]


def skeleton(mechanism: Mechanism) -> list[Body]:
    """One body for each movable joint and one for the ground, sized by the mechanism's extent in its reference."""
    model = mechanism.tree.model
    points = _points(mechanism)
    radius = LIMB_RADIUS * _extent(mechanism, points)
    bodies = []
    for joint in range(model.njoints):
        name = mechanism.description.root if joint == 0 else model.names[joint]
        colour = GROUND if joint == 0 else LIMBS[(joint - 1) % len(LIMBS)]
        visuals = [
            *_limbs(_anchor(joint, points[joint]), points[joint], radius, colour),
            *_rails(mechanism, joint, radius),
            *(_ball(point, 1.9 * radius, JOINT) for point in points[joint].joints),
            *(_ball(point, 1.9 * radius, LOOP) for point in points[joint].loops),
        ]
        if joint > 0 and _on_rail(mechanism.tree.joints[joint - 1]):
            turned = rotation_to(mechanism.tree.joints[joint - 1].axis)
            block = Shape("box", (4 * radius, 4 * radius, 5 * radius))
            visuals.append(Visual(block, frame(np.zeros(3), turned), colour))
        if visuals:
            bodies.append(Body(name, joint, np.eye(4), tuple(visuals)))
    return bodies


def _points(mechanism: Mechanism) -> list[_Points]:
    model, attachments = mechanism.tree.model, mechanism.tree.attachments
    points = [_Points([], []) for _ in range(model.njoints)]
    for joint in range(1, model.njoints):
        points[model.parents[joint]].joints.append(np.array(model.jointPlacements[joint].translation))
    for closure in mechanism.closures:
        for link, placement in ((closure.link_a, closure.placement_a), (closure.link_b, closure.placement_b)):
            carrier = attachments[link]
            points[carrier.joint].loops.append((carrier.placement @ placement)[:3, 3])
    for joint in range(1, model.njoints):
        lever = np.array(model.inertias[joint].lever)
        if not points[joint].joints and not points[joint].loops and np.linalg.norm(lever) > 1e-9:
            points[joint].joints.append(2 * lever)
    return points


def _extent(mechanism: Mechanism, points: list[_Points]) -> float:
    """Diagonal (m) of the box around all joints and loop points in the reference pose; 1 where there is none."""
    poses = joint_poses(mechanism.tree.scratch, mechanism.q_reference)
    held = [(pose, point) for pose, held in zip(poses, points, strict=True) for point in (*held.joints, *held.loops)]
    world = [*(pose[:3, :3] @ point + pose[:3, 3] for pose, point in held), *poses[1:, :3, 3]]
    diagonal = float(np.linalg.norm(np.ptp(np.array(world), axis=0))) if world else 0.0
    return diagonal or 1.0


def _anchor(joint: int, held: _Points) -> Array:
    """Where a body's limbs start: its own joint, else the only pair's first point, else the middle."""
    every = [*held.joints, *held.loops]
    if joint > 0 or not every:
        return np.zeros(3)
    return every[0] if len(every) <= 2 else np.asarray(np.mean(every, axis=0))


def _limbs(start: Array, held: _Points, radius: float, colour: Colour) -> list[Visual]:
    limbs = []
    for end in (*held.joints, *held.loops):
        length = float(np.linalg.norm(end - start))
        if length > 1e-9:
            middle = frame((start + end) / 2, rotation_to((end - start) / length))
            limbs.append(Visual(Shape("capsule", (radius, length)), middle, colour))
    return limbs


def _rails(mechanism: Mechanism, joint: int, radius: float) -> list[Visual]:
    """A thin rod along the travel of every prismatic joint that a body carries."""
    model = mechanism.tree.model
    rails = []
    for child in mechanism.tree.joints:
        if child.parent != joint or not _on_rail(child):
            continue
        index = child.q.start
        low, high = float(model.lowerPositionLimit[index]), float(model.upperPositionLimit[index])
        if high - low > LONGEST_RAIL * radius:
            middle = float(mechanism.q_reference[index])
            low, high = max(low, middle - SHORT_RAIL * radius), min(high, middle + SHORT_RAIL * radius)
        axis = child.placement[:3, :3] @ child.axis
        centre = frame(child.placement[:3, 3] + axis * (low + high) / 2, rotation_to(axis))
        rails.append(Visual(Shape("cylinder", (0.6 * radius, max(high - low, radius))), centre, GROUND))
    return rails


def _on_rail(joint: TreeJoint) -> bool:
    return joint.kind.nq == 1 and joint.kind.sliding


def _ball(point: Array, radius: float, colour: Colour) -> Visual:
    return Visual(Shape("sphere", (radius,)), frame(point), colour)
