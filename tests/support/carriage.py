"""A carriage of 1 kg on rails, geared to a massless twin: a closed chain whose motions are those of a point mass."""

import numpy as np

import ccpin
from ccpin import MechanismDescription
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link

AXES = {"x": [1.0, 0, 0], "z": [0, 0, 1.0]}


def carriage(along="x", gravity=(0.0, 0.0, 0.0), **limits):
    """The reduced model of a mass of 1 kg that slides along each axis named, with its first slide geared to the twin's.

    Args:
        along: The slides' axes.
        gravity: m/s².
        limits: Of the first slide: lower, upper, effort, velocity.
    """
    mass = Inertia(1.0, np.zeros(3), np.eye(3) / 100)
    names = [*(f"rail_{axis}" for axis in along[:-1]), "carriage"]
    links = [Link("base"), Link("twin"), *(Link(name, mass if name == "carriage" else None) for name in names)]
    joints = [Joint("twin", "prismatic", "base", "twin", axis=np.array(AXES[along[0]]))]
    for axis, below, name in zip(along, ["base", *names], names, strict=False):
        stated = limits if axis == along[0] else {}
        joints.append(Joint(axis, "prismatic", below, name, axis=np.array(AXES[axis]), **stated))
    gears = (CouplingTerm(along[0], (0.0, 1.0)), CouplingTerm("twin", (0.0, -1.0)))
    description = MechanismDescription(
        "carriage", "base", tuple(links), tuple(joints), couplings=(Coupling("gear", gears),), gravity=gravity
    )
    return ccpin.ReducedModel(ccpin.load(description, independent=list(along), actuated=list(along)))
