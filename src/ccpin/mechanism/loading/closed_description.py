"""A description whose loops are closed: the free system it makes, and its clusters at the reference."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import MechanismDescription
from ccpin.kinematics.tree import Tree, build_tree
from ccpin.mechanism.loading.reference_search import Settled, idle, settle
from ccpin.mechanism.motion.idle import Idle
from ccpin.mechanism.repair.geometry import Change, changed


@dataclass(frozen=True, eq=False)
class ClosedDescription:
    """A description whose loops are closed.

    Attributes:
        description: With geometry repaired.
        tree: Its free system.
        settled: Its clusters at the reference.
        q_free: The whole reference, of shape (nq,).
        changes: The repairs.
    """

    description: MechanismDescription
    tree: Tree
    settled: list[Settled]
    q_free: Array
    changes: list[Change]

    @property
    def posed(self) -> MechanismDescription:
        """The description with this configuration as its reference."""
        own = {joint.name for joint in self.description.joints}
        told = {j.name: j.kind.told(self.q_free[j.q]) for j in self.tree.joints if j.name in own}
        return replace(self.description, reference=told)

    @cached_property
    def idle(self) -> list[tuple[Settled, list[Idle]]]:
        """The motions of each cluster that move nothing else."""
        return idle(self.tree, self.settled)

    @property
    def n(self) -> int:
        """How many motions it has."""
        return sum(found.motion.n for found in self.settled)


def close_loops(
    description: MechanismDescription, floating_base: bool, wanted: Sequence[str], tolerance: float
) -> ClosedDescription:
    """Close a description's loops near its reference, with its geometry repaired within the tolerance.

    Raises:
        LoopNotClosedError: A loop does not close.
    """
    tree = build_tree(description, floating_base)
    settled = settle(tree, description, wanted, tolerance)
    changes = [found.repair.change for found in settled if found.repair is not None]
    repaired = reduce(changed, changes, description)
    tree = build_tree(repaired, floating_base) if changes else tree
    q_free = np.empty(tree.model.nq)
    for found in settled:
        q_free[found.part.q] = found.closed.q_free
    return ClosedDescription(repaired, tree, settled, q_free, changes)
