"""Which coordinates measure the motion: joints and components chosen cluster by cluster from null-space bases."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.errors import IndependentSetError

_PREFERENCE = 1000.0  # weight of the favoured: of others only those that measure a thousand times better come before
_PLAIN = 10.0  # weight of plain components, against others that are not favoured
_DEPENDENT = 1e-7  # length left of a component that those chosen before fix
_EQUAL = 9  # figures to which lengths are compared


class MotionSpace(NamedTuple):
    """The velocities one cluster's loops allow.

    Attributes:
        names: Its velocity components, ``joint`` or ``joint:axis``.
        joints: The joint of each.
        places: Where they stand in q̇′.
        basis: An orthonormal basis, of shape (components, n).
        plain: Whether each moves a plain number or an angle, not one of the turns of a ball.
    """

    names: tuple[str, ...]
    joints: tuple[str, ...]
    places: tuple[int, ...]
    basis: Array
    plain: tuple[bool, ...]

    @property
    def n(self) -> int:
        """How many motions it has of its own."""
        return int(self.basis.shape[1])

    def independence(self, wanted: Sequence[str]) -> float:
        """How well those of the wanted components that are its own measure it, in [0, 1].

        It is the smallest nonzero singular value of their rows of the basis (1 where none are wanted).
        """
        rows = [self.basis[self.names.index(name)] for name in components_of(all_components([self]), wanted)]
        if not rows or not self.n:
            return 1.0
        singular = np.linalg.svd(np.array(rows), compute_uv=False)
        return float(singular[min(len(singular), self.n) - 1])


class _Choosing:
    """One cluster's choice under way: what the components chosen so far leave of each component's row."""

    def __init__(self, motion: MotionSpace, favoured: set[str]) -> None:
        self.motion = motion
        self.left = motion.basis.copy()
        self.chosen: list[str] = []
        plain = np.where(motion.plain, _PLAIN, 1.0)
        self.weights = np.where([name in favoured for name in motion.names], _PREFERENCE, plain)

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
    motions: Sequence[MotionSpace], required: Iterable[str], preferred: Iterable[str]
) -> tuple[str, ...]:
    """Extend `required` to components whose velocities fix the motion best, as many as there are motions.

    Components are taken one by one, each the one whose row of the null-space basis at the reference is largest
    in the part the earlier ones leave undetermined; `preferred` ones (motors, say) win unless they are a hundred times
    worse, and plain coordinates win over a ball's turns unless ten times worse. Whole multi-dof joints are named as
    such where all their components are chosen.

    Raises:
        IndependentSetError: Components of `required` depend on one another.
    """
    components = all_components(motions)
    favoured = set(components_of(components, preferred))
    choosing = [_Choosing(motion, favoured) for motion in motions]
    owner = {name: choice for choice in choosing for name in choice.motion.names}
    chosen: list[str] = []
    for name in components_of(components, required):
        if not owner[name].take(name):
            raise IndependentSetError(
                f"'{name}' cannot be independent: at the reference configuration its motion is fixed by "
                f"{', '.join(owner[name].chosen) or 'the loops alone'}"
            )
        chosen.append(name)
    heads = [(*choice.best(), k) for k, choice in enumerate(choosing) if len(choice.chosen) < choice.motion.n]
    heapify(heads)
    while heads:
        _, _, name, k = heappop(heads)
        choice = choosing[k]
        choice.take(name)
        chosen.append(name)
        if len(choice.chosen) < choice.motion.n:
            heappush(heads, (*choice.best(), k))
    return merged(components, chosen)


def all_components(motions: Iterable[MotionSpace]) -> dict[str, str]:
    """The velocity components of all clusters in the order of q̇′, and the joint of each."""
    placed = (entry for motion in motions for entry in zip(motion.places, motion.names, motion.joints, strict=True))
    return {name: joint for _, name, joint in sorted(placed)}


def components_of(components: Mapping[str, str], names: Iterable[str]) -> list[str]:
    """The velocity components that joints or components stand for, of all there are."""
    parts = _by_joint(components)
    return [part for name in names for part in ([name] if name in components else parts.get(name, []))]


def _by_joint(components: Mapping[str, str]) -> dict[str, list[str]]:
    """The components of each joint."""
    parts: dict[str, list[str]] = {}
    for name, joint in components.items():
        parts.setdefault(joint, []).append(name)
    return parts


def merged(components: Mapping[str, str], chosen: Sequence[str]) -> tuple[str, ...]:
    """The components with a joint named instead of them where all of its are chosen."""
    parts, taken = _by_joint(components), set(chosen)
    owners = ((name, components[name]) for name in chosen)
    return tuple(dict.fromkeys(joint if taken.issuperset(parts[joint]) else name for name, joint in owners))
