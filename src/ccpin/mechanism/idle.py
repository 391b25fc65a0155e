"""Idle motions: mobilities that move one body, or bodies welded by a closure, and nothing else."""

from __future__ import annotations

from collections.abc import Container

import numpy as np
import pinocchio as pin

from ccpin.arrays import Array
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.scratch import six_rows
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.mobility import Tangent


def idle_motions(
    constraints: Constraints,
    tree: Tree,
    tangent: Tangent,
    pose: Array,
    heavy: Container[int],
    carriers: Container[int],
) -> list[str]:
    """Name the mobilities of a cluster that move one body (or bodies welded by a closure) of a loop and nothing else.

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
    basis = tangent.basis(tangent.rank)
    if not basis.shape[1] or not on_loop.intersection(bodies):
        return []
    data = constraints.scratch.take()
    spatial = pin.SE3(pose).action @ six_rows(pin.computeJointJacobians(tree.model, data, tangent.q_free))
    constraints.scratch.give(data)
    twists = {j: (spatial * tree.support(j)) @ basis for j in bodies}
    sentences = []
    for group in _welded_groups(constraints, bodies):
        if not on_loop & group or any(joint in carriers for joint in group):
            continue
        rest = [twists[j] for j in bodies if j not in group]
        allowed = _kernel(np.vstack(rest)) if rest else np.eye(basis.shape[1])
        if not allowed.shape[1]:
            continue
        twist = np.vstack([twists[j] for j in sorted(group) if j in twists]) @ allowed
        if np.abs(twist).max(initial=0.0) >= 1e-9:
            sentences.append(_describe(tree, group, twist[:6, 0], allowed.shape[1]))
    return sentences


def _describe(tree: Tree, group: set[int], twist: Array, count: int) -> str:
    bodies = [name for name, place in tree.attachments.items() if place.joint in group]
    named = " with ".join(sorted(b for b in bodies if tree.model.inertias[tree.attachments[b].joint].mass > 0)[:2])
    linear, angular = twist[:3], twist[3:]
    turning = float(np.linalg.norm(angular))
    pitch = abs(linear @ angular)
    if count == 1 and turning > 1e-9 and pitch < 1e-6 * turning * max(float(np.linalg.norm(linear)), 1.0):
        main = int(np.argmax(np.round(np.abs(angular), 9)))
        axis = angular / turning * np.sign(angular[main])  # either way along it is the same spin
        point = np.cross(angular, linear) / turning**2
        return (
            f"{named} can spin about its axis: direction {_vector(axis)} through {_vector(point)} at the reference; "
            "it moves nothing else. Leave it independent, or lock one of its joints"
        )
    return f"{named} can move in {count} way{'s' if count > 1 else ''} without moving anything else"


def _vector(v: Array) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in np.where(np.abs(v) < 5e-7, 0.0, v)) + ")"


def _welded_groups(constraints: Constraints, bodies: list[int]) -> list[set[int]]:
    groups = [{j} for j in bodies]
    for loop in constraints.loops:
        if loop.closure.kind == "fixed":
            touched = [g for g in groups if loop.joint_a in g or loop.joint_b in g]
            if len(touched) > 1:
                groups = [g for g in groups if g not in touched] + [set().union(*touched)]
    return groups


def _kernel(matrix: Array) -> Array:
    rows, columns = matrix.shape
    _, s, vt = np.linalg.svd(matrix, full_matrices=rows < columns)
    rank = int(np.count_nonzero(s > 1e-8 * max(float(s.max(initial=0.0)), 1.0)))
    return np.asarray(vt[rank:].T)
