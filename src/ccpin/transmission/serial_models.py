"""A serial robot as a model in the coordinates of the mechanism that it stands for, and what was added to it alone."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import replace

from ccpin.description.model import Joint
from ccpin.dynamics.changed_constants import stated_otherwise
from ccpin.dynamics.reduced_model import ReducedModel
from ccpin.transmission.equivalent_masses import Additions
from ccpin.transmission.linkage import frictionless, massless
from ccpin.transmission.transmission import Transmission


def serial_alone(
    transmission: Transmission, links: Set[str], joints: Mapping[str, Joint], added: Additions
) -> ReducedModel:
    """The serial robot alone, in the mechanism's coordinates."""
    return stated_otherwise(
        transmission.joint_model,
        lambda link: added.on(link) if link.name in links else replace(link, inertia=None),
        lambda joint: replace(joints[joint.name], kind=joint.kind) if joint.name in joints else massless(joint),
    )


def added_alone(
    transmission: Transmission, links: Set[str], joints: Mapping[str, Joint], added: Additions
) -> ReducedModel:
    """What the serial robot has and `Transmission.linkage` stands beside: additions, and motors' joints of its own."""
    armatures = dict(zip(transmission.joints, added.armatures.tolist(), strict=True))

    def beyond(joint: Joint) -> Joint:
        if joint.name not in joints:
            return massless(joint)
        own = massless(joint) if joint.name in transmission.motors else joint
        damping, stiffness = (getattr(joints[joint.name], it) - getattr(own, it) for it in ("damping", "stiffness"))
        return replace(frictionless(joint), armature=armatures[joint.name], damping=damping, stiffness=stiffness)

    return stated_otherwise(
        transmission.joint_model,
        lambda link: added.on(replace(link, inertia=None)) if link.name in links else replace(link, inertia=None),
        beyond,
    )
