"""The constants π of a mechanism in which its equations of motion are linear: named, with units and values.

`kind:NAME`, NAME a link (the one that a movable joint carries; what is fixed to it counts with it) or a movable joint:
`mass`, the first moments `mx`, `my`, `mz` and the inertias `Ixx`, `Ixy`, `Iyy`, `Ixz`, `Iyz`, `Izz` about the origin
and in the axes of the joint's moving frame (Pinocchio's order); `armature` (of a motor behind gears: the squared ratio
times the rotor's inertia), `damping`, `friction` (Coulomb's level c), of joints that can have a spring `stiffness` k
and `offset` kθ₀, a constant effort on the joint (a ball's spring pulls to no turn: it has none), and of joints that
state a Stribeck speed `stribeck`, by how much the breakaway level is above Coulomb's, s − c.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ccpin.arrays import Array, Indices, Record, choice, instance, number
from ccpin.description.names import choices
from ccpin.errors import InvalidInputError
from ccpin.kinematics.tree import Tree, TreeJoint

INERTIAL = ("mass", "mx", "my", "mz", "Ixx", "Ixy", "Iyy", "Ixz", "Iyz", "Izz")
KINDS = (*INERTIAL, "armature", "damping", "friction", "stiffness", "offset", "stribeck")
BODY = len(INERTIAL)
_EACH = ("N m", "N")  # of a joint that turns, or slides
_UNITS = {
    **dict.fromkeys(INERTIAL, ("kg m²",) * 2), **dict.fromkeys(("mx", "my", "mz"), ("kg m",) * 2), "mass": ("kg",) * 2,
    "armature": ("kg m²", "kg"), "damping": ("N m s/rad", "N s/m"), "friction": _EACH, "stiffness": ("N m/rad", "N/m"),
    "offset": _EACH, "stribeck": _EACH,
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class DynamicParameters(Record):
    """π of a mechanism: p constants, body by body, then joint by joint.

    Attributes:
        names: ``kind:NAME``.
        kinds: The part before the colon.
        units: Of each.
        values: The model's own, of shape (p,).
    """

    names: tuple[str, ...]
    kinds: tuple[str, ...]
    units: tuple[str, ...]
    values: Array

    def __len__(self) -> int:
        return len(self.names)

    def of(self, *kinds: str) -> Indices:
        """Where the parameters of these kinds stand; ``inertia`` stands for the ten of a body.

        Raises:
            InvalidInputError: There is no such kind.
        """
        wanted = {choice(kind, "kind", ("inertia", *KINDS)) for kind in kinds}
        wanted |= set(INERTIAL) if "inertia" in wanted else set()
        return np.flatnonzero([kind in wanted for kind in self.kinds])

    def plus(self, added: Mapping[str, float]) -> DynamicParameters:
        """π with more of some constants, by name, in their units: those of a load on a link, say.

        Raises:
            InvalidInputError: A name of none, or no finite number.
        """
        values = np.array(self.values)
        for name, value in instance(added, "added", Mapping, "a mapping of constants' names to numbers").items():
            if name not in self.names:
                raise InvalidInputError(f"added: '{name}' is no constant; {choices(str(name), self.names)}")
            values[self.names.index(name)] += number(value, f"added: '{name}'")
        return replace(self, values=values)


def joint_kinds(joint: TreeJoint) -> tuple[str, ...]:
    """The kinds of parameters that a joint has, in order."""
    springs = ("stiffness", "offset") if joint.kind.nq == 1 else ("stiffness",) if joint.kind.springs else ()
    return ("armature", "damping", "friction", *springs, *(("stribeck",) if joint.stated.stribeck_speed else ()))


def dynamic_parameters(tree: Tree) -> DynamicParameters:
    """Those of a free system, with the values that its description states."""
    kinds, owners, units, values = zip(*_bodies(tree), *_joints(tree), strict=True) if tree.joints else ((),) * 4
    names = tuple(f"{kind}:{owner}" for kind, owner in zip(kinds, owners, strict=True))
    return DynamicParameters(names, kinds, units, np.array(values, dtype=np.float64))


def _bodies(tree: Tree) -> Iterator[tuple[str, str, str, float]]:
    for joint in tree.joints:
        values = tree.model.inertias[joint.number].toDynamicParameters().tolist()
        for kind, value in zip(INERTIAL, values, strict=True):
            yield kind, joint.stated.child, _UNITS[kind][0], value


def _joints(tree: Tree) -> Iterator[tuple[str, str, str, float]]:
    for joint in tree.joints:
        slides = set(joint.kind.slides)
        for kind in joint_kinds(joint):
            unit = " or ".join(_UNITS[kind][slide] for slide in sorted(slides))
            stated = joint.stated
            made = {"offset": stated.stiffness * stated.spring_reference}
            made["stribeck"] = stated.breakaway_level - stated.friction
            yield kind, joint.name, unit, float(made[kind] if kind in made else getattr(stated, kind))
