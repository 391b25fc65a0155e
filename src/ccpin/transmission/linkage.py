"""What a serial model of the robot leaves out: the linkage's own bodies, springs and dampers, and the rotors."""

from __future__ import annotations

from dataclasses import replace

from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.kinematics.tree import ROOT_JOINT, build_tree
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
    mechanism, joints = model.mechanism, set(sides.joints)
    tree = mechanism.tree
    carried: list[set[str]] = [set()]
    for joint in tree.joints:
        carried.append(carried[joint.parent] | {joint.name})
    serial = {link for link, place in tree.attachments.items() if carried[place.joint] <= joints}
    stated, plain = mechanism.held or mechanism.description, joints - set(sides.motors)
    links = tuple(replace(link, inertia=None) if link.name in serial else link for link in stated.links)
    own = tuple(
        replace(joint, armature=0.0, damping=0.0, friction=0.0, stiffness=0.0) if joint.name in plain else joint
        for joint in stated.joints
    )
    left = build_tree(replace(stated, links=links, joints=own), ROOT_JOINT in tree.names)
    return ReducedModel(replace(mechanism, tree=left), model.gravity_vector)
