"""Joints held still: those a user locks, and spins that move nothing but themselves.

A whole joint is locked by fixing it in the description at its displacement; a component of one by a closure of one row
between its two links, which is where everything that reads φ finds it.

**When locking a spin changes nothing else.** Let a body (or bodies that go together) be free to turn by s about an axis
a fixed in it while everything else stays (`ccpin.mechanism.motion.idle`). φ then does not change along s: closed
configurations are circles over those of the rest.

1. *Motion.* A condition that holds at one point of each circle and is not tangent to it leaves the rest every motion
   it had, and n is one less. The row w·u = 0, with w fixed in the body that carries the ball and u fixed in the
   spinning body, u ⟂ a, is such a condition wherever w is not along a: its rate along s is ±|a × w|. That is a
   universal joint in the ball's place; w is chosen to be as far from along a as it can be around the reference.
2. *Dynamics.* Where mass is symmetric about a, T = T₀ + ½ J_s ω_s² with J_s its moment about a, ω_s = ṡ + A q̇ the
   body's angular velocity along a, and T₀ as with J_s = 0, neither s nor ṡ in it; s is in no potential either. So
   p = J_s ω_s is conserved where nothing acts on the spin (no damping, friction, armature, spring or motor of a joint
   that turns with it), and motions with p = 0, those that start without spin, are motions of the rest with T₀ for T
   (Routh). The rest has the same D, C and g whatever section stands for s, the locked one too: **with the spin locked
   and J_s left out they are exactly those of the mechanism whose spin is free.** The lock then bears no torque.
3. Where mass is not symmetric, or a joint's damping acts on the spin, no choice of the locked mechanism's inertia gives
   the free one's motion: it keeps all of it and moves as it would on a universal joint. That is done where the moment
   about a is at most that across it (a rod on balls, bent or not; on a joint about a itself at most a tenth of it). A
   body with more of its mass off the axis (a swing, a door on its hinges) stays free, and so does a spin that a spring
   or a motor turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import Inertia, LoopClosure, MechanismDescription, frame, inverse, rotation_to
from ccpin.kinematics.tree import ROOT_JOINT, Tree, TreeJoint
from ccpin.mechanism.loading.fixing import fixed
from ccpin.mechanism.loading.reference_search import Settled
from ccpin.mechanism.motion.idle import Idle, Turning

_ALONG = 1e-6  # rad/s in a spin of 1 rad/s: rates that differ by less are one
_SYMMETRIC = 1e-5  # of the inertia: less asymmetry is none (its square, where an offset counts squared)
_ROUNDING = 1e-12  # of the inertia across: what a rod keeps about its axis, for an inertia that is positive definite
_ON_BALLS = 1.0  # inertia about the axis over that across: more is no rod, on a ball
_ON_HINGES = 0.1  # the same on a joint about the axis itself, where a door is none either
_FAIR = 0.1  # of a lock's quality: one that is worse is none
_ALWAYS = 0.99  # of a lock's quality: that of a joint about the axis itself, which is 1


class Lock(NamedTuple):
    """How a spin is locked.

    Attributes:
        name: The joint or component that is locked.
        closure: The row that locks it; ``None``: the joint is fixed.
        quality: Rate of the row, or of the joint, at one radian per second of spin: 1 best, 0 no lock.
    """

    name: str
    closure: LoopClosure | None
    quality: float


class Spin(NamedTuple):
    """An idle spin with the cluster it belongs to, and how to lock it (``None``: it cannot be)."""

    settled: Settled
    idle: Idle
    lock: Lock | None

    @property
    def joints(self) -> list[TreeJoint]:
        """The joints that turn with it, of the cluster's tree."""
        relative = self.idle.spin[0].relative
        return [j for j in self.settled.part.tree.joints if np.linalg.norm(relative[j.number]) > _ALONG]

    @property
    def masses(self) -> list[SpinningMass]:
        """The mass of its bodies as the axis sees it."""
        tree, turning = self.settled.part.tree, self.idle.spin[0]
        return [_spinning(tree, joint, turning) for joint in sorted(self.idle.bodies)]

    @property
    def idle_in_mass(self) -> bool:
        """Whether its mass makes it a rod: symmetric about the axis, or more along it than about it.

        On a joint about the axis itself, which somebody has put there, it must be nearly all on the axis: a door turns
        on its hinges without moving anything else too.
        """
        masses = self.masses
        about, across = sum(mass.about for mass in masses), sum(mass.across for mass in masses)
        most = _ON_BALLS if self.lock is not None and self.lock.closure is not None else _ON_HINGES
        return all(mass.symmetric for mass in masses) or about <= most * across

    def named_by(self, names: Sequence[str]) -> bool:
        """Whether one of the names is one of its joints or a component of one."""
        tree = self.settled.part.tree
        return bool({tree.split(name)[0] for name in names} & {joint.name for joint in self.joints})


class LockedDescription(NamedTuple):
    """A description with its idle spins locked.

    Attributes:
        description: Whole joints fixed, and a row for each spin that locks none; the spinning links' inertia changed.
        locked: What was locked, by name.
        notes: In words.
    """

    description: MechanismDescription
    locked: tuple[str, ...]
    notes: tuple[str, ...]


def spins_of(settled: Settled, motions: Sequence[Idle], coupled: Sequence[str]) -> Iterator[Spin]:
    """The spins among a cluster's idle motions, and how each is best locked."""
    tree = settled.part.tree
    for idle in motions:
        if idle.spin:
            usable = (joint for joint in tree.joints if joint.name not in (ROOT_JOINT, *coupled))
            locks = [lock for joint in usable if (lock := _lock(tree, joint, idle.spin)) is not None]
            yield Spin(settled, idle, max(locks, key=_preference, default=None))


def _preference(lock: Lock) -> tuple[bool, float]:
    """A joint about the axis itself first: it locks the spin in every configuration."""
    return lock.closure is None and lock.quality > _ALWAYS, round(lock.quality, 9)


def _lock(tree: Tree, joint: TreeJoint, spin: Sequence[Turning]) -> Lock | None:
    """How a spin can be locked at one joint."""
    rates = np.array([turning.relative[joint.number] for turning in spin])
    if joint.kind.nv == 1:
        quality = float(np.linalg.norm(rates, axis=1).min())
        return Lock(joint.name, None, quality) if quality > _FAIR else None
    axes = np.array([turning.axis for turning in spin])
    whole = [np.abs(rates - sign * axes).max() < _ALONG for sign in (1.0, -1.0)]
    if not any(whole):
        return None
    carried = np.array([t.poses[joint.parent, :3, :3].T @ t.axis for t in spin])
    w = np.linalg.eigh(carried.T @ carried)[1][:, 0]
    w = w * np.sign(w[int(np.argmax(np.round(np.abs(w), 9)))])
    quality = float(np.linalg.norm(np.cross(carried, w), axis=1).min())
    turn = spin[0].poses[joint.number, :3, :3]
    u = np.cross(spin[0].axis, spin[0].poses[joint.parent, :3, :3] @ w)
    own = turn.T @ spin[0].axis
    turns = [k for k, slides in enumerate(joint.kind.slides) if not slides]
    along = np.abs(joint.kind.directions(joint.axis)[turns] @ own)
    name = f"{joint.name}:{joint.kind.components[turns[int(np.argmax(along))]]}"
    closure = perpendicular(tree, joint, name, w, turn.T @ u / np.linalg.norm(u))
    return Lock(name, closure, quality) if quality > _FAIR else None


def perpendicular(tree: Tree, joint: TreeJoint, name: str, w: Array, u: Array) -> LoopClosure:
    """The closure w·u = 0 of a joint: unit vectors in the axes of the body that carries it and in its own."""
    parent, child = joint.stated.parent, joint.stated.child
    at_a = frame(joint.placement[:3, 3], rotation_to(w)[:, [2, 0, 1]])
    at_b = frame(np.zeros(3), rotation_to(u)[:, [1, 2, 0]])
    a, b = (inverse(tree.attachments[link].placement) for link in (parent, child))
    return LoopClosure(f"{name} locked", "perpendicular", parent, child, a @ at_a, b @ at_b)


def hold(description: MechanismDescription, tree: Tree, q_free: Array, spins: Sequence[Spin]) -> LockedDescription:
    """Lock spins that have a lock, at a configuration q′ of the whole tree."""
    locks, thin, notes = list[Lock](), dict[str, Inertia | None](), list[str]()
    for spin in spins:
        if spin.lock is not None:
            lighter, told = _without_spin(spin)
            locks, thin = [*locks, spin.lock], thin | lighter
            name = spin.lock.name
            notes.append(f"{spin.idle.sentence}: locked as '{name}' (load(free=['{name}']) leaves it free). {told}")
    still, more = fixed(description, tree, q_free, [lock.name for lock in locks if lock.closure is None])
    rows = tuple(lock.closure for lock in locks if lock.closure is not None)
    links = tuple(replace(ln, inertia=thin[ln.name]) if ln.name in thin else ln for ln in still.links)
    held = replace(still, links=links, closures=(*still.closures, *rows))
    return LockedDescription(held, tuple(lock.name for lock in locks), (*notes, *more))


def _without_spin(spin: Spin) -> tuple[dict[str, Inertia | None], str]:
    """The inertia of the spinning links without their moment about the axis, and what that changes, in words."""
    tree, masses = spin.settled.part.tree, spin.masses
    acting = [f"'{joint.name}'" for joint in spin.joints if _acted_on(joint)]
    if acting or not all(mass.symmetric for mass in masses):
        why = f"Damping, friction or a rotor of {', '.join(acting)} acts on it"
        why = why if acting else "Its mass is not symmetric about that axis"
        return {}, f"{why}, so the rest moves as with a universal joint in place of the ball, not freely"
    thin = dict[str, Inertia | None]()
    for joint, mass in zip(sorted(spin.idle.bodies), masses, strict=True):
        links = [name for name, place in tree.attachments.items() if place.joint == joint]
        thin |= dict.fromkeys(links) | {links[0]: _seen_from(inverse(tree.attachments[links[0]].placement), mass.thin)}
    return thin, (
        f"Its moment of inertia about that axis, {sum(mass.about for mass in masses):.3g} kg m², is left out of the "
        "equations: the rest moves exactly as with a free spin that starts from rest"
    )


def _acted_on(joint: TreeJoint) -> bool:
    stated = joint.stated
    return bool(stated.damping or stated.breakaway_level or stated.armature)


class SpinningMass(NamedTuple):
    """What a body's mass is about the axis it spins about.

    Attributes:
        about: Its moment of inertia about the axis, kg m².
        across: Its mean moment about lines across the axis through its centre of mass, kg m².
        symmetric: Whether the axis goes through that and all moments across it are equal.
        thin: It without its moment about the axis, in the axes of its joint.
    """

    about: float
    across: float
    symmetric: bool
    thin: Inertia


def _spinning(tree: Tree, joint: int, turning: Turning) -> SpinningMass:
    inertia, pose = tree.model.inertias[joint], turning.poses[joint]
    axis, point = pose[:3, :3].T @ turning.axis, pose[:3, :3].T @ (turning.point - pose[:3, 3])
    plane, com, moments = np.eye(3) - np.outer(axis, axis), np.array(inertia.lever), np.array(inertia.inertia)
    offset, own = plane @ (com - point), float(axis @ moments @ axis)
    across = 0.5 * float(np.trace(plane @ moments @ plane))
    bent = np.abs(moments - across * plane - own * np.outer(axis, axis)).max()
    about = own + inertia.mass * float(offset @ offset)
    size = float(np.trace(moments)) + inertia.mass * float(com @ com)
    symmetric = bool(bent <= _SYMMETRIC * size and about - own <= _SYMMETRIC**2 * size)
    thin = Inertia(inertia.mass, com - offset, across * (plane + _ROUNDING * np.outer(axis, axis)))
    return SpinningMass(about, across, symmetric, thin)


def _seen_from(placement: Array, inertia: Inertia) -> Inertia:
    """Inertia in a frame that sees its own at `placement`."""
    turn = placement[:3, :3]
    return Inertia(inertia.mass, turn @ inertia.com + placement[:3, 3], turn @ inertia.rotational @ turn.T)
