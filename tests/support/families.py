"""Families of planar mechanisms of any size: n four-bars, each carried by the last one's rocker or all by one base."""

import numpy as np

from ccpin.description import Inertia, Joint, Link, LoopClosure, MechanismDescription

Z = np.array([0.0, 0.0, 1.0])
CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.8, 0.6, 0.7
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
