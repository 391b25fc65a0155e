"""Ball joints that are written as three revolutes: three axes through one point, without mass between them.

A description that knows no ball joint, or an author who wants its angles, writes one as three revolutes a, b, c with
a ⟂ b, b ⟂ c and massless links between. Where a and c come to be along one line (gimbal lock) the two turn against
each other without moving any mass: D is singular there, of the three revolutes and not of the mechanism. `on_balls` is
the mechanism with one ball joint for each such triple, and `Balls` reads its configurations as the triple's angles.

With â, b̂, ĉ the axes in the third joint's child link, at zero angles, that link's rotation from there is

    Q = E(â, θa) E(b̂, θb) E(ĉ, θc),      ω = (E_b E_c)ᵀ â θ̇a + E_cᵀ b̂ θ̇b + ĉ θ̇c

(ω in the link's own axes). With n = b̂ × â, ĉ = E(b̂, δ) â and β = θb + δ

    Qĉ = cos β â + sin β (cos θa n + sin θa b̂),

so that every Q has two triples of angles (β and −β) up to whole turns, and in gimbal lock (sin β = 0) a circle of them.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ccpin.arrays import Array
from ccpin.description.joint_kinds import FIXED
from ccpin.description.model import Joint, Link, MechanismDescription, frame, inverse
from ccpin.description.rotations import quaternion_matrix
from ccpin.kinematics.tree import ROOT_JOINT, Tree, TreeJoint, build_tree
from ccpin.mechanism.mechanism import Mechanism

_SQUARE = 1e-12  # cosine of the angle from which on axes are square
_ONE_POINT = 1e-12  # of the joints' distances: axes nearer meet in one point
_LOCKED = 1e-9  # sine of the second angle, and of the largest rate: gimbal lock


class Triple(NamedTuple):
    """Three revolutes that are a ball joint.

    Attributes:
        joints: a, b, c, root side first.
        centre: Where their axes meet and how the child link of c is turned, both at zero angles, as a 4×4 frame in the
            frame of the joint that carries a.
        axes: â, b̂, ĉ as rows, of shape (3, 3).
    """

    joints: tuple[TreeJoint, TreeJoint, TreeJoint]
    centre: Array
    axes: Array

    @property
    def name(self) -> str:
        """What the ball joint is called."""
        return " ".join(joint.name for joint in self.joints)

    def rotation(self, angles: Array) -> Array:
        """Q, of shape (3, 3)."""
        first, second, third = (_turn(axis, angle) for axis, angle in zip(self.axes, angles, strict=True))
        return np.asarray(first @ second @ third)

    def rates(self, angles: Array) -> Array:
        """ω by the angles' rates, of shape (3, 3), singular in gimbal lock."""
        a, b, c = self.axes
        third = _turn(c, angles[2])
        return np.column_stack([(_turn(b, angles[1]) @ third).T @ a, third.T @ b, c])

    def angles(self, rotation: Array, near: Array) -> Array:
        """The angles of Q nearest to others, up to whole turns; in gimbal lock θa is as it was there.

        Args:
            rotation: Q, of shape (3, 3).
            near: The others, of shape (3,), rad.
        """
        a, b, c = self.axes
        shift = np.arctan2(b @ np.cross(a, c), a @ c)
        pointing = rotation @ c
        along, across = pointing @ a, np.array([pointing @ np.cross(b, a), pointing @ b])
        sine = float(np.hypot(*across))
        found = []
        for sign in (1.0, -1.0):
            first = float(np.arctan2(sign * across[1], sign * across[0])) if sine > _LOCKED else float(near[0])
            second = float(np.arctan2(sign * sine, along)) - shift
            last = (_turn(a, first) @ _turn(b, second)).T @ rotation @ b
            found.append(_nearest(np.array([first, second, np.arctan2(last @ np.cross(c, b), last @ b)]), near))
        return min(found, key=lambda angles: float(np.abs(angles - near).max()))


class Balls:
    """A mechanism on the ball joints that its triples are, and how its configurations are read.

    Independent and actuated coordinates are the same, so that q, q̇ and u are; q′ and q̇′ are not.

    Args:
        home: The mechanism with the revolutes.
        triples: Those to be ball joints, at least one.

    Attributes:
        mechanism: The mechanism on balls. names: what the balls are called.
    """

    def __init__(self, home: Mechanism, triples: tuple[Triple, ...]) -> None:
        self._triples, self._home = triples, home.tree
        self.names = tuple(triple.name for triple in triples)
        held = None if home.held is None else _on_balls(home.held, home.tree, triples)
        description = _on_balls(home.description, home.tree, triples)
        self._base = build_tree(description if held is None else held, ROOT_JOINT in home.tree.names)
        gone = {joint.name for triple in triples for joint in triple.joints}
        kept = [(joint, self._base.joint(joint.name)) for joint in home.tree.joints if joint.name not in gone]
        self._q_home, self._q_base = (_places([pair[k].q for pair in kept]) for k in (0, 1))
        self._v_home, self._v_base = (_places([pair[k].v for pair in kept]) for k in (0, 1))
        rank = home.mobility.rank + self._base.model.nv - home.tree.model.nv
        self.mechanism = replace(
            home,
            description=description,
            held=held,
            tree=self._base,
            q_reference=self.gathered(home.q_reference),
            mobility=home.mobility._replace(n_free=self._base.model.nv, rank=rank),
        )

    def gathered(self, q_free: Array) -> Array:
        """q′ on balls of a q′ of the revolutes."""
        gathered = np.empty(self._base.model.nq)
        gathered[self._q_base] = q_free[self._q_home]
        for triple in self._triples:
            turned = Rotation.from_matrix(triple.rotation(_angles(triple, q_free)))
            gathered[self._base.joint(triple.name).q] = turned.as_quat()
        return gathered

    def gathered_rate(self, q_free: Array, v_free: Array) -> Array:
        """q̇′ on balls of a q̇′ of the revolutes at their q′; also of several columns, of shape (n′, k)."""
        gathered = np.empty((self._base.model.nv, *v_free.shape[1:]))
        gathered[self._v_base] = v_free[self._v_home]
        for triple in self._triples:
            rates = np.concatenate([v_free[joint.v] for joint in triple.joints])
            gathered[self._base.joint(triple.name).v] = triple.rates(_angles(triple, q_free)) @ rates
        return gathered

    def told(self, q_free: Array, near: Array) -> Array:
        """q′ of the revolutes of a q′ on balls: of the angles that give it, those nearest to others.

        Args:
            q_free: q′ on balls.
            near: A q′ of the revolutes.
        """
        told = np.empty(self._home.model.nq)
        told[self._q_home] = q_free[self._q_base]
        for triple in self._triples:
            rotation = quaternion_matrix(q_free[self._base.joint(triple.name).q])
            angles = triple.angles(rotation, _angles(triple, near))
            for joint, angle in zip(triple.joints, angles, strict=True):
                told[joint.q] = joint.kind.stated(np.array([angle]))
        return told

    def told_rate(self, told: Array, v_free: Array) -> Array:
        """q̇′ of the revolutes of a q̇′ on balls, at a q′ that `told` gave.

        In gimbal lock no rates of the angles may give a ball's ω; they are then the least that come nearest to it.

        Args:
            told: q′ of the revolutes.
            v_free: q̇′ on balls, of shape (n′,) or (n′, k).
        """
        rate = np.empty((self._home.model.nv, *v_free.shape[1:]))
        rate[self._v_home] = v_free[self._v_base]
        for triple in self._triples:
            omega = v_free[self._base.joint(triple.name).v]
            found = np.linalg.lstsq(triple.rates(_angles(triple, told)), omega, rcond=_LOCKED)[0]
            for joint, one in zip(triple.joints, found, strict=True):
                rate[joint.v] = one
        return rate

    def told_forces(self, forces: Array) -> Array:
        """Forces on the other joints, of shape (n′,) on balls, among the revolutes' columns; none is on a ball."""
        told = np.zeros(self._home.model.nv)
        told[self._v_home] = forces[self._v_base]
        return told


def balls_of(mechanism: Mechanism, used: Collection[str] = ()) -> Balls | None:
    """The mechanism on the ball joints that its concurrent revolutes are; ``None`` where there are none.

    Args:
        mechanism: The mechanism.
        used: Joints and links (by name) that something acts on or that are looked at: no ball takes them.
    """
    triples = tuple(_triples(mechanism, set(used)))
    return Balls(mechanism, triples) if triples else None


def _triples(mechanism: Mechanism, used: set[str]) -> Iterator[Triple]:
    """Runs of three revolutes that are a ball and nothing else; no joint is in two."""
    tree, taken = mechanism.tree, set[str]()
    links = {link for closure in (*mechanism.closures, *mechanism.locks) for link, _ in closure.ends}
    used |= links | {term.joint for coupling in mechanism.couplings for term in coupling.terms}
    used |= {tree.split(name)[0] for name in (*mechanism.independent, *mechanism.actuated)}
    used |= {motor.joint for motor in mechanism.description.motors}
    carried: dict[int, list[TreeJoint]] = {}
    for joint in tree.joints:
        carried.setdefault(joint.parent, []).append(joint)
    on = {number: [name for name, at in tree.attachments.items() if at.joint == number] for number in carried}
    for first in tree.joints:
        chain = [first]
        while len(chain) < 3 and len(carried.get(chain[-1].number, ())) == 1:
            chain += carried[chain[-1].number]
        between = [name for joint in chain[:2] for name in on.get(joint.number, ())]
        names = {joint.name for joint in chain}
        if len(chain) < 3 or not all(_free(joint) for joint in chain) or (names | set(between)) & used or names & taken:
            continue
        if any(np.any(tree.model.inertias[joint.number].toDynamicParameters()) for joint in chain[:2]):
            continue
        triple = _concurrent(tree, (chain[0], chain[1], chain[2]))
        if triple is not None:
            taken |= names
            yield triple


def _free(joint: TreeJoint) -> bool:
    """Whether a joint turns about one axis and nothing acts on it."""
    stated = joint.stated
    acted = stated.damping or stated.breakaway_level or stated.stiffness or stated.armature
    return joint.kind.nv == 1 and not joint.kind.sliding and not acted


def _concurrent(tree: Tree, joints: tuple[TreeJoint, TreeJoint, TreeJoint]) -> Triple | None:
    """Three revolutes as a ball; ``None`` where their axes do not meet in one point or are not square."""
    poses = [joints[0].placement]
    for joint in joints[1:]:
        poses.append(poses[-1] @ joint.placement)
    points = [pose[:3, 3] for pose in poses]
    lines = [pose[:3, :3] @ joint.axis for pose, joint in zip(poses, joints, strict=True)]
    a, b, c = lines
    if max(abs(a @ b), abs(b @ c)) > _SQUARE:
        return None
    centre = points[1] + ((points[0] - points[1]) @ b) * b  # on b's line, at its foot on a's: a ⟂ b
    size = max(1e-3, *(float(np.linalg.norm(joint.placement[:3, 3])) for joint in joints))
    off = [np.linalg.norm(np.cross(centre - point, line)) for point, line in zip(points, lines, strict=True)]
    if max(off) > _ONE_POINT * size:
        return None
    turn = poses[-1][:3, :3] @ tree.attachments[joints[-1].stated.child].placement[:3, :3]
    return Triple(joints, frame(centre, turn), np.array(lines) @ turn)


def _on_balls(description: MechanismDescription, tree: Tree, triples: tuple[Triple, ...]) -> MechanismDescription:
    """A description with a ball joint, and what fixes the last link to it, in the place of each triple."""
    gone = {joint.name for triple in triples for joint in triple.joints}
    between = {
        name
        for triple in triples
        for name, at in tree.attachments.items()
        if at.joint in (triple.joints[0].number, triple.joints[1].number)
    }
    joints = [joint for joint in description.joints if joint.name not in gone and joint.child not in between]
    links = [link for link in description.links if link.name not in between]
    for triple in triples:
        first, _, third = (joint.stated for joint in triple.joints)
        centre = inverse(tree.attachments[first.parent].placement) @ triple.centre
        links.append(Link(triple.name))
        joints.append(Joint(triple.name, "spherical", first.parent, triple.name, centre))
        joints.append(Joint(f"{triple.name} fixed", FIXED, triple.name, third.child, _last(tree, triple)))

    def without(pose: Mapping[str, tuple[float, ...]]) -> dict[str, tuple[float, ...]]:
        return {name: value for name, value in pose.items() if name not in gone}

    return replace(
        description,
        joints=tuple(joints),
        links=tuple(links),
        dependent_hint=tuple(name for name in description.dependent_hint if name not in gone),
        reference=without(description.reference),
        poses={name: without(pose) for name, pose in description.poses.items()},
    )


def _last(tree: Tree, triple: Triple) -> Array:
    """The child link of the third joint in the ball's frame."""
    pose = triple.joints[0].placement @ triple.joints[1].placement @ triple.joints[2].placement
    child = pose @ tree.attachments[triple.joints[2].stated.child].placement
    return inverse(triple.centre) @ child


def _angles(triple: Triple, q_free: Array) -> Array:
    return np.concatenate([joint.kind.told(q_free[joint.q]) for joint in triple.joints])


def _nearest(angles: Array, near: Array) -> Array:
    """The same angles up to whole turns, each nearest to another."""
    return np.asarray(angles + 2 * np.pi * np.round((near - angles) / (2 * np.pi)))


def _turn(axis: Array, angle: float) -> Array:
    return np.asarray(Rotation.from_rotvec(angle * axis).as_matrix())


def _places(windows: list[slice]) -> Array:
    return np.concatenate([np.arange(window.start, window.stop) for window in windows])
