"""Mechanisms to start from, of a few lengths: five-bar, Delta, Gough–Stewart platform, two-rod ankle, four-bar knee.

Bars are solid aluminium cylinders whose radius is a thirtieth of their length, platforms aluminium discs whose
thickness is a tenth of their radius, with the masses and inertias that these have. A motor may give ten times what
would hold all of the mechanism's weight at its longest length. Each draft stands at a closed reference, at usual
lengths well away from singular configurations; motors have limits a radian, or a third of a leg, either way of it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from math import acos, atan2, cos, hypot, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array
from ccpin.description.model import (
    Inertia,
    Joint,
    Link,
    LoopClosure,
    MechanismDescription,
    Shape,
    Visual,
    frame,
    frame_from_rpy,
    rotation_to,
)
from ccpin.description.names import choices
from ccpin.errors import InvalidInputError

DENSITY = 2700.0  # kg/m³, aluminium
_SLIM, _FLAT = 30.0, 10.0  # length of a bar over its radius, radius of a disc over its thickness
_BRISK = 10.0  # what a motor may give over what holds the weight
_GRAVITY, _SPEED = 9.81, 10.0  # m/s², rad/s
X, Y, Z = np.eye(3)


class Draft(NamedTuple):
    """A kind of mechanism: what it is, its lengths with their usual values (m), and what draws it up from them."""

    what: str
    lengths: Mapping[str, float]
    build: Callable[..., MechanismDescription]


def drafted(kind: str, lengths: Mapping[str, float] | None = None) -> MechanismDescription:
    """A mechanism of a kind of `DRAFTS`; lengths left out are the usual ones.

    Raises:
        InvalidInputError: There is no such kind or length, a length is not positive, or it cannot close with them.
    """
    if kind not in DRAFTS:
        raise InvalidInputError(f"there is no draft '{kind}'; {choices(kind, DRAFTS)}")
    usual = DRAFTS[kind].lengths
    for name, value in (lengths or {}).items():
        if name not in usual:
            raise InvalidInputError(f"a {kind} has no length '{name}'; {choices(name, usual)}")
        if not 0.0 < value < 100.0:
            raise InvalidInputError(f"length {name} = {value:g} m of a {kind} must be above 0 and below 100 m")
    stated = {**usual, **(lengths or {})}
    return _with_efforts(DRAFTS[kind].build(**stated), max(stated.values()))


def _with_efforts(description: MechanismDescription, longest: float) -> MechanismDescription:
    """The same with limits of effort on the motors' joints, N m or N."""
    weight = _GRAVITY * sum(link.inertia.mass for link in description.links if link.inertia)
    efforts = {"revolute": _BRISK * weight * longest, "prismatic": _BRISK * weight}
    motors = description.actuated or ()
    joints = [replace(j, effort=efforts[j.kind]) if j.name in motors else j for j in description.joints]
    return replace(description, joints=tuple(joints))


def _bar(name: str, length: float, axis: Array, back: bool = False) -> Link:
    """A bar from the link's origin along an axis of its frame, or back from it."""
    r = length / _SLIM
    mass, middle = DENSITY * pi * r * r * length, (-0.5 if back else 0.5) * length * axis
    across, along = mass * (3 * r * r + length * length) / 12, mass * r * r / 2
    inertia = Inertia(mass, middle, across * np.eye(3) + (along - across) * np.outer(axis, axis))
    return Link(name, inertia, (Visual(Shape("cylinder", (r, length)), frame(middle, rotation_to(axis))),))


def _disc(name: str, radius: float) -> Link:
    """A horizontal disc about the link's origin."""
    height = radius / _FLAT
    mass = DENSITY * pi * radius * radius * height
    across = mass * (3 * radius * radius + height * height) / 12
    inertia = Inertia(mass, np.zeros(3), np.diag([across, across, mass * radius * radius / 2]))
    return Link(name, inertia, (Visual(Shape("cylinder", (radius, height))),))


def _turning(name: str, parent: str, child: str, placement: Array, axis: Array, at: float = 0.0) -> Joint:
    """A revolute joint that may turn a radian either way from where it stands, and that nothing drives yet."""
    return Joint(name, "revolute", parent, child, placement, axis, at - 1.0, at + 1.0, 0.0, _SPEED)


def _ball(name: str, a: tuple[str, ArrayLike], b: tuple[str, ArrayLike]) -> LoopClosure:
    """Points of two links that coincide."""
    return LoopClosure(name, "spherical", a[0], b[0], frame(a[1]), frame(b[1]))


def _five_bar(base: float, arm: float, forearm: float) -> MechanismDescription:
    """Two arms in the x-z plane that meet: 5R, driven at the base. Angles grow from +x towards +z.

    Symmetric: elbows at x = ±e, e in the middle of what arm and forearm allow, |base/2 − e| < arm and e < forearm.
    """
    low, high = max(base / 2 - arm, 0.0), min(base / 2 + arm, forearm)
    if low >= high:
        raise InvalidInputError(
            f"a five-bar closes with arm + forearm > base / 2 only: {arm:g} + {forearm:g} m are less"
        )
    e = (low + high) / 2
    theta = acos((base / 2 - e) / arm)  # of the left arm; the right one mirrored
    phi = acos(e / forearm)  # of the left forearm
    left, right = (theta, phi - theta), (pi - theta, theta - phi)
    links, joints, reference = [Link("base")], list[Joint](), dict[str, tuple[float, ...]]()
    for side, x, (at, bend) in (("left", -base / 2, left), ("right", base / 2, right)):
        links += [_bar(f"{side}_arm", arm, X), _bar(f"{side}_forearm", forearm, X)]
        joints.append(_turning(f"{side}_motor", "base", f"{side}_arm", frame([x, 0, 0]), -Y, at))
        elbow = _turning(f"{side}_elbow", f"{side}_arm", f"{side}_forearm", frame([arm, 0, 0]), -Y, bend)
        joints.append(replace(elbow, lower=bend - 2.0, upper=bend + 2.0))
        reference |= {f"{side}_motor": (at,), f"{side}_elbow": (bend,)}
    tip = frame([forearm, 0, 0], rotation_to(Y))
    pin = LoopClosure("tip", "revolute", "left_forearm", "right_forearm", tip, tip)
    return _whole("five_bar", links, joints, [pin], reference, ["left_motor", "right_motor"])


def _delta(base: float, arm: float, forearm: float, platform: float, width: float) -> MechanismDescription:
    """Clavel's: three arms at `base` from the axis, horizontal, six rods in pairs, `width` apart, a platform below."""
    across = base + arm - platform
    if abs(across) >= forearm:
        raise InvalidInputError(
            f"a delta hangs from horizontal arms with forearm > |base + arm - platform| only: {forearm:g} m is not "
            f"above {abs(across):g} m"
        )
    depth = sqrt(forearm**2 - across**2)
    pitch = atan2(depth, -across)  # of the rods, from the arm's direction downwards
    links, joints, closures = [Link("base"), _disc("platform", platform)], list[Joint](), list[LoopClosure]()
    joints.append(Joint("platform_pose", "floating", "base", "platform"))
    reference: dict[str, tuple[float, ...]] = {"platform_pose": (0, 0, -depth, 0, 0, 0, 1)}
    for k in range(3):
        leg = f"{k + 1}"
        turned = frame_from_rpy((0, 0, 0), (0, 0, 2 * pi * k / 3))
        links.append(_bar(f"arm{leg}", arm, X))
        joints.append(_turning(f"motor{leg}", "base", f"arm{leg}", turned @ frame([base, 0, 0]), Y))
        for side, y in (("a", width / 2), ("b", -width / 2)):
            rod = f"rod{leg}{side}"
            links += [Link(f"{rod}_cross"), _bar(rod, forearm, X)]
            joints.append(_turning(f"{rod}_pitch", f"arm{leg}", f"{rod}_cross", frame([arm, y, 0]), Y, pitch))
            joints.append(_turning(f"{rod}_swing", f"{rod}_cross", rod, frame([0, 0, 0]), Z))
            reference[f"{rod}_pitch"] = (pitch,)
            anchor = (turned @ [platform, y, 0, 1])[:3]
            closures.append(_ball(f"{rod}_ball", (rod, (forearm, 0, 0)), ("platform", anchor)))
    return _whole("delta", links, joints, closures, reference, ["motor1", "motor2", "motor3"])


def _stewart(base: float, platform: float, height: float) -> MechanismDescription:
    """Gough's and Stewart's 6-UPS: feet and anchors in pairs 30° apart, those of the platform turned by 60°."""
    apart = pi / 12
    pairs = [
        (2 * pi * k / 3 + side * (pi / 3 - apart), 2 * pi * k / 3 + side * apart) for k in range(3) for side in (1, -1)
    ]
    links, joints, closures = [Link("base"), _disc("platform", platform)], list[Joint](), list[LoopClosure]()
    joints.append(Joint("platform_pose", "floating", "base", "platform"))
    reference: dict[str, tuple[float, ...]] = {"platform_pose": (0, 0, height, 0, 0, 0, 1)}
    for k, (below, above) in enumerate(pairs, start=1):
        foot = np.array([base * cos(below), base * sin(below), 0.0])
        anchor = np.array([platform * cos(above), platform * sin(above), 0.0])
        way = anchor + height * Z - foot
        length = float(np.linalg.norm(way))
        leg = f"leg{k}"
        links += [
            Link(f"{leg}_cross"),
            _bar(f"{leg}_cylinder", 0.6 * length, Z),
            _bar(f"{leg}_piston", 0.6 * length, Z, True),
        ]
        upright = frame(foot, rotation_to(way / length))
        joints.append(_turning(f"{leg}_roll", "base", f"{leg}_cross", upright, X))
        joints.append(_turning(f"{leg}_pitch", f"{leg}_cross", f"{leg}_cylinder", frame([0, 0, 0]), Y))
        slide = Joint(leg, "prismatic", f"{leg}_cylinder", f"{leg}_piston", frame([0, 0, length]), Z)
        joints.append(replace(slide, lower=-length / 3, upper=length / 3, velocity=length))
        closures.append(_ball(f"{leg}_ball", (f"{leg}_piston", (0, 0, 0)), ("platform", anchor)))
    return _whole("stewart", links, joints, closures, reference, [f"leg{k}" for k in range(1, 7)])


def _ankle(shank: float, crank: float, heel: float, width: float) -> MechanismDescription:
    """A foot on a cross (pitch, then roll), pushed at the heel by two cranks up the shank through two rods."""
    links, joints, closures = (
        [Link("shank"), Link("cross"), _bar("foot", 4 * heel, X)],
        list[Joint](),
        list[LoopClosure](),
    )
    joints.append(_turning("pitch", "shank", "cross", frame([0, 0, 0]), Y))
    joints.append(_turning("roll", "cross", "foot", frame([0, 0, 0]), X))
    rod = hypot(crank - heel, shank)
    for side, y in (("left", width / 2), ("right", -width / 2)):
        links += [_bar(f"{side}_crank", crank, X, True), Link(f"{side}_knuckle"), _bar(f"{side}_rod", rod, Z)]
        joints.append(_turning(f"{side}_motor", "shank", f"{side}_crank", frame([0, y, shank]), Y))
        down = rotation_to(np.array([crank - heel, 0.0, -shank]) / rod)
        joints.append(_turning(f"{side}_swing", f"{side}_crank", f"{side}_knuckle", frame([-crank, 0, 0], down), Y))
        joints.append(_turning(f"{side}_lean", f"{side}_knuckle", f"{side}_rod", frame([0, 0, 0]), X))
        closures.append(_ball(f"{side}_heel", (f"{side}_rod", (0, 0, rod)), ("foot", (-heel, y, 0))))
    return _whole("ankle", links, joints, closures, {}, ["left_motor", "right_motor"])


def _knee(thigh: float, crank: float, lever: float, shank: float) -> MechanismDescription:
    """A four-bar in the x-z plane: a crank up the thigh pulls a lever behind the knee through a rod.

    Crank and lever stand horizontally behind motor and knee at zero; angles grow from +x towards −z.
    """
    rod = hypot(crank - lever, thigh)
    down = frame_from_rpy((-crank, 0.0, 0.0), (0.0, atan2(crank - lever, -thigh), 0.0))
    links = [Link("thigh"), _bar("shank", shank, Z, True), _bar("crank", crank, X, True), _bar("rod", rod, Z)]
    joints = [
        _turning("knee", "thigh", "shank", frame([0, 0, -thigh]), Y),
        _turning("motor", "thigh", "crank", frame([0, 0, 0]), Y),
        _turning("rod_swing", "crank", "rod", down, Y),
    ]
    along = rotation_to(Y)
    pin = LoopClosure("lever", "revolute", "rod", "shank", frame([0, 0, rod], along), frame([-lever, 0, 0], along))
    return _whole("knee", links, joints, [pin], {}, ["motor"])


def _whole(
    name: str,
    links: list[Link],
    joints: list[Joint],
    closures: list[LoopClosure],
    reference: Mapping[str, tuple[float, ...]],
    motors: list[str],
) -> MechanismDescription:
    at_rest = {joint.name: (0.0,) for joint in joints if joint.kind != "floating"}
    return MechanismDescription(
        *(name, links[0].name, tuple(links), tuple(joints), tuple(closures)),
        independent=tuple(motors),
        actuated=tuple(motors),
        reference={**at_rest, **reference},
    )


DRAFTS: dict[str, Draft] = {
    "five-bar": Draft("planar 5R, two motors at the base", {"base": 0.2, "arm": 0.25, "forearm": 0.35}, _five_bar),
    "delta": Draft(
        "three arms, a platform that keeps level",
        {"base": 0.16, "arm": 0.25, "forearm": 0.6, "platform": 0.05, "width": 0.08},
        _delta,
    ),
    "stewart": Draft("six legs of controlled length", {"base": 0.4, "platform": 0.25, "height": 0.45}, _stewart),
    "ankle": Draft(
        "a foot moved by two cranks and rods", {"shank": 0.25, "crank": 0.05, "heel": 0.05, "width": 0.08}, _ankle
    ),
    "knee": Draft(
        "a four-bar: a crank bends a knee", {"thigh": 0.35, "crank": 0.06, "lever": 0.05, "shank": 0.35}, _knee
    ),
}
"""What there is to start from."""
