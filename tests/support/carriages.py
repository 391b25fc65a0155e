"""Small mechanisms whose slides and coupled joints go far: rotors, double sliders, rails, carriages on carriages."""

import numpy as np

import ccpin
from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link

X, Y, Z = np.eye(3)
_BODY = Inertia(1.0, np.zeros(3), 0.01 * np.eye(3))


def joint(kind, name, parent, x=0.0, y=0.0, axis=X, **more):
    """A revolute joint about z, or a prismatic one along `axis`, that carries the body `name`'s own."""
    turning = kind == "revolute"
    return Joint(name, kind, parent, f"{name}_body", at(x, y), axis=Z if turning else axis, **more)


def pin(first, second, x, kind="revolute", name="pin", y=0.0, end=0.0):
    """A pin between a point (x, 0) of one joint's body and one (end, y) of another's."""
    return LoopClosure(name, kind, f"{first}_body", f"{second}_body", at(x), at(end, y))


def at(x=0.0, y=0.0):
    """A frame moved in the x-y plane."""
    placement = np.eye(4)
    placement[:2, 3] = x, y
    return placement


def geared(driven, driver, ratio, offset=0.0, name="gear"):
    """driven = ratio · driver + offset."""
    return Coupling(name, (CouplingTerm(driver, (offset, ratio)), CouplingTerm(driven, (0.0, -1.0))))


def five_bar_with_rotor(bar, ratio, driver="joint1"):
    """A five-bar with a rotor on its base that turns `ratio` times with one of its joints."""
    joints = (
        Joint("joint1", "revolute", "base", "arm1", at(), axis=Z),
        Joint("joint2", "revolute", "base", "arm2", at(bar.c), axis=Z),
        Joint("joint3", "revolute", "arm1", "rod1", at(bar.a1), axis=Z),
        Joint("joint4", "revolute", "arm2", "rod2", at(bar.a2), axis=Z),
        Joint("rotor", "revolute", "base", "wheel", at(0.0, 0.3), axis=Z),
    )
    tip = LoopClosure("tip", "revolute", "rod1", "rod2", at(bar.a3), at(bar.a4))
    return linkage("geared five-bar", joints, (tip,), (geared("rotor", driver, ratio),), ["joint1", "joint2"])


def double_slider(rod, height=0.0, **limits):
    """Two sliders along x, the second one `height` above, with a rod between: s − q = ±√(rod² − height²)."""
    joints = (
        Joint("drive", "prismatic", "base", "first", at(), axis=X),
        Joint("elbow", "revolute", "first", "rod", at(), axis=Z),
        Joint("slide", "prismatic", "base", "second", at(0.0, height), axis=X, **limits),
    )
    return linkage(
        "double slider", joints, (LoopClosure("tip", "revolute", "rod", "second", at(rod), at()),), (), ["drive"]
    )


def rail(crank, rod, across, **limits):
    """A crank's rod leads a slider whose rail is carried along x by an independent slide: a travelling anchor.

    Slider at (travel + s, across), crank at the origin.
    """
    joints = (
        Joint("travel", "prismatic", "base", "rail", at(0.0, across), axis=X),
        Joint("crank", "revolute", "base", "arm", at(), axis=Z),
        Joint("elbow", "revolute", "arm", "rod", at(crank), axis=Z),
        Joint("slide", "prismatic", "rail", "slider", at(), axis=X, **limits),
    )
    closure = LoopClosure("tip", "revolute", "rod", "slider", at(rod), at())
    return linkage("rail", joints, (closure,), (), ["travel", "crank"])


def two_carriages(rod, ratio, **limits):
    """Carriage b goes `ratio` times as far as carriage a, the drive; a slider on b is held by a rod to a.

    b + s − a = ±rod.
    """
    joints = (
        Joint("a", "prismatic", "base", "first", at(), axis=X),
        Joint("b", "prismatic", "base", "second", at(), axis=X),
        Joint("elbow", "revolute", "first", "rod", at(), axis=Z),
        Joint("slide", "prismatic", "second", "slider", at(), axis=X, **limits),
    )
    closure = LoopClosure("tip", "revolute", "rod", "slider", at(rod), at())
    return linkage("two carriages", joints, (closure,), (geared("b", "a", ratio),), ["a"])


def linkage(name, joints, closures, couplings, independent):
    """Joints on a base as a mechanism, a body a joint."""
    links = (Link("base"), *(Link(joint.child, _BODY) for joint in joints))
    described = MechanismDescription(name, "base", links, tuple(joints), tuple(closures), couplings=tuple(couplings))
    return ccpin.load(described, independent=independent)
