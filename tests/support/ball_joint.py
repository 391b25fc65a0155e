"""A small mechanism whose independent coordinates are a unit quaternion."""

import numpy as np

import ccpin
from ccpin.description import Inertia, Joint, Link


def ball_joint():
    """A body on a ball joint to the world, with a second body on a ball joint welded back to it by a closure."""
    links = [Link("base")]
    links += [Link(name, Inertia(1.0, np.array([0.2, 0, 0]), 0.1 * np.eye(3))) for name in ("ball", "rod")]
    elbow, tip = np.eye(4), np.eye(4)
    elbow[0, 3], tip[0, 3] = 0.5, 1.0
    joints = (
        Joint("shoulder", "spherical", "base", "ball"),
        Joint("elbow", "spherical", "ball", "rod", elbow),
    )
    closure = ccpin.LoopClosure("tie", "fixed", "rod", "ball", tip, elbow @ tip)
    description = ccpin.MechanismDescription("ball", "base", tuple(links), joints, closures=(closure,))
    return ccpin.ReducedModel(ccpin.load(description, independent=["shoulder"]))
