"""Mechanisms whose base parameters others have published, by their frames: modified Denavit-Hartenberg rows.

Four-bars, a swinging cylinder and palletizers are those of SchapplM/robsynth-serhybroblib on GitHub (Leibniz
Universität Hannover; `systems/*/codegen/robot_env_*`); lengths are ours.
"""

import numpy as np

from ccpin import LoopClosure, MechanismDescription
from ccpin.description import Coupling, CouplingTerm, Inertia, Joint, Link

BODY = Inertia(1.0, np.array([0.1, 0.02, 0.03]), np.diag([0.02, 0.03, 0.04]))
QUARTER = 0.5 * np.pi
BARS, PARALLELOGRAM = (1.0, 0.3, 0.8, 0.7), (1.0, 0.5, 1.0, 0.5)  # m: ground, crank, coupler, rocker


def turned(axis, angle):
    """A 4×4 turn about x or z, exact at quarters."""
    frame, (i, j) = np.eye(4), {"x": (1, 2), "z": (0, 1)}[axis]
    frame[i, i] = frame[j, j] = np.round(np.cos(angle), 15)
    frame[i, j], frame[j, i] = -np.round(np.sin(angle), 15), np.round(np.sin(angle), 15)
    return frame


def moved(x=0.0, z=0.0):
    """A 4×4 shift along x and z."""
    frame = np.eye(4)
    frame[0, 3], frame[2, 3] = x, z
    return frame


def row(name, parent, alpha=0.0, a=0.0, d=0.0, theta=0.0, kind="revolute"):
    """A joint that carries the body of its name, about or along its z axis."""
    place = turned("x", alpha) @ moved(a, d) @ turned("z", theta)
    return Joint(name, kind, parent, f"{name}_body", place, np.array([0.0, 0.0, 1.0]))


def described(name, joints, closures=(), couplings=(), actuated=None, reference=None):
    """The description of these joints."""
    links = (Link("base"), *(Link(joint.child, BODY) for joint in joints))
    return MechanismDescription(
        name,
        "base",
        links,
        tuple(joints),
        tuple(closures),
        tuple(couplings),
        actuated=actuated,
        reference={name: (float(value),) for name, value in (reference or {}).items()},
    )


def summed(name, joints):
    """A coupling that keeps a sum of angles, as parallelograms of rods without mass do."""
    return Coupling(name, tuple(CouplingTerm(joint, (0.0, 1.0)) for joint in joints))


def four_bar(lengths, crank=1.0, turntable=False):
    """`fourbar1` (`fourbar2` where it is a parallelogram), `fourbar1turn` on a turntable."""
    ground, l2, l3, l4 = lengths
    to_foot = np.array([ground, 0.0]) - l2 * np.array([np.cos(crank), np.sin(crank)])
    reach = np.hypot(*to_foot)
    inner = np.arccos((reach**2 + l3**2 - l4**2) / (2.0 * reach * l3))
    coupler = np.arctan2(to_foot[1], to_foot[0]) + inner
    pin = l3 * np.array([np.cos(coupler), np.sin(coupler)]) - to_foot
    on, up = ("turn_body", QUARTER) if turntable else ("base", 0.0)
    joints = [row("turn", "base", d=0.2)] if turntable else []
    joints += [row("crank", on, up), row("coupler", "crank_body", a=l2), row("rocker", on, up, a=ground)]
    return described(
        "four_bar",
        joints,
        [LoopClosure("pin", "revolute", "coupler_body", "rocker_body", moved(l3), moved(l4))],
        actuated=("turn", "crank") if turntable else ("crank",),
        reference={"crank": crank, "coupler": coupler - crank, "rocker": np.arctan2(pin[1], pin[0])},
    )


def swinging_cylinder(foot=1.0, bar=0.6, rod=0.2, angle=2.0):
    """`fourbarpris`: a cylinder that swings about one pin and turns a bar about another."""
    end = bar * np.array([np.cos(np.pi + angle), np.sin(np.pi + angle)]) - [foot, 0.0]
    joints = [
        row("swing", "base", a=foot, theta=np.pi),
        row("slide", "swing_body", -QUARTER, kind="prismatic"),
        row("bar", "base", theta=np.pi),
    ]
    return described(
        "cylinder",
        joints,
        [LoopClosure("pin", "revolute", "slide_body", "bar_body", moved(z=rod) @ turned("x", QUARTER), moved(bar))],
        actuated=("slide",),
        reference={
            "bar": angle,
            "swing": np.arctan2(end[1], end[0]) - 1.5 * np.pi,
            "slide": np.hypot(*end) - rod,
        },
    )


ARM = {"a2": 0.2, "a3": 0.9, "a4": 1.1, "a5": 0.15, "d1": 0.5, "d5": 0.3}


def palletizer():
    """`palh2m1`: four axes, the hand kept level by rods without mass."""
    joints = [
        row("q1", "base", d=ARM["d1"]),
        row("q2", "q1_body", -QUARTER, ARM["a2"]),
        row("q3", "q2_body", a=ARM["a3"]),
        row("level", "q3_body", a=ARM["a4"]),
        row("q4", "level_body", QUARTER, ARM["a5"], ARM["d5"]),
    ]
    reference = {"q2": 0.3, "q3": 0.5, "level": -0.8}
    rods = [summed("rods", ("q2", "q3", "level"))]
    return described("palletizer", joints, couplings=rods, actuated=("q1", "q2", "q3", "q4"), reference=reference)


def level_palletizer():
    """`palh2m2`: both the forearm's foot and the hand are kept level."""
    joints = [
        row("q1", "base"),
        row("q2", "q1_body", QUARTER, 0.2),
        row("foot", "q2_body", a=0.9),
        row("q3", "foot_body", a=0.1),
        row("level", "q3_body", a=1.1),
        row("q4", "level_body", -QUARTER, 0.15),
    ]
    reference = {"q2": 0.3, "foot": -0.3, "q3": 0.5, "level": -0.5}
    rods = [summed("rods2", ("q2", "foot")), summed("rods3", ("q3", "level"))]
    return described("palletizer", joints, couplings=rods, actuated=("q1", "q2", "q3", "q4"), reference=reference)


def arm():
    """A PUMA's six joints, without a loop."""
    joints = [
        row("q1", "base"),
        row("q2", "q1_body", -QUARTER),
        row("q3", "q2_body", a=0.432, d=0.149),
        row("q4", "q3_body", -QUARTER, 0.02, 0.432),
        row("q5", "q4_body", QUARTER),
        row("q6", "q5_body", -QUARTER),
    ]
    return described("arm", joints)


def combinations(names, combos):
    """Combinations {"kind:joint": coefficient} as rows over the constants named."""
    rows = np.zeros((len(combos), len(names)))
    for line, combo in zip(rows, combos, strict=True):
        for name, value in combo.items():
            line[list(names).index(f"{name}_body")] += value
    return rows


def _alone(*names):
    return [{name: 1.0} for name in names]


def four_bar_combinations(lengths):
    """The nine of `fourbar1DE1_convert_par2_MPV_fixb.m`."""
    l2 = lengths[1]
    return [
        {"Izz:crank": 1.0, "mass:coupler": l2**2},
        {"mx:crank": 1.0, "mass:coupler": l2},
        *_alone("my:crank", "Izz:coupler", "mx:coupler", "my:coupler", "Izz:rocker", "mx:rocker", "my:rocker"),
    ]


def parallelogram_combinations(lengths):
    """The three of `fourbar2DE1_convert_par2_MPV_fixb.m`."""
    l2 = lengths[1]
    return [
        {"Izz:crank": 1.0, "Izz:rocker": 1.0, "mass:coupler": l2**2},
        {"mx:crank": 1.0, "mx:rocker": 1.0, "mass:coupler": l2},
        {"my:crank": 1.0, "my:rocker": 1.0},
    ]


def palletizer_combinations():
    """The 21 of `palh2m1DE_convert_par2_MPV_fixb.m`."""
    a2, a3, a4, a5 = (ARM[name] for name in ("a2", "a3", "a4", "a5"))
    beyond_2, beyond_3 = ("q3", "level", "q4"), ("level", "q4")

    def masses(bodies, factor):
        return {f"mass:{body}": factor for body in bodies}

    return [
        {
            "Izz:q1": 1.0, "Iyy:q2": 1.0, "Iyy:q3": 1.0, "Iyy:level": 1.0, "mass:q2": a2**2, "mass:q3": a2**2 + a3**2,
            "mass:level": a2**2 + a3**2 + a4**2, "mass:q4": a2**2 + a3**2 + a4**2 + a5**2,
        },
        {"mx:q1": 1.0, **masses(("q2", *beyond_2), a2)},
        {"my:q1": 1.0, "mz:q2": 1.0, "mz:q3": 1.0, "mz:level": 1.0},
        {"Ixx:q2": 1.0, "Iyy:q2": -1.0, **masses(beyond_2, -(a3**2))},
        {"Ixz:q2": 1.0, "mz:q3": -a3, "mz:level": -a3},
        {"Izz:q2": 1.0, **masses(beyond_2, a3**2)},
        {"mx:q2": 1.0, **masses(beyond_2, a3)},
        {"Ixx:q3": 1.0, "Iyy:q3": -1.0, **masses(beyond_3, -(a4**2))},
        {"Ixz:q3": 1.0, "mz:level": -a4},
        {"Izz:q3": 1.0, **masses(beyond_3, a4**2)},
        {"mx:q3": 1.0, **masses(beyond_3, a4)},
        {"mx:level": 1.0, "mass:q4": a5},
        *_alone("Ixy:q2", "Iyz:q2", "my:q2", "Ixy:q3", "Iyz:q3", "my:q3", "Izz:q4", "mx:q4", "my:q4"),
    ]  # fmt: skip
