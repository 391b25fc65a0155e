"""Idle motions: mobilities that move one body, or bodies that go together, and nothing else.

Bodies go together where a closure welds them or a slide joins them: a slide passes on every turn. A motion is idle at a
configuration if the velocities φ_q′ allows hold one that moves those bodies and no other that has mass or carries
other clusters (massless bodies between the axes of a ball joint do not count). It is a *spin* if it turns them about
one axis, at the reference and at closed configurations around it: then a body hangs on balls, or on joints
about one line, and nothing else.
"""

from __future__ import annotations

from collections.abc import Container, Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.scratch import six_rows
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.motion.mobility import Tangent, sample_closed

_SAMPLES = 3  # closed configurations nearby, in which a spin must be one too
_STILL = 1e-9  # of a unit velocity: a body whose twist is below stays where it is


class Turning(NamedTuple):
    """A spin at one configuration.

    Attributes:
        velocity: q̇′ of the cluster at 1 rad/s, of shape (n′,).
        axis: Its unit axis in the axes of the body that carries the cluster, of shape (3,).
        point: The point of the axis nearest that body's origin, of shape (3,), m.
        poses: Of all the cluster's joints there, of shape (joints + 1, 4, 4).
        relative: Angular velocity of every joint's body relative to its parent's, of shape (joints + 1, 3).
    """

    velocity: Array
    axis: Array
    point: Array
    poses: Array
    relative: Array


class Idle(NamedTuple):
    """An idle motion of a cluster.

    Attributes:
        bodies: Numbers of the joints whose bodies move, in the cluster's tree.
        sentence: It in words.
        spin: How it turns at the reference and around it; empty if it is no spin.
    """

    bodies: frozenset[int]
    sentence: str
    spin: tuple[Turning, ...] = ()


def idle_motions(
    constraints: Constraints, tree: Tree, tangent: Tangent, pose: Array, heavy: Container[int], carriers: Container[int]
) -> list[Idle]:
    """The mobilities of a cluster that move bodies of a loop that go together, and nothing else.

    Args:
        constraints: The cluster's φ.
        tree: Its tree.
        tangent: The velocities φ_q′ allows at its reference configuration.
        pose: Where the body that carries it is in the world, 4×4.
        heavy: The joints whose bodies have mass that counts.
        carriers: The joints whose bodies carry other clusters: what moves them moves these too.
    """
    on_loop = {joint for loop in constraints.loops for joint in (*loop.path_a, *loop.path_b)}
    bodies = [joint.number for joint in tree.joints if joint.number in heavy or joint.number in carriers]
    if tangent.rank >= tree.model.nv or not on_loop.intersection(bodies):
        return []
    at, found, around = _Allowed(constraints, tree, tangent, bodies), list[Idle](), list[_Allowed]()
    for group in _groups(constraints, tree, bodies):
        if not on_loop & group or any(joint in carriers for joint in group):
            continue
        alone = at.alone(group)
        if not alone.shape[1] or any(idle.bodies <= group for idle in found):
            continue
        turning = at.turning(group, alone)
        if turning is not None and not around:
            samples = sample_closed(constraints, tangent, _SAMPLES)[1:]
            around = [_Allowed(constraints, tree, each, bodies) for each in samples if each.rank == tangent.rank]
        spin = [turning, *(each.turning(group, each.alone(group)) for each in around)] if turning else [None]
        whole = tuple(each for each in spin if each is not None)
        sentence = _sentence(_named(tree, group), whole[0] if len(whole) == len(spin) else None, alone.shape[1], pose)
        found.append(Idle(frozenset(group), sentence, whole if len(whole) == len(spin) else ()))
    return found


class _Allowed:
    """What the loops allow the bodies of a cluster at one configuration."""

    def __init__(self, constraints: Constraints, tree: Tree, tangent: Tangent, bodies: Sequence[int]) -> None:
        with constraints.scratch.lent() as data:
            self.spatial = six_rows(pin.computeJointJacobians(tree.model, data, tangent.q_free))
            self.poses = np.array([place.homogeneous for place in data.oMi])
        self.tree, self.basis = tree, tangent.basis(tangent.rank)
        self.twists = {j: self.twist(j) @ self.basis for j in bodies}

    def twist(self, joint: int) -> Array:
        """The spatial Jacobian of a joint's body, of shape (6, n′)."""
        return np.asarray(self.spatial * self.tree.support(joint))

    def alone(self, group: set[int]) -> Array:
        """A basis, in the allowed velocities', of those that move this group and no other body."""
        rest = [twist for joint, twist in self.twists.items() if joint not in group]
        alone = _kernel(np.vstack(rest)) if rest else np.eye(self.basis.shape[1])
        own = np.vstack([self.twists[joint] for joint in sorted(group) if joint in self.twists])
        moves = np.abs(own @ alone).max(initial=0.0) >= _STILL
        return alone if moves else alone[:, :0]

    def turning(self, group: set[int], alone: Array) -> Turning | None:
        """The one motion left, if it turns all of the group about one axis."""
        if alone.shape[1] != 1:
            return None
        velocity = self.basis @ alone[:, 0]
        twists = [self.twist(joint) @ velocity for joint in sorted(group) if joint in self.twists]
        linear, angular = twists[0][:3], twists[0][3:]
        rate = float(np.linalg.norm(angular))
        pitch = abs(float(linear @ angular))
        same = all(np.abs(twist - twists[0]).max() < 1e-6 * rate for twist in twists)
        if rate < _STILL or not same or pitch > 1e-6 * rate * max(float(np.linalg.norm(linear)), 1.0):
            return None
        main = int(np.argmax(np.round(np.abs(angular), 9)))
        rate *= float(np.sign(angular[main]))  # either way along it is the same spin
        relative = np.zeros((len(self.poses), 3))
        for joint in self.tree.joints:
            relative[joint.number] = self.spatial[3:, joint.v] @ velocity[joint.v] / rate
        return Turning(velocity / rate, angular / rate, np.cross(angular, linear) / rate**2, self.poses, relative)


def _named(tree: Tree, group: set[int]) -> str:
    bodies = [name for name, place in tree.attachments.items() if place.joint in group]
    heavy = sorted(b for b in bodies if tree.model.inertias[tree.attachments[b].joint].mass > 0)
    return " with ".join(f"'{name}'" for name in heavy[:2])


def _sentence(named: str, spin: Turning | None, count: int, pose: Array) -> str:
    if spin is None:
        return f"{named} can move in {count} way{'s' if count > 1 else ''} without moving anything else"
    turn, axis = pose[:3, :3], pose[:3, :3] @ spin.axis
    axis = axis * np.sign(axis[int(np.argmax(np.round(np.abs(axis), 9)))])
    point = turn @ spin.point + pose[:3, 3]
    point = point - (point @ axis) * axis
    return (
        f"{named} can spin about its axis: direction {_vector(axis)} through {_vector(point)} at the reference; "
        "it moves nothing else"
    )


def _vector(v: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in np.where(np.abs(v) < 5e-7, 0.0, v)) + ")"


def _groups(constraints: Constraints, tree: Tree, bodies: Sequence[int]) -> Iterator[set[int]]:
    """The bodies one by one or as closures weld them, then those that slides join to larger groups."""
    welds = [(loop.joint_a, loop.joint_b) for loop in constraints.loops if loop.closure.kind == "fixed"]
    slides = [(loop.joint_a, loop.joint_b) for loop in constraints.loops if loop.closure.kind == "prismatic"]
    slides += [(joint.parent, joint.number) for joint in tree.joints if joint.kind.sliding]
    welded = _joined([{joint} for joint in bodies], welds)
    yield from welded
    yield from (group for group in _joined(welded, slides) if group not in welded)


def _joined(groups: list[set[int]], pairs: Sequence[tuple[int, int]]) -> list[set[int]]:
    for a, b in pairs:
        touched = [group for group in groups if a in group or b in group]
        if len(touched) > 1:
            groups = [group for group in groups if group not in touched] + [set[int]().union(*touched)]
    return groups


def _kernel(matrix: Array) -> Array:
    rows, columns = matrix.shape
    _, s, vt = np.linalg.svd(matrix, full_matrices=rows < columns)
    rank = int(np.count_nonzero(s > 1e-8 * max(float(s.max(initial=0.0)), 1.0)))
    return np.asarray(vt[rank:].T)
