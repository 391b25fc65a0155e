"""What a serial model of the robot leaves out: the linkage's own bodies, springs and dampers, and the rotors."""

from __future__ import annotations

from collections.abc import Set
from dataclasses import replace

from ccpin.description.model import Joint, MechanismDescription
from ccpin.dynamics.changed_constants import stated_otherwise
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.kinematics.tree import Tree
from ccpin.mechanism.mechanism import Mechanism
from ccpin.transmission.sides import Sides


def linkage_model(model: ReducedModel, sides: Sides) -> ReducedModel:
    """The model with the serial robot's part taken away: τ of it is what moving the linkage takes at the joints.

    The serial robot is made of the links that the joints alone carry, and of what these joints state (damping, springs,
    armature). All else is the linkage's: rods, cranks, rotors, and what the motors' joints state. As τ is linear in
    masses, dampers, springs and rotor inertias, τ of the model is the serial robot's and the linkage's.

    Args:
        model: In coordinates of the joints.
        sides: Joints and motors.
    """
    serial, plain = serial_links(model.mechanism.tree, sides.joints), set(sides.joints) - set(sides.motors)
    return stated_otherwise(
        model,
        lambda link: replace(link, inertia=None) if link.name in serial else link,
        lambda joint: massless(joint) if joint.name in plain else joint,
    )


def serial_links(tree: Tree, joints: tuple[str, ...]) -> Set[str]:
    """The links that these joints alone carry, those at rest among them."""
    carried = carriers(tree)
    return {link for link, place in tree.attachments.items() if carried[place.joint] <= set(joints)}


def carriers(tree: Tree) -> list[Set[str]]:
    """The joints that carry each body, by its joint's number, its own among them; none carry number 0."""
    found: list[Set[str]] = [frozenset()]
    for joint in tree.joints:
        found.append(found[joint.parent] | {joint.name})
    return found


def stated_of(mechanism: Mechanism) -> MechanismDescription:
    """What the mechanism's tree was built of."""
    return mechanism.held or mechanism.description


def massless(joint: Joint) -> Joint:
    """A joint that takes no effort."""
    return replace(frictionless(joint), armature=0.0, damping=0.0, stiffness=0.0)


def frictionless(joint: Joint) -> Joint:
    """A joint without dry friction."""
    return replace(joint, friction=0.0, breakaway=0.0, stribeck_speed=0.0)
