"""Families of planar mechanisms of any size: n four-bars, each carried by the last one's rocker or all by one base."""

import numpy as np

from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Inertia, Joint, Link

Z = np.array([0.0, 0.0, 1.0])
CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.8, 0.6, 0.7  # m: a crank that turns all the way round (Grashof)
START = 1.0
"""The crank's angle at the reference."""


def serial(n):
    """n four-bars, each standing on the rocker of the one before; 3 n joints, n degrees of freedom, n clusters."""
    return _family("serial", n, lambda k: (f"rocker{k - 1}", _shift(0.5 * ROCKER)) if k else ("base", np.eye(4)))


def parallel(n):
    """n four-bars side by side on one base; 3 n joints, n degrees of freedom, n clusters."""
    return _family("parallel", n, lambda k: ("base", _shift(float(k), axis=2)))


def four_bar_angles(crank=START):
    """The coupler's and the rocker's joint angles that close a four-bar at a crank angle, in closed form."""
    tip = CRANK * np.array([np.cos(crank), np.sin(crank)])
    to_foot = np.array([GROUND, 0.0]) - tip
    distance = np.hypot(*to_foot)
    inner = np.arccos((distance**2 + COUPLER**2 - ROCKER**2) / (2.0 * distance * COUPLER))
    heading = np.arctan2(to_foot[1], to_foot[0]) + inner
    joint = tip + COUPLER * np.array([np.cos(heading), np.sin(heading)])
    return heading - crank, np.arctan2(joint[1], joint[0] - GROUND)


def _family(name, n, carrier):
    """n four-bars with a crank, a coupler and a rocker each; `carrier` gives the link and the frame one stands on."""
    links, joints, closures, reference = [Link("base", _bar(GROUND))], [], [], {}
    coupler, rocker = four_bar_angles()
    for k in range(n):
        parent, foot = carrier(k)
        links += [Link(f"{part}{k}", _bar(length)) for part, length in _PARTS]
        joints += [
            Joint(f"crank_joint{k}", "revolute", parent, f"crank{k}", foot, Z),
            Joint(f"coupler_joint{k}", "revolute", f"crank{k}", f"coupler{k}", _shift(CRANK), Z),
            Joint(f"rocker_joint{k}", "revolute", parent, f"rocker{k}", foot @ _shift(GROUND), Z),
        ]
        tip = _shift(COUPLER), _shift(ROCKER)
        closures.append(LoopClosure(f"loop{k}", "revolute", f"coupler{k}", f"rocker{k}", *tip))
        reference |= {f"crank_joint{k}": (START,), f"coupler_joint{k}": (coupler,), f"rocker_joint{k}": (rocker,)}
    return MechanismDescription(
        f"{name} {n}",
        "base",
        tuple(links),
        tuple(joints),
        tuple(closures),
        actuated=tuple(f"crank_joint{k}" for k in range(n)),
        reference=reference,
    )


_PARTS = (("crank", CRANK), ("coupler", COUPLER), ("rocker", ROCKER))


def _shift(distance, axis=0):
    placement = np.eye(4)
    placement[axis, 3] = distance
    return placement


def _bar(length):
    """A slender bar of 1 kg/m along x."""
    return Inertia(length, np.array([0.5 * length, 0.0, 0.0]), np.diag([1e-4, 1.0, 1.0]) * length**3 / 12.0)


def walker(legs, limit=np.inf):
    """Jansen's leg, `legs` times on one crank shaft at even phases: 6 joints and 3 loops a leg, one degree of freedom.

    No pose is stated, and none with all joints at zero closes. Angles are limited to ±`limit` from there.
    """
    links, joints, closures = [Link("base", _bar(1.0)), Link("crank", _bar(0.15))], [], []

    def add(name, parent, foot, length):
        links.append(Link(name, _bar(length)))
        joints.append(Joint(f"{name}_joint", "revolute", parent, name, foot, Z, lower=-limit, upper=limit))

    joints.append(Joint("shaft", "revolute", "base", "crank", np.eye(4), Z))
    for k in range(legs):
        pin, hinge = _turn(2.0 * np.pi * k / legs) @ _shift(0.15), _at(-0.38, -0.078)
        upper_far, lower_far = _triangle(0.415, 0.401, 0.558), _triangle(0.367, 0.490, 0.657)
        add(f"upper_rod{k}", "crank", pin, 0.5)
        add(f"lower_rod{k}", "crank", pin, 0.619)
        add(f"shoulder{k}", "base", hinge, 0.415)
        add(f"link{k}", "base", hinge, 0.393)
        add(f"thigh{k}", f"shoulder{k}", upper_far, 0.394)
        add(f"foot{k}", f"thigh{k}", _shift(0.394), 0.367)
        ends = (
            (f"upper_rod{k}", 0.5, f"shoulder{k}", 0.415),
            (f"lower_rod{k}", 0.619, f"link{k}", 0.393),
            (f"foot{k}", 0.367, f"link{k}", 0.393),
        )
        closures += [
            LoopClosure(f"loop{k}_{i}", "revolute", a, b, _shift(x), _shift(y)) for i, (a, x, b, y) in enumerate(ends)
        ]
        links[-1] = Link(f"foot{k}", Inertia(0.5, 0.5 * lower_far[:3, 3], 0.01 * np.eye(3)))
    return MechanismDescription(
        f"walker {legs}", "base", tuple(links), tuple(joints), tuple(closures), actuated=("shaft",)
    )


def _triangle(along, other, far):
    """The third corner of a triangle whose first side, of length `along`, lies on x; `other` starts at the origin."""
    x = (along**2 + other**2 - far**2) / (2.0 * along)
    return _at(x, np.sqrt(other**2 - x**2))


def _at(x, y):
    placement = np.eye(4)
    placement[:2, 3] = x, y
    return placement


def _turn(angle):
    placement = np.eye(4)
    c, s = np.cos(angle), np.sin(angle)
    placement[:2, :2] = [[c, -s], [s, c]]
    return placement


def parallel_bars(bars=3):
    """A coupler carried by equal, parallel cranks: one loop a crank beyond the first two is superfluous."""
    links, joints, closures = [Link("base", _bar(1.0)), Link("coupler", _bar(1.0))], [], []
    for k in range(bars):
        links.append(Link(f"crank{k}", _bar(0.4)))
        joints.append(Joint(f"foot{k}", "revolute", "base", f"crank{k}", _at(0.35 * k, 0.1 * k * k), Z))
        if k:
            ends = _at(0.35 * k, 0.1 * k * k), _shift(0.4)
            closures.append(LoopClosure(f"pin{k}", "revolute", "coupler", f"crank{k}", *ends))
    joints.append(Joint("head", "revolute", "crank0", "coupler", _shift(0.4), Z))
    reference = {f"foot{k}": (0.9,) for k in range(bars)} | {"head": (-0.9,)}
    return MechanismDescription(
        f"{bars} bars", "base", tuple(links), tuple(joints), tuple(closures), actuated=("foot0",), reference=reference
    )


def welded_four_bar():
    """A four-bar of four revolute joints, cut through its coupler and welded there: six rows, of which three count."""
    four_bar = serial(1)
    coupler, rocker = four_bar_angles()
    pin = Joint("knee", "revolute", "rocker0", "half", _shift(ROCKER), Z)
    weld = LoopClosure("weld", "fixed", "coupler0", "half", _shift(0.5 * COUPLER), _shift(-0.5 * COUPLER))
    return MechanismDescription(
        "welded four-bar",
        "base",
        (*four_bar.links, Link("half", _bar(0.1))),
        (*four_bar.joints, pin),
        (weld,),
        actuated=("crank_joint0",),
        reference={**four_bar.reference, "knee": (START + coupler - rocker,)},
    )


def spherical_four_bar():
    """Four revolute joints whose axes meet in a point, with the closure's frames away from it."""
    arcs = np.radians([25.0, 70.0, 55.0, 80.0])
    links, joints = [Link("base", _bar(0.3))], []
    for name, parent, arc in (("a", "base", 0.0), ("b", "a", arcs[0]), ("c", "base", arcs[3])):
        links.append(Link(name, _bar(0.3)))
        axis = np.array([np.sin(arc), 0.0, np.cos(arc)])
        joints.append(Joint(f"joint_{name}", "revolute", parent, name, np.eye(4), axis))
    ends = [_about_y(arcs[0] + arcs[1]) @ _shift(0.2, axis=2), _about_y(arcs[3] - arcs[2]) @ _shift(0.2, axis=2)]
    closure = LoopClosure("cap", "revolute", "b", "c", *ends)
    return MechanismDescription(
        "spherical four-bar", "base", tuple(links), tuple(joints), (closure,), actuated=("joint_a",)
    )


def _about_y(angle):
    placement, (c, s) = np.eye(4), (np.cos(angle), np.sin(angle))
    placement[:3, :3] = [[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]
    return placement


_LEG = ("arm", "bracket", "rod", "twin", "foot", "heel")


def revolute_delta():
    """A Delta whose legs are all revolute joints, parallelograms cut at a corner and feet pinned: many rows agree."""
    upper, lower, base, platform, half = 0.3, 0.8, 0.2, 0.05, 0.05
    links, joints, closures = [Link("base", _bar(0.3))], [], []
    y = np.array([0.0, 1.0, 0.0])
    angle = 0.3
    # in a leg's plane: knee at base + upper cos, −upper sin; foot below at platform, and its height by Pythagoras
    knee = np.array([base + upper * np.cos(angle), -upper * np.sin(angle)])
    drop = np.sqrt(lower**2 - (knee[0] - platform) ** 2)
    fall = np.arctan2(drop, platform - knee[0])
    reference = {}
    for k in range(3):
        turn = _turn(2.0 * np.pi * k / 3.0)
        arm, bracket, rod, twin, foot, heel = names = [f"{part}{k}" for part in _LEG]
        links += [Link(name, _bar(0.2)) for name in names]
        joints += [
            Joint(f"motor{k}", "revolute", "base", arm, turn @ _shift(base), y),
            Joint(f"knee{k}", "revolute", arm, bracket, _shift(upper), y),
            Joint(f"left{k}", "revolute", bracket, rod, _shift(half, axis=1), Z),
            Joint(f"right{k}", "revolute", bracket, twin, _shift(-half, axis=1), Z),
            Joint(f"low{k}", "revolute", rod, foot, _shift(lower), Z),
            Joint(f"ankle{k}", "revolute", foot, heel, _shift(-half, axis=1), y),
        ]
        closures.append(LoopClosure(f"bars{k}", "revolute", foot, twin, _shift(-2 * half, axis=1), _shift(lower)))
        reference |= {f"motor{k}": (angle,), f"knee{k}": (fall - angle,), f"ankle{k}": (-fall,)}
        if k:
            centre = _shift(-platform)
            ends = centre, centre @ _turn(-2.0 * np.pi * k / 3.0)
            closures.append(LoopClosure(f"platform{k}", "fixed", "heel0", heel, *ends))
    return MechanismDescription(
        "revolute Delta",
        "base",
        tuple(links),
        tuple(joints),
        tuple(closures),
        actuated=tuple(f"motor{k}" for k in range(3)),
        reference=reference,
    )
