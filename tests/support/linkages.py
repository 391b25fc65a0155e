"""Linkages that move through singularities of their coordinates: what coordinates that follow a motion are tried on."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Inertia, Joint, Link, read_description
from tests.support.places import MODELS

Z = np.array([0.0, 0.0, 1.0])

FIVE_BAR = """<mujoco model="five-bar"><compiler angle="radian"/><worldbody>
  <body name="left"><joint name="left" axis="0 -1 0"/><geom type="capsule" fromto="0 0 0 -0.1 0 -0.2" size="0.01"/>
    <body name="left2" pos="-0.1 0 -0.2"><joint name="left_elbow" axis="0 -1 0"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 -0.25" size="0.01"/></body></body>
  <body name="right" pos="0.2 0 0"><joint name="right" axis="0 -1 0"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 -0.2" size="0.01"/>
    <body name="right2" pos="0.1 0 -0.2"><joint name="right_elbow" axis="0 -1 0"/>
      <geom type="capsule" fromto="0 0 0 -0.2 0 -0.25" size="0.01"/></body></body>
</worldbody><equality><connect body1="left2" body2="right2" anchor="0.2 0 -0.25"/></equality>
<actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>
"""
"""A five-bar with two motors at its base, as MJCF."""

UPPER, LOWER = (0.8, 0.4, 0.01), (0.5, 0.3, 0.004)
"""Of the bars below: mass, length (the centre of mass is half way) and moment of inertia about that centre."""
HUNG_BAR = """<mujoco model="hung_bar"><worldbody>
  <body name="upper"><joint name="swing" axis="0 1 0"/>
    <inertial pos="0.2 0 0" mass="0.8" diaginertia="0.01 0.01 0.01"/></body>
  <body name="lower" pos="0.4 0 0">
    <joint name="along" type="slide" axis="1 0 0"/><joint name="height" type="slide" axis="0 0 1"/>
    <joint name="turn" axis="0 1 0"/><inertial pos="0.15 0 0" mass="0.5" diaginertia="0.004 0.004 0.004"/></body>
</worldbody><equality><connect body1="upper" body2="lower" anchor="0.4 0 0"/></equality></mujoco>
"""
"""A double pendulum as MuJoCo's own tests of `connect` have it: the lower bar free in its plane, pinned to it."""


def rssr():
    """A spatial four-bar: a crank, a rod on two ball joints, a rocker about an axis across the crank's."""
    tip, start = np.array([0.15, 0.0, 0.0]), np.array([0.6, 0.1, -0.05])
    rocker, rocker_tip = start, start + [0.0, 0.0, 0.4]
    rod = rocker_tip - tip
    return MechanismDescription(
        "rssr",
        "base",
        (Link("base"), _rod("crank", tip), _rod("rod", rod), _rod("rocker", rocker_tip - rocker)),
        (
            Joint("crank", "revolute", "base", "crank", axis=Z),
            Joint("ball", "spherical", "crank", "rod", _at(tip)),
            Joint("rocker", "revolute", "base", "rocker", _at(rocker), axis=np.array([0.0, 1.0, 0.0])),
        ),
        (LoopClosure("loop", "spherical", "rod", "rocker", _at(rod), _at(rocker_tip - rocker)),),
        actuated=("crank",),
    )


def stewart_on_balls():
    """The Stewart platform of `models/` with its three concurrent revolutes as the one ball joint they stand for."""
    described = read_description(MODELS / "stewart.urdf")
    gone = ("platform_pitch", "platform_roll", "platform_yaw")
    joints = {joint.name: joint for joint in described.joints}
    place = joints[gone[0]].placement @ joints[gone[1]].placement @ joints[gone[2]].placement
    ball = Joint("platform_ball", "spherical", joints[gone[0]].parent, joints[gone[2]].child, place)
    lost = {joints[name].child for name in gone[:2]}
    return replace(
        described,
        joints=(*(joint for joint in described.joints if joint.name not in gone), ball),
        links=tuple(link for link in described.links if link.name not in lost),
        reference={name: pose for name, pose in described.reference.items() if name not in gone},
    )


class Bar(NamedTuple):
    """A bar between two points of a linkage."""

    name: str
    start: str
    end: str


_JANSEN = {"b": 0.415, "c": 0.393, "d": 0.401, "e": 0.558, "f": 0.394, "g": 0.367, "h": 0.657, "i": 0.490, "j": 0.50}
_JANSEN |= {"k": 0.619, "m": 0.15}
_PIVOT = np.array([-0.38, -0.078])
"""The leg of Theo Jansen's Strandbeest, its thirteen published lengths ('holy numbers') in units of 100 mm."""


def strandbeest():
    """A pair of Jansen's legs on one crank, driven through a drag link, on a floating frame: eleven coupled loops.

    Every triangle is three bars with pins between them, as the beasts are built. n = 1 + 6.
    """
    points = {"O": np.zeros(2), "A": _JANSEN["m"] * np.array([np.cos(0.7), np.sin(0.7)])}
    bars, pins = [Bar("crank", "O", "A")], [("O", "base", "crank")]
    for side, mirror in (("l", 1.0), ("r", -1.0)):
        _add_leg(side, mirror, points, bars, pins)
    _add_drag_link(points, bars, pins)
    return _linkage("strandbeest", points, bars, pins)


def _add_leg(side, mirror, points, bars, pins):
    """One leg: rods j, k, c, f and the triangles b-d-e and g-h-i, with five loops."""
    n, flip = _JANSEN, np.array([mirror, 1.0])
    pivot, crank = _PIVOT, points["A"] * flip
    upper = _meet(crank, n["j"], pivot, n["b"], left=False)
    lower = _meet(crank, n["k"], pivot, n["c"], left=True)
    back = _meet(upper, n["e"], pivot, n["d"], left=False)
    knee = _meet(back, n["f"], lower, n["g"], left=False)
    foot = _meet(knee, n["h"], lower, n["i"], left=False)
    for name, point in (("P", pivot), ("U", upper), ("L", lower), ("D", back), ("K", knee), ("F", foot)):
        points[name + side] = point * flip
    for name, ends in zip("jkbcdefghi", ("AU", "AL", "PU", "PL", "PD", "UD", "DK", "LK", "KF", "LF"), strict=True):
        bars.append(Bar(name + side, *(end if end == "A" else end + side for end in ends)))
    hinges = (
        "A-crank-j A-crank-k P-base-b P-base-c P-base-d U-b-j U-b-e D-d-e D-d-f L-c-k L-c-g L-c-i K-g-f K-g-h F-i-h"
    )
    for hinge in hinges.split():
        pins.append(tuple(name if name in ("A", "crank", "base") else name + side for name in hinge.split("-")))


def _add_drag_link(points, bars, pins):
    """A motor's crank that drags the legs' crank along: each turns fully, as the ground between them is shortest."""
    points["M"] = np.array([0.06, 0.02])
    points["N"] = points["M"] + 0.2 * np.array([np.cos(1.9), np.sin(1.9)])
    bars += [Bar("motor", "M", "N"), Bar("drag", "N", "A")]
    pins += [("M", "base", "motor"), ("N", "motor", "drag"), ("A", "drag", "crank")]


def _linkage(name, points, bars, pins):
    """A planar linkage in the x-y plane of a floating frame: a spanning tree of its pins, closures for the rest.

    All frames are parallel to the world's at the reference, each link's at the pin that carries it.
    """
    origin, joints, closures, left = {"base": np.zeros(2)}, [], [], list(pins)
    while left:
        pin = next(pin for pin in left if origin.keys() & pin[1:])
        left.remove(pin)
        point, one, other = pin if pin[1] in origin else (pin[0], pin[2], pin[1])
        here = points[point]
        if other in origin:
            places = [_at(np.append(here - origin[body], 0.0)) for body in (one, other)]
            closures.append(LoopClosure("_".join(pin), "revolute", one, other, *places))
        else:
            place = _at(np.append(here - origin[one], 0.0))
            joints.append(Joint("_".join(pin), "revolute", one, other, place, axis=Z))
            origin[other] = here
    links = [Link("base", Inertia(2.0, np.zeros(3), 0.04 * np.eye(3)))]
    for bar in bars:
        ends = [np.append(points[point] - origin[bar.name], 0.0) for point in (bar.start, bar.end)]
        links.append(_rod(bar.name, ends[1], ends[0]))
    return MechanismDescription(name, "base", tuple(links), tuple(joints), tuple(closures), actuated=("M_base_motor",))


def _meet(p, r, q, s, *, left):
    """Where circles about p and q of radii r and s meet, left or right of the way from p to q."""
    way = q - p
    distance = np.hypot(*way)
    along = (distance**2 + r**2 - s**2) / (2 * distance)
    height = np.sqrt(r**2 - along**2) * (1 if left else -1)
    return p + (along * way + height * np.array([-way[1], way[0]])) / distance


def _at(position):
    placement = np.eye(4)
    placement[:3, 3] = position
    return placement


def _rod(name, end, start=(0.0, 0.0, 0.0)):
    """A round bar of 1 kg/m and 20 mm between two points."""
    start, way = np.asarray(start), np.asarray(end) - start
    length = float(np.linalg.norm(way))
    across = np.eye(3) - np.outer(way, way) / length**2
    return Link(name, Inertia(length, start + way / 2, length * (across * length**2 / 12 + 5e-5 * np.eye(3))))
