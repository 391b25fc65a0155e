"""Clusters: the smallest groups of joints that move independently of all others, and each as a tree of its own.

Closures and couplings tie joints together. A row of φ is measured from its loop's nearest common ancestor, so it
depends on its own cluster's joints only: φ_q′ is block-diagonal by cluster, and whatever is asked of it (closing, rank,
null space, conditioning, coordinates) is asked cluster by cluster.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ccpin.arrays import FrozenMapping, Indices
from ccpin.description.model import Coupling, LoopClosure
from ccpin.kinematics.loops import loop_path
from ccpin.kinematics.tree import Attachment, Tree


class Cluster(NamedTuple):
    """Joints that closures and couplings tie together, with all between them.

    Attributes:
        parent: The joint whose body carries the cluster (0: the world).
        joints: Its joints, parents first.
    """

    parent: int
    joints: list[int]


class ClusterTree(NamedTuple):
    """A cluster cut out of a tree; the body that carries it is its world.

    Attributes:
        cluster: Its joints in the whole tree.
        tree: The cluster alone.
        closures, couplings: What ties it together.
        q, v: Where its configuration stands in q′ and its velocity in q̇′.
    """

    cluster: Cluster
    tree: Tree
    closures: tuple[LoopClosure, ...]
    couplings: tuple[Coupling, ...]
    q: Indices
    v: Indices

    @property
    def ties(self) -> tuple[str, ...]:
        """Its closures and couplings by name."""
        return (*(closure.name for closure in self.closures), *(coupling.name for coupling in self.couplings))


def cut(tree: Tree, closures: Sequence[LoopClosure], couplings: Sequence[Coupling]) -> Iterator[ClusterTree]:
    """The clusters of a tree one by one, each after the cluster that carries it.

    A closure between two frames of one body ties nothing; it goes with the cluster of that body.
    """
    paths = [loop_path(tree, closure) for closure in closures]
    joined = [[*path.a, *path.b] for path in paths]
    coupled = [[tree.joint(term.joint).number for term in coupling.terms] for coupling in couplings]
    found = find_clusters([0, *(joint.parent for joint in tree.joints)], [*joined, *coupled])
    where = {0: 0} | {joint: k for k, cluster in enumerate(found) for joint in cluster.joints}
    ties: list[tuple[list[LoopClosure], list[Coupling]]] = [([], []) for _ in found]
    for closure, path, joints in zip(closures, paths, joined, strict=True):
        ties[where[joints[0] if joints else path.ancestor]][0].append(closure)
    for coupling, joints in zip(couplings, coupled, strict=True):
        ties[where[joints[0]]][1].append(coupling)
    links: dict[int, list[str]] = {}
    for link, place in tree.attachments.items():
        links.setdefault(place.joint, []).append(link)
    for cluster, (loops, relations) in zip(found, ties, strict=True):
        yield _part(tree, cluster, links, tuple(loops), tuple(relations))


def _part(
    tree: Tree,
    cluster: Cluster,
    links: dict[int, list[str]],
    closures: tuple[LoopClosure, ...],
    couplings: tuple[Coupling, ...],
) -> ClusterTree:
    members = [tree.joints[number - 1] for number in cluster.joints]
    q = np.concatenate([np.arange(joint.q.start, joint.q.stop) for joint in members])
    v = np.concatenate([np.arange(joint.v.start, joint.v.stop) for joint in members])
    if len(members) == len(tree.joints):
        return ClusterTree(cluster, tree, closures, couplings, q, v)
    model, joints = pin.Model(), []
    model.name, number = tree.model.name, {cluster.parent: 0}
    for joint in members:
        parent, placement = number[joint.parent], pin.SE3(np.array(joint.placement))
        added = int(model.addJoint(parent, tree.model.joints[joint.number], placement, joint.name))
        model.appendBodyToJoint(added, tree.model.inertias[joint.number], pin.SE3.Identity())
        number[joint.number], at = added, model.joints[added]
        q_own, v_own = slice(at.idx_q, at.idx_q + joint.kind.nq), slice(at.idx_v, at.idx_v + joint.kind.nv)
        joints.append(replace(joint, number=added, parent=parent, q=q_own, v=v_own))
    model.lowerPositionLimit = tree.model.lowerPositionLimit[q]
    model.upperPositionLimit = tree.model.upperPositionLimit[q]
    attachments = {
        link: Attachment(number[carrier], tree.attachments[link].placement)
        for carrier in (cluster.parent, *cluster.joints)
        for link in links.get(carrier, ())
    }
    return ClusterTree(cluster, Tree(model, tuple(joints), FrozenMapping(attachments)), closures, couplings, q, v)


def find_clusters(parents: Sequence[int], ties: Iterable[Sequence[int]]) -> list[Cluster]:
    """The smallest groups of joints that hold every tie together and have one carrying body each, parents first.

    Args:
        parents: The parent of each joint; joint 0 is the world.
        ties: Sets of joints that one closure or coupling involves.
    """
    group = list(range(len(parents)))

    def find(joint: int) -> int:
        while group[joint] != joint:
            group[joint] = group[group[joint]]
            joint = group[joint]
        return joint

    for tie in ties:
        for joint in tie:
            group[find(joint)] = find(tie[0])
    while True:
        members: dict[int, list[int]] = {}
        for joint in range(1, len(parents)):
            members.setdefault(find(joint), []).append(joint)
        missing = [(joints[0], joint) for joints in members.values() for joint in _between(joints, parents)]
        if not missing:
            break
        for joint, other in missing:
            group[find(other)] = find(joint)
    found = []
    for joints in sorted(members.values()):
        inside = set(joints)
        found.append(Cluster(next(parents[joint] for joint in joints if parents[joint] not in inside), joints))
    return found


def _between(joints: list[int], parents: Sequence[int]) -> set[int]:
    """The joints on the way from a group's topmost joints to their nearest common ancestor."""
    inside = set(joints)
    tops = {parents[joint] for joint in joints} - inside
    if len(tops) < 2:
        return set()
    paths = [{0, top, *_support(top, parents)} for top in tops]
    return set[int]().union(*paths) - paths[0].intersection(*paths[1:])


def _support(joint: int, parents: Sequence[int], ancestor: int = 0) -> list[int]:
    """A joint and those above it, up to an ancestor (left out)."""
    path: list[int] = []
    while joint != ancestor:
        path.append(joint)
        joint = parents[joint]
    return path
