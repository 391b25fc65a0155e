"""What the compiled core needs to know of a mechanism, in plain numbers: the only seam between the two languages.

No C++ type of another package crosses it. Joints are numbered as in the Pinocchio model (0: the world), rows of φ and
components of q and q̇ as in the reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.constraints import Constraints
from ccpin.kinematics.coordinates import COMPONENTS, IndependentCoordinates
from ccpin.kinematics.loops import Loop
from ccpin.mechanism.mechanism import Mechanism

Numbers = dict[str, Any]
_ENTRIES = ("tx", "ty", "tz", "rx", "ry", "rz")


class Cluster(NamedTuple):
    """Joints that closures and couplings tie together, with all between them.

    Attributes:
        parent: The joint whose body carries the cluster (0: the world).
        joints: Its joints, parents first.
    """

    parent: int
    joints: list[int]


def specification(mechanism: Mechanism, gravity: Array | None = None) -> Numbers:
    """Describe a mechanism to the core.

    Args:
        mechanism: From `ccpin.load`.
        gravity: In world axes, m/s², of shape (3,); default the mechanism's.

    Raises:
        UnsupportedMechanismError: A closure joins two frames of one body.
    """
    model, parametrization = mechanism.pin_model, mechanism.parametrization()
    constraints, coordinates = parametrization.constraints, parametrization.coordinates
    parents = [int(p) for p in model.parents]
    owner = np.repeat(np.arange(model.njoints), list(model.nvs)).tolist()
    loops = [_loop(loop, parents) for loop in constraints.loops]
    paths = [[*loop[-2], *loop[-1]] for loop in loops]
    couplings, coupled = _couplings(constraints, owner)
    found = clusters(parents, [*paths, *coupled])
    where = {joint: k for k, cluster in enumerate(found) for joint in cluster.joints}
    places = [_coordinate(coordinates, part, owner) for part in coordinates.parts]

    def inside(k: int, joints: Sequence[int]) -> list[int]:
        return [i for i, joint in enumerate(joints) if where[joint] == k]

    axes = {joint.name: np.array(joint.axis, dtype=np.float64) for joint in mechanism.description.joints}
    direct = mechanism.actuated == mechanism.independent
    return {
        "joints": [_joint(mechanism, joint, axes) for joint in range(1, model.njoints)],
        "loops": loops,
        "couplings": couplings,
        "coordinates": places,
        "clusters": [
            (
                cluster.parent,
                cluster.joints,
                inside(k, [path[0] for path in paths]),
                inside(k, [joints[0] for joints in coupled]),
                inside(k, [place[1] for place in places]),
            )
            for k, cluster in enumerate(found)
        ],
        "nq": mechanism.nq,
        "nv": mechanism.n_free,
        "n_q": coordinates.nq,
        "n": coordinates.n,
        "direct": direct,
        "motors": [] if direct else [int(np.flatnonzero(row)[0]) for row in mechanism.actuation],
        "turnable": parametrization.turnable,
        "tolerance": parametrization.tolerance,
        "gravity": np.array(model.gravity.linear if gravity is None else gravity, dtype=np.float64),
        "reference": np.array(mechanism.q_reference).tolist(),
    }


def clusters(parents: Sequence[int], ties: Sequence[Sequence[int]]) -> list[Cluster]:
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


def _joint(mechanism: Mechanism, joint: int, axes: dict[str, Array]) -> tuple[Any, ...]:
    """Kind, parent, (q, v, nq, nv), placement, axis, mass, centre, inertia about it, rotor inertias."""
    model = mechanism.pin_model
    name, inertia, v = model.names[joint], model.inertias[joint], int(model.idx_vs[joint])
    axis = axes.get(name, np.array([0.0, 0.0, 1.0]))
    return (
        mechanism.tree.kinds[name],
        int(model.parents[joint]),
        [int(model.idx_qs[joint]), v, int(model.nqs[joint]), int(model.nvs[joint])],
        np.array(model.jointPlacements[joint].homogeneous),
        axis / np.linalg.norm(axis),
        float(inertia.mass),
        np.array(inertia.lever),
        np.array(inertia.inertia),
        model.armature[v : v + model.nvs[joint]].tolist(),
    )


def _loop(loop: Loop, parents: Sequence[int]) -> tuple[Any, ...]:
    """Ends and ancestor, frames, E, directions, offsets, length, alignment, and the joints on the two paths."""
    path_a = _support(loop.joint_a, parents, loop.ancestor)[::-1]
    path_b = _support(loop.joint_b, parents, loop.ancestor)[::-1]
    if not path_a and not path_b:
        raise UnsupportedMechanismError(f"closure '{loop.closure.name}' joins two frames of one body")
    rows = loop.rows
    return (
        [loop.joint_a, loop.joint_b, loop.ancestor],
        np.array(loop.frame_a),
        np.array(loop.frame_b),
        [np.array(e) for e in loop.basis],
        [[(float(w), np.array(a), np.array(b)) for w, a, b in row.products] for row in rows.directions],
        [np.array(a) for a in rows.offsets],
        float(rows.distance or 0.0),
        [(1.0, np.array(a), np.array(b)) for a, b in rows.alignment],
        path_a,
        path_b,
    )


def _couplings(constraints: Constraints, owner: Sequence[int]) -> tuple[list[tuple[Any, ...]], list[list[int]]]:
    """Terms (q, v, wrapped, coefficients, reference) and modulus of each coupling; and the joints it ties."""
    numbers = [
        (
            [(t.idx_q, t.idx_v, t.wrapped, t.coefficients.tolist(), float(t.reference)) for t in g.terms],
            float(g.modulus),
        )
        for g in constraints.gears
    ]
    return numbers, [[owner[t.idx_v] for t in gear.terms] for gear in constraints.gears]


def _coordinate(coordinates: IndependentCoordinates, part: Any, owner: Sequence[int]) -> tuple[Any, ...]:
    """Kind, joint, component (−1: the whole joint), (q, v, nq, nv), the joint's configuration at the chart's centre."""
    component = -1
    if part.component is not None:
        assert part.component in COMPONENTS[part.kind]
        component = _ENTRIES.index(part.component)
    return (
        part.kind,
        owner[part.v_free.start],
        component,
        [part.q.start, part.v.start, part.q.stop - part.q.start, part.v.stop - part.v.start],
        coordinates.q_reference[part.q_free].tolist(),
    )
