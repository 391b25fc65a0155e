"""Mechanisms whose rods are distance closures: what a certificate puts its own rods into."""

from dataclasses import replace

import numpy as np

from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Inertia, Joint, Link, read_description
from tests.support.walkthrough import file

Y, Z = np.eye(3)[1:]


def _at(*position):
    placement = np.eye(4)
    placement[:3, 3] = position
    return placement


def _body(mass, *com):
    return Inertia(mass, np.array(com), 1e-3 * np.eye(3))


FOUR_BAR = 0.25, 0.7, 0.5, 0.6
"""Crank, ground, rocker and rod in metres."""


def rod_four_bar(skew=0.0):
    """A crank and a rocker in the vertical plane, joined by a rod; `skew` moves the rocker's end out of the plane."""
    crank, ground, rocker, rod = FOUR_BAR
    links = (Link("base"), Link("crank", _body(1.0, crank / 2, 0, 0)), Link("rocker", _body(2.0, rocker / 2, 0, 0)))
    joints = (
        Joint("crank", "revolute", "base", "crank", axis=Y),
        Joint("rocker", "revolute", "base", "rocker", _at(ground, 0, 0), axis=Y),
    )
    ends = _at(crank, 0.0, 0.0), _at(rocker, skew, 0.0)
    loop = LoopClosure("rod", "distance", "crank", "rocker", *ends, length=float(np.hypot(rod, skew)))
    reference = {"crank": (-1.0,), "rocker": (rocker_angle(-1.0),)}
    return MechanismDescription(
        "rod_four_bar", "base", links, joints, (loop,), independent=("crank",), actuated=("crank",), reference=reference
    )


def rocker_angle(crank_angle, side=-1.0):
    """The rocker's angle about y in closed form: where circles about the crank's end and the rocker's pin meet."""
    crank, ground, rocker, rod = FOUR_BAR
    end = crank * np.array([np.cos(crank_angle), -np.sin(crank_angle)])
    to_end = end - [ground, 0.0]
    reach = np.hypot(*to_end)
    inner = (rocker**2 + reach**2 - rod**2) / (2 * rocker * reach)
    if abs(inner) > 1:
        return np.nan
    pointing = np.arctan2(to_end[1], to_end[0]) + side * np.arccos(inner)
    return float(np.remainder(np.pi - pointing, 2 * np.pi) - np.pi)


def rod_stewart(kind="slides"):
    """A platform that floats on six rods from carriages on vertical slides (or from cranks) at its base."""
    links, joints, loops = [Link("base"), Link("platform", _body(5.0, 0, 0, 0))], [], []
    joints.append(Joint("platform", "floating", "base", "platform", _at(0, 0, 0.6)))
    for k in range(6):
        around = 2 * np.pi * (k // 2) / 3 + (0.2 if k % 2 else -0.2)
        above = 2 * np.pi * (k // 2) / 3 + (0.8 if k % 2 else -0.8)
        foot, head = 0.4 * np.array([np.cos(around), np.sin(around)]), 0.2 * np.array([np.cos(above), np.sin(above)])
        links.append(Link(f"drive{k}", _body(0.5, 0, 0, 0)))
        if kind == "slides":
            place, end, axis = _at(*foot, 0.0), _at(0, 0, 0), Z
        else:
            place, end, axis = (
                _at(*foot, 0.0),
                _at(0.1 * np.cos(around), 0.1 * np.sin(around), 0),
                np.array([-np.sin(around), np.cos(around), 0.0]),
            )
        joints.append(
            Joint(f"drive{k}", "prismatic" if kind == "slides" else "revolute", "base", f"drive{k}", place, axis=axis)
        )
        length = float(np.linalg.norm([*(head - foot - end[:2, 3]), 0.6]))
        loops.append(LoopClosure(f"rod{k}", "distance", f"drive{k}", "platform", end, _at(*head, 0), length=length))
    drives = tuple(f"drive{k}" for k in range(6))
    return MechanismDescription(
        f"stewart_{kind}",
        "base",
        tuple(links),
        tuple(joints),
        tuple(loops),
        independent=drives,
        actuated=drives,
    )


def rod_ankle():
    """The two-rod ankle of the walkthrough, its rods distances of 0.26 m between the cranks' ends and the heels."""
    described = read_description(file("ankle"))
    gone = ("left_rod", "right_rod", "right_knuckle")
    loops = tuple(
        LoopClosure(
            f"{side}_rod", "distance", f"{side}_crank", "foot", _at(-0.05, 0, 0), _at(-0.05, y, -0.01), length=0.26
        )
        for side, y in (("left", 0.04), ("right", -0.04))
    )
    return replace(
        described,
        links=tuple(link for link in described.links if link.name not in gone),
        joints=tuple(joint for joint in described.joints if joint.child not in gone),
        closures=loops,
    )
