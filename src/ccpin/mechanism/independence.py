"""Which coordinates measure the motion: joints and components chosen cluster by cluster from null-space bases."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.joint_kinds import JOINT_KINDS
from ccpin.errors import IndependentSetError

_PREFERENCE = 100.0
_DEPENDENT = 1e-7
_EQUAL = 9


class Motion(NamedTuple):
    """The velocities one cluster's loops allow.

    Attributes:
        names: Its velocity components, ``joint`` or ``joint:axis``.
        places: Where they stand in q̇′.
        basis: An orthonormal basis, of shape (components, n).
    """

    names: tuple[str, ...]
    places: tuple[int, ...]
    basis: Array

    @property
    def n(self) -> int:
        """How many motions it has of its own."""
        return int(self.basis.shape[1])

    def independence(self, wanted: Sequence[str]) -> float:
        """How well those of the wanted components that are its own measure it, in [0, 1].

        It is the smallest nonzero singular value of their rows of the basis (1 where none are wanted).
        """
        rows = [self.basis[self.names.index(name)] for name in components_of(self.names, wanted)]
        if not rows or not self.n:
            return 1.0
        singular = np.linalg.svd(np.array(rows), compute_uv=False)
        return float(singular[min(len(singular), self.n) - 1])


class _Choosing:
    """One cluster's choice under way: what the components chosen so far leave of each component's row."""

    def __init__(self, motion: Motion, favoured: set[str]) -> None:
        self.motion = motion
        self.left = motion.basis.copy()
        self.chosen: list[str] = []
        self.weights = np.array([_PREFERENCE if name in favoured else 1.0 for name in motion.names])

    def best(self) -> tuple[float, int, str]:
        """The component left that measures best: its weighted length negated, its place in q̇′ and its name.

        Lengths are compared to nine figures: of equal ones the first counts, whatever rounding says.
        """
        lengths = self.weights * np.linalg.norm(self.left, axis=1)
        lengths = np.array([float(f"{length:.{_EQUAL}g}") for length in lengths])
        k = int(np.argmax(lengths))
        return -float(lengths[k]), self.motion.places[k], self.motion.names[k]

    def take(self, name: str) -> bool:
        """Choose a component; False where those chosen before fix it already."""
        row = self.left[self.motion.names.index(name)]
        length = float(np.linalg.norm(row))
        if length < _DEPENDENT:
            return False
        self.left = self.left - np.outer(self.left @ row, row / length**2)
        self.chosen.append(name)
        return True


def complete_independent(
    motions: Sequence[Motion], required: Iterable[str], preferred: Iterable[str]
) -> tuple[str, ...]:
    """Extend `required` to components whose velocities fix the motion best, as many as there are motions.

    Components are taken one by one, each the one whose row of the null-space basis at the reference is largest
    in the part the earlier ones leave undetermined; `preferred` ones (motors, say) win unless they are a hundred times
    worse. Whole multi-dof joints are named as such where all their components are chosen.

    Raises:
        IndependentSetError: Components of `required` depend on one another.
    """
    names = all_components(motions)
    favoured = set(components_of(names, preferred))
    choosing = [_Choosing(motion, favoured) for motion in motions]
    owner = {name: choice for choice in choosing for name in choice.motion.names}
    chosen: list[str] = []
    for name in components_of(names, required):
        if not owner[name].take(name):
            raise IndependentSetError(
                f"'{name}' cannot be independent: at the reference configuration its motion is fixed by "
                f"{', '.join(owner[name].chosen) or 'the loops alone'}"
            )
        chosen.append(name)
    heads = {k: choice.best() for k, choice in enumerate(choosing) if len(choice.chosen) < choice.motion.n}
    while heads:
        k = min(heads, key=lambda k: heads[k])
        name, choice = heads.pop(k)[2], choosing[k]
        choice.take(name)
        chosen.append(name)
        if len(choice.chosen) < choice.motion.n:
            heads[k] = choice.best()
    return _merge(names, chosen)


def all_components(motions: Iterable[Motion]) -> tuple[str, ...]:
    """The velocity components of all clusters, in the order of q̇′."""
    placed = (pair for motion in motions for pair in zip(motion.places, motion.names, strict=True))
    return tuple(name for _, name in sorted(placed))


def components_of(names: Sequence[str], joints: Iterable[str]) -> list[str]:
    """The velocity components, as named in `names`, that joints or components stand for."""
    known, parts = set(names), _by_joint(names)
    return [name for joint in joints for name in ([joint] if joint in known else parts.get(joint, []))]


def _by_joint(names: Iterable[str]) -> dict[str, list[str]]:
    """The components of each joint that has several."""
    parts: dict[str, list[str]] = {}
    for name in names:
        if joint := _joint_of(name):
            parts.setdefault(joint, []).append(name)
    return parts


def _joint_of(name: str) -> str:
    """The joint that a component belongs to; empty for a 1-dof joint's name, which may hold a colon of its own."""
    joint, _, component = name.rpartition(":")
    return joint if any(component in kind.components for kind in JOINT_KINDS.values()) else ""


def _merge(names: Sequence[str], chosen: Sequence[str]) -> tuple[str, ...]:
    """Name a joint instead of its components where all are chosen."""
    parts, taken = _by_joint(names), set(chosen)
    owners = ((name, _joint_of(name)) for name in chosen)
    return tuple(dict.fromkeys(joint if joint and taken.issuperset(parts[joint]) else name for name, joint in owners))
