"""What a serial robot is made of: links that its joints alone carry, places for masses, and the description."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import replace

import numpy as np

from ccpin.arrays import Array, FrozenMapping
from ccpin.description.checks import check
from ccpin.description.model import Joint, Link, MechanismDescription, Motor, SolverWords, inverse
from ccpin.errors import InvalidInputError
from ccpin.kinematics.points import LinkPoint
from ccpin.transmission.equivalent_masses import Additions, Ground, PointMass, second_moments
from ccpin.transmission.linkage import carriers, frictionless, serial_links, stated_of
from ccpin.transmission.posture import Posture
from ccpin.transmission.serial_range import Reached
from ccpin.transmission.transmission import Transmission

_WORLD = "world"  # no link: what rests on it is the ground's
_NO_LIMIT = 1e9  # N m, rad/s


def kept_links(transmission: Transmission) -> Set[str]:
    """The serial robot's links.

    Raises:
        InvalidInputError: A joint is carried by another than the serial robot's.
    """
    mechanism = transmission.joint_model.mechanism
    tree, own = mechanism.tree, transmission.joints
    carried = carriers(tree)
    for number, joint in enumerate(tree.joints, start=1):
        others = [name for name in tree.names if name in carried[number] and name not in own]
        if joint.name in own and others:
            loops = [
                closure.name
                for closure in mechanism.closures
                if others[0]
                in carried[tree.attachments[closure.link_a].joint] ^ carried[tree.attachments[closure.link_b].joint]
            ]
            raise InvalidInputError(
                f"'{joint.name}' is carried by '{others[0]}', which is none of the serial robot's ({', '.join(own)}): "
                f"without {'loop ' + ', '.join(loops) if loops else 'the linkage'} nothing says where it is"
            )
    return serial_links(tree, own)


def places_of(transmission: Transmission, links: Set[str]) -> dict[str, Array]:
    """The heaviest link of each moving body, with points of it for masses.

    They are where rods hang, its centre of mass, and six about the joint's origin, as far off as the farthest of these.
    """
    mechanism = transmission.joint_model.mechanism
    stated, tree = stated_of(mechanism), mechanism.tree
    found = {}
    for number in range(1, len(tree.joints) + 1):
        body = [link for link in stated.links if link.name in links and tree.attachments[link.name].joint == number]
        with_mass = [link for link in body if _mass(link) > 0.0]
        if not with_mass:
            continue
        main = max(with_mass, key=_mass)
        into = inverse(tree.attachments[main.name].placement)
        ends = [end for closure in mechanism.closures for end in closure.ends if end[0] in {link.name for link in body}]
        hung = [(into @ tree.attachments[link].placement @ placement)[:3, 3] for link, placement in ends]
        assert main.inertia is not None
        hung.append(main.inertia.com)
        far = max(float(np.linalg.norm(place - into[:3, 3])) for place in hung) or stated.size
        around = [into[:3, 3] + sign * far * axis for axis in np.eye(3) for sign in (1.0, -1.0)]
        found[main.name] = np.array([*hung, *around])
    return found


def ground_of(transmission: Transmission, links: Set[str]) -> Ground:
    """The linkage's mass, and the link that carries the first joint, on which it may rest where its bodies are."""
    mechanism = transmission.joint_model.mechanism
    stated, tree = stated_of(mechanism), mechanism.tree
    base = next(j.stated.parent for j in tree.joints if j.parent == 0 and j.name in transmission.joints)
    into, q_free = inverse(tree.attachments[base].placement), mechanism.q_reference
    points, moments = [], []
    for link in stated.links:
        if link.name not in links and link.inertia is not None and link.inertia.mass > 0.0:
            pose = into @ LinkPoint(tree, link.name, link.inertia.com).pose(q_free)
            points.append(PointMass(base, pose[:3, 3], link.inertia.mass))
            moments.append(second_moments(base, link.inertia, pose[:3, :3]))
    total = sum(point.mass for point in points)
    com = sum((point.mass * point.place for point in points), np.zeros(3)) / (total or 1.0)
    if base == _WORLD:
        return Ground(total, com, (), ())
    return Ground(total, com, tuple(points), tuple(moments))


def bare_joints(transmission: Transmission) -> dict[str, Joint]:
    """The serial robot's joints by name, in its order, rotors left to what is added: a motor may drive one of them."""
    stated = {joint.name: joint for joint in stated_of(transmission.joint_model.mechanism).joints}
    return {
        name: replace(stated[name], armature=0.0) if name in transmission.motors else stated[name]
        for name in transmission.joints
    }


def with_additions(
    transmission: Transmission, bare: Mapping[str, Joint], added: Additions, found: Reached, at: Posture | None
) -> dict[str, Joint]:
    """The joints with range and armatures, and the mean of dampers and dry friction as felt over it, or at a posture.

    Dry friction is felt as if all joints of the linkage slid, beyond their Stribeck speeds: |ρ|ᵀ f′.
    """
    felt = found.grid if at is None else (at,)
    levels = transmission.joint_model.mechanism.joints.friction
    damping = np.mean([np.diag(posture.state.damping) for posture in felt], axis=0).tolist()
    friction = np.mean([np.abs(posture.state.rho).T @ levels for posture in felt], axis=0).tolist()
    lower, upper, armatures = found.lower.tolist(), found.upper.tolist(), added.armatures.tolist()
    return {
        name: replace(
            frictionless(joint),
            kind="revolute" if joint.kind == "continuous" else joint.kind,
            lower=lower[k],
            upper=upper[k],
            armature=joint.armature + armatures[k],
            damping=damping[k],
            friction=friction[k],
        )
        for k, (name, joint) in enumerate(bare.items())
    }


def described(
    transmission: Transmission, links: Set[str], joints: Mapping[str, Joint], added: Additions
) -> MechanismDescription:
    """The serial robot: its links with what is added, its joints as they are to be, a motor on each."""
    stated = stated_of(transmission.joint_model.mechanism)
    q = transmission.reference.q_joint.tolist()
    motors = tuple(
        Motor(name, name, 1.0, -joint.effort, joint.effort) if np.isfinite(joint.effort) else Motor(name, name)
        for name, joint in joints.items()
    )
    words = {name: each for name, each in stated.solver.joints.items() if name in joints}
    return check(
        MechanismDescription(
            name=f"{stated.name}_serial",
            root=stated.root,
            links=tuple(added.on(link) for link in stated.links if link.name in links),
            joints=tuple(joints.get(joint.name, joint) for joint in stated.joints if joint.child in links),
            independent=transmission.joints,
            actuated=transmission.joints,
            motors=motors,
            reference={name: (place,) for name, place in zip(transmission.joints, q, strict=True)},
            gravity=tuple(transmission.joint_model.gravity_vector.tolist()),
            source=stated.source,
            solver=SolverWords(stated.solver.options, stated.solver.flags, FrozenMapping(), words),
        )
    )


def _mass(link: Link) -> float:
    return 0.0 if link.inertia is None else link.inertia.mass


def with_all_limits(description: MechanismDescription) -> tuple[MechanismDescription, tuple[str, ...]]:
    """With a number for each limit of the serial joints, and a sentence where one was none.

    URDF's parsers refuse a joint without.
    """
    own = set(description.independent or ())
    joints = tuple(
        replace(joint, effort=min(joint.effort, _NO_LIMIT), velocity=min(joint.velocity, _NO_LIMIT))
        if joint.name in own
        else joint
        for joint in description.joints
    )
    open_ended = [j.name for j in description.joints if j.name in own and np.isinf([j.effort, j.velocity]).any()]
    told = (
        f"{', '.join(open_ended)}: {_NO_LIMIT:g} stands where no limit is stated of the motors: URDF's parsers want one"
    )
    return replace(description, joints=joints), (told,) * bool(open_ended)
