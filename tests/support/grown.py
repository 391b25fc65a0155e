"""Random mechanisms by number: a tree with one or two loops that close by construction, with all that joints state."""

from dataclasses import replace

import numpy as np

from ccpin import MechanismDescription
from ccpin.description import Motor
from tests.support.strategies import DOF, JOINING, PLANAR_JOINTS, ROWS, Growth

FORCEFUL = ("revolute", "continuous", "prismatic")
"""Kinds of joints that are given damping, friction, springs and motors."""


def grown(seed: int) -> MechanismDescription:
    """The random mechanism of this number; every second one is planar.

    As `tests.support.strategies.mechanisms` grows them, and with dampers, springs, dry friction and a geared motor.
    """
    rng = np.random.default_rng(seed)
    flat = bool(seed % 2)
    growth = Growth(rng, flat)
    for _ in range(rng.integers(1, 3)):
        kind = str(rng.choice(["spherical", "revolute", "fixed", str(rng.choice(JOINING))]))
        chain = _chain(rng, flat, 1 + (min(3, ROWS[kind]) if flat else ROWS[kind]))
        links = list(growth.poses)
        roots = [str(rng.choice(links)), str(rng.choice(links))] if rng.random() < 0.5 else [links[-1]] * 2
        cut = int(rng.integers(0, len(chain) + 1))
        ends = [growth.grow(root, part) for root, part in zip(roots, (chain[:cut], chain[cut:]), strict=True)]
        growth.close(kind, *ends)
    return _with_forces(rng, growth.drawn().description)


def _chain(rng, flat, least):
    """Kinds of a loop's joints, of `least` freedoms or some more; most of them turn."""
    pool = PLANAR_JOINTS if flat else tuple(DOF)[:4]
    kinds = []
    while sum(DOF[kind] for kind in kinds) < least:
        kinds.append("revolute" if rng.random() < 0.5 else str(rng.choice(pool)))
    return kinds + ["fixed"] * int(rng.integers(0, 2))


def _with_forces(rng, description):
    """Dampers, springs and friction on some joints that have one displacement, and a motor on one."""
    joints = []
    for joint in description.joints:
        if joint.kind in FORCEFUL:
            numbers = rng.uniform(0.05, 0.5, 4) * rng.integers(0, 2, 4)
            fields = ("damping", "friction", "stiffness", "armature")
            joint = replace(joint, **dict(zip(fields, numbers.tolist(), strict=True)))
            if joint.stiffness:
                joint = replace(joint, spring_reference=float(rng.uniform(-1.0, 1.0)))
        joints.append(joint)
    driven = [joint.name for joint in joints if joint.kind in FORCEFUL][:1]
    motors = tuple(Motor(f"{name}_drive", name, gear=float(rng.uniform(2.0, 9.0))) for name in driven)
    return replace(description, joints=tuple(joints), actuated=tuple(driven) or None, motors=motors)
