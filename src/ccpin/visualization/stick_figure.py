"""Solid links for what a file does not draw: tapered limbs and plates between joints, from kinematics alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.elements.xml import Colour
from ccpin.description.model import LoopClosure, Shape, frame, rotation_to
from ccpin.kinematics.points import joint_poses
from ccpin.kinematics.tree import TreeJoint
from ccpin.mechanism.mechanism import Mechanism
from ccpin.visualization.shapes import Form, hull

GROUND: Colour = (0.36, 0.39, 0.43, 1.0)  # red, green, blue, opacity: what stands still is grey
JOINT: Colour = (0.20, 0.22, 0.26, 1.0)  # dark on every limb
LOOP: Colour = (0.85, 0.22, 0.16, 1.0)  # the one red: where a loop was cut open
LIMBS: tuple[Colour, ...] = (
    (0.16, 0.44, 0.74, 1.0),
    (0.93, 0.52, 0.16, 1.0),
    (0.20, 0.62, 0.50, 1.0),
    (0.55, 0.40, 0.70, 1.0),
    (0.80, 0.66, 0.22, 1.0),
)
"""Of the bodies in turn, none red or grey: five neighbours are told apart."""
LIMB_RADIUS = 0.014
"""Of the mechanism's extent."""
ROOT, TIP, PIN, BALL = 1.35, 0.85, 1.5, 1.75
"""Radii in limb radii: of a limb at its own joint and at the others, of a hinge's pin, of a ball."""
PIN_LENGTH = 3.6
"""In limb radii; longer than any limb is thick, so that no two faces of a joint lie in one plane."""
FLAT = 0.2
"""Three or more points are joined by a plate if none is further from their plane than this share of their spread."""
LONGEST_RAIL, SHORT_RAIL = 50.0, 10.0
"""In limb radii: travel drawn in full up to the first, else this much on both sides of the reference."""


class Limb(NamedTuple):
    """Something drawn in a body's frame: a form, its 4×4 frame there, its colour (as a description's `Visual`)."""

    shape: Form
    placement: Array
    rgba: Colour


class HingePoint(NamedTuple):
    """A point where a body is held, in its joint's frame, and the axis of the hinge there (``None``: not a hinge)."""

    point: Array
    axis: Array | None


class HoldPoints(NamedTuple):
    """Where a body is held: by child joints, by loop closures."""

    joints: list[HingePoint]
    loops: list[HingePoint]

    @property
    def every(self) -> Array:
        """All points, of shape (N, 3)."""
        return np.array([held.point for held in (*self.joints, *self.loops)]).reshape(-1, 3)


class DrawnRod(NamedTuple):
    """The rod of a distance closure: from a placement in a joint's frame towards a point (4,) in another joint's."""

    name: str
    joint: int
    placement: Array
    pieces: tuple[Limb, ...]
    towards: tuple[int, Array]


def skeleton(mechanism: Mechanism, wanted: tuple[int, ...]) -> dict[int, tuple[Limb, ...]]:
    """Pieces for the joints `wanted` (0: the ground), sized by the mechanism's extent in its reference.

    A body whose points all coincide gets none: it is a frame between two joints at one place.
    """
    points = held_points(mechanism)
    radius = LIMB_RADIUS * extent(mechanism, points)
    pieces = {}
    for joint in wanted:
        colour = GROUND if joint == 0 else LIMBS[(joint - 1) % len(LIMBS)]
        rails = _rails(mechanism, joint, radius)
        limbs = _limbs(joint, points[joint].every, radius, colour)
        pins = [
            *(_pin(held, radius, JOINT) for held in points[joint].joints),
            *(_pin(held, radius, LOOP) for held in points[joint].loops),
        ]
        block = _block(mechanism.tree.joints[joint - 1], radius, colour) if joint > 0 else []
        if limbs or rails or joint == 0:
            pieces[joint] = (*limbs, *rails, *pins, *block)
    return pieces


def rods(mechanism: Mechanism) -> list[DrawnRod]:
    """What distance closures stand for, a rod with a ball at both ends each, from a body that moves."""
    if all(closure.length is None for closure in mechanism.closures):
        return []
    radius = LIMB_RADIUS * extent(mechanism, held_points(mechanism))
    found = []
    for closure in mechanism.closures:
        if closure.length is None:
            continue
        (joint, placement), (other, far) = sorted(ends_of(mechanism, closure), key=lambda end: end[0] == 0)
        bar = Limb(Shape("cylinder", (0.6 * radius, closure.length)), frame([0.0, 0.0, 0.5 * closure.length]), LOOP)
        balls = [
            Limb(Shape("sphere", (0.98 * BALL * radius,)), frame([0.0, 0.0, at]), LOOP) for at in (0, closure.length)
        ]
        found.append(DrawnRod(closure.name, joint, placement, (bar, *balls), (other, far[:, 3])))
    return found


def ends_of(mechanism: Mechanism, closure: LoopClosure) -> list[tuple[int, Array]]:
    """Where a closure holds its two links: the number of the joint that carries each, its frame (4, 4) there."""
    found = []
    for link, placement in closure.ends:
        carrier = mechanism.tree.attachments[link]
        found.append((carrier.joint, carrier.placement @ placement))
    return found


def held_points(mechanism: Mechanism) -> list[HoldPoints]:
    """Where each body is held, by joint number; a body with one end has the far end of its mass for the other."""
    model = mechanism.tree.model
    points = [HoldPoints([], []) for _ in range(model.njoints)]
    for joint in mechanism.tree.joints:
        if joint.kind.nv < 6:
            hinge = joint.placement[:3, :3] @ joint.axis if joint.kind.nv == 1 and not joint.kind.sliding else None
            points[joint.parent].joints.append(HingePoint(joint.placement[:3, 3], hinge))
    for closure in mechanism.closures:
        for joint_number, at in ends_of(mechanism, closure):
            points[joint_number].loops.append(HingePoint(at[:3, 3], at[:3, 2] if closure.kind == "revolute" else None))
    for inertia, body in list(zip(model.inertias, points, strict=True))[1:]:
        if not len(body.every) and np.linalg.norm(inertia.lever) > 1e-9:
            body.joints.append(HingePoint(2 * np.array(inertia.lever), None))
    return points


def extent(mechanism: Mechanism, points: list[HoldPoints]) -> float:
    """Diagonal (m) of the box around all joints and loop points in the reference pose; 1 where there is none."""
    poses = joint_poses(mechanism.tree.scratch, mechanism.q_reference)
    world = [held.every @ pose[:3, :3].T + pose[:3, 3] for pose, held in zip(poses, points, strict=True)]
    every = np.concatenate([*world, poses[1:, :3, 3]])
    diagonal = float(np.linalg.norm(np.ptp(every, axis=0))) if len(every) else 0.0
    return diagonal or 1.0


def _limbs(joint: int, ends: Array, radius: float, colour: Colour) -> list[Limb]:
    """A plate through all points of a body where they lie in a plane, else a tapered limb to each."""
    points = np.concatenate([np.zeros((int(joint > 0), 3)), ends])
    points = points[np.unique(np.round(points / radius, 3), axis=0, return_index=True)[1]] if len(points) else points
    if len(points) < 2:
        return []
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    if len(points) > 2 and spread[2:].sum() < FLAT * spread[0] and spread[1] > radius:
        return [Limb(hull(points, np.full(len(points), radius)), np.eye(4), colour)]
    start = np.zeros(3) if joint > 0 else points[0] if len(points) == 2 else points.mean(axis=0)
    radii = radius * np.array([ROOT, TIP])
    reached = [end for end in points if np.linalg.norm(end - start) > 1e-3 * radius]
    return [Limb(hull(np.array([start, end]), radii), np.eye(4), colour) for end in reached]


def _pin(held: HingePoint, radius: float, colour: Colour) -> Limb:
    """A hinge's pin along its axis, or a ball."""
    if held.axis is None:
        return Limb(Shape("sphere", (BALL * radius,)), frame(held.point), colour)
    length = PIN_LENGTH * radius * (1.12 if colour is LOOP else 1.0)
    width = PIN * radius * (0.93 if colour is LOOP else 1.0)
    return Limb(Shape("cylinder", (width, length)), frame(held.point, rotation_to(held.axis)), colour)


def _block(joint: TreeJoint, radius: float, colour: Colour) -> list[Limb]:
    """The carriage of a body on a rail."""
    if not _on_rail(joint):
        return []
    block = Shape("box", (4 * radius, 4 * radius, 5 * radius))
    return [Limb(block, frame(np.zeros(3), rotation_to(joint.axis)), colour)]


def _rails(mechanism: Mechanism, joint: int, radius: float) -> list[Limb]:
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
        rails.append(Limb(Shape("cylinder", (0.6 * radius, max(high - low, radius))), centre, GROUND))
    return rails


def _on_rail(joint: TreeJoint) -> bool:
    return joint.kind.nq == 1 and joint.kind.sliding
