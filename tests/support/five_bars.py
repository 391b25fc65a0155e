"""Five-bars of any lengths as mechanisms."""

import numpy as np

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Inertia, Joint, Link
from tests.oracles.five_bar import FiveBar

JOINTS = ("joint1", "joint2", "joint3", "joint4")
_Z = np.array([0.0, 0.0, 1.0])
_INERTIA = Inertia(1.0, np.zeros(3), 0.01 * np.eye(3))


def load_five_bar(bar):
    """A five-bar in the x-y plane, cut where its distal links meet, with motors at its base."""
    links = tuple(Link(name, _INERTIA) for name in ("base", "arm1", "arm2", "rod1", "rod2"))
    joints = (
        Joint("joint1", "revolute", "base", "arm1", _along(0.0), axis=_Z),
        Joint("joint2", "revolute", "base", "arm2", _along(bar.c), axis=_Z),
        Joint("joint3", "revolute", "arm1", "rod1", _along(bar.a1), axis=_Z),
        Joint("joint4", "revolute", "arm2", "rod2", _along(bar.a2), axis=_Z),
    )
    tip = LoopClosure("tip", "revolute", "rod1", "rod2", _along(bar.a3), _along(bar.a4))
    described = MechanismDescription("five-bar", "base", links, joints, (tip,), actuated=("joint1", "joint2"))
    return ccpin.load(described, independent=["joint1", "joint2"])


def random_five_bar(rng):
    """Lengths between 0.1 and 0.5 m with which it can be assembled."""
    while True:
        bar = FiveBar(*rng.uniform(0.1, 0.5, 5))
        if max(bar) < 0.9 * (sum(bar) - max(bar)):
            return bar


def in_tree_order(mechanism, q_free):
    """Configurations (K, 4) in the order of `JOINTS`, in that of the mechanism."""
    names = [joint.name for joint in mechanism.tree.joints]
    return np.asarray(q_free)[:, [JOINTS.index(name) for name in names]]


def _along(x):
    placement = np.eye(4)
    placement[0, 3] = x
    return placement
