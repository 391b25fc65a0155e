"""What the compiled core needs to know of a mechanism, in plain numbers: the only seam between the two languages.

No C++ type of another package crosses it. Joints are numbered as in the Pinocchio model (0: the world), rows of φ and
components of q and q̇ as in the reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ccpin.arrays import Array
from ccpin.description.closure_kinds import Fixed, Vector
from ccpin.description.joint_kinds import JointKind
from ccpin.errors import UnsupportedMechanismError
from ccpin.kinematics.clusters import find_clusters
from ccpin.kinematics.coordinates import Coordinate, IndependentCoordinates
from ccpin.kinematics.loops import ResolvedClosure, ResolvedCoupling
from ccpin.kinematics.tree import TreeJoint
from ccpin.mechanism.mechanism import Mechanism

Numbers = dict[str, Any]
_ENTRIES = ("tx", "ty", "tz", "rx", "ry", "rz")
_KINDS = ("revolute", "continuous", "prismatic", "spherical", "planar", "floating")


def specification(mechanism: Mechanism, gravity: Array | None = None) -> Numbers:
    """Describe a mechanism to the core.

    Args:
        mechanism: From `ccpin.load`.
        gravity: In world axes, m/s², of shape (3,); default the mechanism's.

    Raises:
        UnsupportedMechanismError: A closure joins two frames of one body, or a joint kind, a row of a closure or the
            place of a motor is none that the core knows, or a ball joint has a spring.
    """
    tree, parametrization = mechanism.tree, mechanism.parametrization()
    constraints, coordinates = parametrization.constraints, parametrization.coordinates
    parents = [0, *(joint.parent for joint in tree.joints)]
    owner = [joint.number for joint in tree.joints for _ in joint.kind.steps]
    paths = [[*loop.path_a, *loop.path_b] for loop in constraints.loops]
    coupled = [[owner[term.idx_v] for term in coupling.terms] for coupling in constraints.couplings]
    found = find_clusters(parents, [*paths, *coupled])
    where = {joint: k for k, cluster in enumerate(found) for joint in cluster.joints}
    places = [_coordinate(coordinates, part, owner) for part in coordinates.parts]

    def inside(k: int, joints: Sequence[int]) -> list[int]:
        return [i for i, joint in enumerate(joints) if where[joint] == k]

    direct = mechanism.direct
    return {
        "joints": [_joint(mechanism, joint) for joint in tree.joints],
        "loops": [_loop(loop) for loop in constraints.loops],
        "couplings": [_coupling(coupling) for coupling in constraints.couplings],
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
        "gears": [] if direct else mechanism.motors.gears.tolist(),
        "turnable": parametrization.turnable,
        "tolerance": parametrization.rules.tolerance,
        "unstructured": parametrization.continuation.unstructured.ravel().tolist(),
        "gravity": np.array(mechanism.description.gravity if gravity is None else gravity, dtype=np.float64),
        "reference": np.array(mechanism.q_reference).tolist(),
    }


def _joint(mechanism: Mechanism, joint: TreeJoint) -> tuple[Any, ...]:
    """Kind, parent, (q, v, nq, nv), placement, axis, mass, centre, inertia about it, rotors, dampers, (k, θ₀), v_s."""
    model, stated = mechanism.tree.model, joint.stated
    if stated.stiffness and joint.kind.unit:
        raise UnsupportedMechanismError(f"the compiled core does not know the spring of '{joint.name}', a ball joint")
    inertia = model.inertias[joint.number]
    return (
        _known(joint.kind),
        joint.parent,
        [joint.q.start, joint.v.start, joint.kind.nq, joint.kind.nv],
        np.array(joint.placement),
        joint.axis / np.linalg.norm(joint.axis),
        float(inertia.mass),
        np.array(inertia.lever),
        np.array(inertia.inertia),
        model.armature[joint.v].tolist(),
        [stated.damping] * joint.kind.nv,
        [stated.stiffness, stated.spring_reference],
        stated.stribeck_speed,
    )


def _known(kind: JointKind) -> str:
    if kind.name not in _KINDS:
        raise UnsupportedMechanismError(f"the compiled core knows no {kind.name} joint, but {', '.join(_KINDS)}")
    return kind.name


def _loop(loop: ResolvedClosure) -> tuple[Any, ...]:
    """Ends and ancestor, frames, the rows' products, alignment, and the joints on the two paths."""
    if not loop.path_a and not loop.path_b:
        raise UnsupportedMechanismError(f"closure '{loop.closure.name}' joins two frames of one body")
    return (
        [loop.joint_a, loop.joint_b, loop.ancestor],
        np.array(loop.frame_a),
        np.array(loop.frame_b),
        [[(float(w), _vector(x), _vector(y)) for w, x, y in row] for row in loop.rows.rows],
        [(np.array(a), np.array(b)) for a, b in loop.rows.alignment],
        list(loop.path_a),
        list(loop.path_b),
    )


def _vector(vector: Vector) -> tuple[str, Array]:
    """The frame a vector is fixed in, and itself there; the gap is in none."""
    return (vector.frame, np.array(vector.local)) if isinstance(vector, Fixed) else ("gap", np.zeros(3))


def _coupling(coupling: ResolvedCoupling) -> tuple[Any, ...]:
    """Terms (q, v, wrapped, coefficients, reference) and modulus."""
    terms = [(t.idx_q, t.idx_v, t.wrapped, t.coefficients.tolist(), float(t.reference)) for t in coupling.terms]
    return terms, float(coupling.modulus)


def _coordinate(coordinates: IndependentCoordinates, part: Coordinate, owner: Sequence[int]) -> tuple[Any, ...]:
    """Kind, joint, component (−1: the whole joint), (q, v, nq, nv), the joint's configuration at the chart's centre."""
    return (
        _known(part.kind),
        owner[part.v_free.start],
        -1 if part.component is None else _ENTRIES.index(part.component),
        [part.q.start, part.v.start, part.q.stop - part.q.start, part.v.stop - part.v.start],
        coordinates.q_reference[part.q_free].tolist(),
    )
