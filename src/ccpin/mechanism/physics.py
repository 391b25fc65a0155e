"""What a mechanism's joints and motors state beside their geometry, as arrays along q′, q̇′ and u."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array, frozen
from ccpin.description.model import MechanismDescription, Motor
from ccpin.kinematics.coordinates import component_names
from ccpin.kinematics.tree import Tree


class JointPhysics(NamedTuple):
    """Of the free system's joints, of shape (n′,) each, read-only; a joint of several velocities has equal entries.

    Attributes:
        names: ``joint`` or ``joint:axis``.
        damping: b of the force −b q̇′, N m s/rad or N s/m; in every equation of motion.
        friction: Coulomb levels, N m or N. With the next two what `ccpin.simulate` takes where it is told no other.
        breakaway: Breakaway levels, N m or N, the Coulomb ones where a joint states no other.
        stribeck_speed: rad/s or m/s; 0 of joints without a Stribeck effect.
        stiffness: k of the force −k (θ − θ₀), N m/rad or N/m; part of g and of the potential energy.
        spring_reference: θ₀, rad or m; zero for a ball joint, whose spring pulls by −k log R.
        armature: Reflected rotor inertias, kg m² or kg; part of D.
        effort: Limits of the joints' efforts, N m or N. Nothing here keeps to them but who reads them.
        velocity: Limits of the joints' velocities, rad/s or m/s; as for `effort`.
    """

    names: tuple[str, ...]
    damping: Array
    friction: Array
    breakaway: Array
    stribeck_speed: Array
    stiffness: Array
    spring_reference: Array
    armature: Array
    effort: Array
    velocity: Array


def joint_physics(tree: Tree) -> JointPhysics:
    """What the joints of a tree state."""
    columns = {}
    for field in JointPhysics._fields[1:]:
        values = np.zeros(tree.model.nv)
        for joint in tree.joints:
            values[joint.v] = getattr(joint.stated, "breakaway_level" if field == "breakaway" else field)
        columns[field] = frozen(values)
    return JointPhysics(tuple(component_names(tree)), **columns)


class Motors(NamedTuple):
    """The motors, one an entry of u.

    Attributes:
        each: What is stated of each; one motor stands for all entries of a joint with several velocities.
        gears: Effort on the joint per unit of u, of shape (motors,).
        limits: Bounds of u by its own and by its joint's limit of effort, of shape (motors, 2); a joint's limit of 0,
            which exporters write where they know none, is no bound.
    """

    each: tuple[Motor, ...]
    gears: Array
    limits: Array

    @property
    def joint_limits(self) -> Array:
        """Bounds of the efforts on their joints, behind gears of either sign, lower and upper, of shape (motors, 2)."""
        return np.sort(self.gears[:, None] * self.limits, axis=1)


def motors_of(description: MechanismDescription, tree: Tree, actuated: tuple[str, ...]) -> Motors:
    """The motors of the actuated joints (or components), plain ones where the description says nothing of them."""
    known = {motor.joint: motor for motor in description.motors}
    each = []
    for name in actuated:
        joint = tree.joint(tree.split(name)[0])
        motor = known.get(name) or known.get(joint.name) or Motor(name, name)
        each += [(motor, joint.stated.effort or np.inf)] * (1 if ":" in name else joint.kind.nv)
    gears = np.array([motor.gear for motor, _ in each])
    limits = [
        (max(motor.lower, -effort / abs(motor.gear)), min(motor.upper, effort / abs(motor.gear)))
        for motor, effort in each
    ]
    return Motors(tuple(motor for motor, _ in each), frozen(gears), frozen(np.reshape(limits, (-1, 2))))
