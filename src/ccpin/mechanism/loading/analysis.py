"""From a description to a mechanism: loops closed, joints locked, motions counted, coordinates and motors chosen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import MechanismDescription
from ccpin.description.names import choices
from ccpin.errors import IndependentSetError, InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.tree import Tree, build_tree
from ccpin.mechanism.loading.fixing import component_locks, fixed, locked_joints
from ccpin.mechanism.loading.locking import Spin, hold, spins_of
from ccpin.mechanism.loading.reference_search import (
    Settled,
    check_independent,
    how_closed,
    how_moved,
    idle,
    other_branches,
    settle,
    stated_pose,
)
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.motion.idle import Idle
from ccpin.mechanism.motion.mobility import Mobility
from ccpin.mechanism.motion.selection import choose_independent
from ccpin.mechanism.repair.geometry import Change, changed

ALL = "all"


class Wishes(NamedTuple):
    """What a user says of a mechanism's joints by name, as `ccpin.load` takes it."""

    independent: Sequence[str] | None = None
    actuated: Sequence[str] | None = None
    locked: tuple[str, ...] = ()
    free: tuple[str, ...] = ()


class ClosedDescription(NamedTuple):
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


def analysed(description: MechanismDescription, floating_base: bool, wishes: Wishes, tolerance: float) -> Mechanism:
    """Close the loops, lock what is to be locked, count the motions, settle who measures and who drives them.

    What is locked changes φ, so the loops are closed again with it, from where they were.
    """
    wanted = tuple(wishes.independent) if wishes.independent is not None else (description.independent or ())

    def close(description: MechanismDescription) -> ClosedDescription:
        return _closed(description, floating_base, wanted, tolerance)

    tree, told = build_tree(description, floating_base), list[str]()
    asked = _asked(tree, wishes)
    stated = [joint for joint, parts in asked.items() if not parts and joint in description.reference]
    if stated:
        description, told = fixed(description, tree, stated_pose(tree, description), stated)
    first = here = close(description)
    left = {joint: parts for joint, parts in asked.items() if joint not in stated}
    if left:
        description, more = _held_still(here, left)
        here, told = close(description), told + more
    motions = idle(here.tree, here.settled)
    spins = _idle_spins(here, motions, wishes)
    description, locked, held = here.description, tuple(_names(asked)), None
    if spins:
        description = here.posed
        held = hold(description, here.tree, here.q_free, spins)
        here, told = close(held.description), told + list(held.notes)
        motions = idle(here.tree, here.settled)
        for change in here.changes:
            description = changed(description, change)
    notes = [*how_closed(first.settled), *how_moved(first.tree, first.description, first.q_free), *told]
    mechanism = _mechanism(here, motions, wishes, notes)
    locked = locked if held is None else (*locked, *held.locked)
    still = (*mechanism.independent, *locked)
    branches = other_branches(first.settled, first.tree, first.description, still)
    mechanism = replace(mechanism, notes=(*mechanism.notes, *branches), locked=locked)
    return mechanism if held is None else replace(mechanism, description=description, held=here.description)


def _closed(
    description: MechanismDescription, floating_base: bool, wanted: Sequence[str], tolerance: float
) -> ClosedDescription:
    tree = build_tree(description, floating_base)
    settled = settle(tree, description, wanted, tolerance)
    changes = [found.repair.change for found in settled if found.repair is not None]
    for change in changes:
        description = changed(description, change)
    tree = build_tree(description, floating_base) if changes else tree
    q_free = np.empty(tree.model.nq)
    for found in settled:
        q_free[found.part.q] = found.closed.q_free
    return ClosedDescription(description, tree, settled, q_free, changes)


def _asked(tree: Tree, wishes: Wishes) -> dict[str, tuple[str, ...]]:
    """The joints to lock and their components (none: whole).

    Raises:
        InvalidInputError: A name to lock, or to leave free, is of no movable joint.
        IndependentSetError: A joint to lock is to measure or to drive the motion too.
    """
    for name in wishes.free:
        if name != ALL and tree.split(name)[0] not in tree.names:
            raise InvalidInputError(f"free: '{name}' is no movable joint; {choices(name, (*tree.names, ALL))}")
    asked = locked_joints(tree, wishes.locked)
    for role, names in (("independent", wishes.independent), ("actuated", wishes.actuated)):
        for name in names or ():
            joint, component = tree.split(name)
            if joint in asked and (not asked[joint] or not component or component in asked[joint]):
                raise IndependentSetError(f"'{name}' is named both {role} and locked")
    return asked


def _held_still(
    here: ClosedDescription, asked: Mapping[str, tuple[str, ...]]
) -> tuple[MechanismDescription, list[str]]:
    """The description with joints or components of them locked where the loops closed."""
    parts = {joint: components for joint, components in asked.items() if components}
    locks = [
        lock
        for joint, components in parts.items()
        for lock in component_locks(here.tree, here.q_free, here.tree.joint(joint), components)
    ]
    description = replace(here.posed, closures=(*here.description.closures, *locks))
    return fixed(description, here.tree, here.q_free, [joint for joint in asked if joint not in parts])


def _names(asked: Mapping[str, tuple[str, ...]]) -> list[str]:
    return [name for joint, parts in asked.items() for name in ([f"{joint}:{part}" for part in parts] or [joint])]


def _idle_spins(here: ClosedDescription, motions: Sequence[tuple[Settled, list[Idle]]], wishes: Wishes) -> list[Spin]:
    """The idle spins to lock: all that nothing turns and nobody asked for, but never the last motion there is.

    Raises:
        InvalidInputError: A joint named as free has no idle spin.
    """
    given = here.description
    measuring = wishes.independent or (() if given.independent_is_default else given.independent) or ()
    driving = wishes.actuated if wishes.actuated is not None else (given.actuated or ())
    coupled = [term.joint for coupling in given.couplings for term in coupling.terms]
    found = [spin for settled, own in motions for spin in spins_of(settled, own, coupled)]
    for name in wishes.free:
        if name != ALL and not any(spin.named_by([name]) for spin in found):
            known = ", ".join(spin.lock.name for spin in found if spin.lock) or "none has"
            raise InvalidInputError(f"free: '{name}' has no spin that moves nothing else; those that have: {known}")
    wanted = [*measuring, *driving, *wishes.free]
    spins = [
        spin
        for spin in found
        if spin.lock is not None
        and ALL not in wishes.free
        and not spin.named_by(wanted)
        and not any(joint.stated.stiffness for joint in spin.joints)
        and spin.idle_in_mass
    ]
    return spins if len(spins) < sum(settled.motion.n for settled in here.settled) else []


def _mechanism(
    here: ClosedDescription, idles: Sequence[tuple[Settled, list[Idle]]], wishes: Wishes, notes: list[str]
) -> Mechanism:
    description, tree, settled = here.description, here.tree, here.settled
    motions = [found.motion for found in settled]
    choice = choose_independent(tree, motions, description, wishes.independent, wishes.actuated, wishes.locked)
    rank = sum(found.tangent.rank for found in settled)
    mobility = Mobility(
        n_free=int(tree.model.nv),
        rows=sum(found.constraints.size for found in settled),
        rank=rank,
        mobility=int(tree.model.nv) - rank,
        idle=tuple(each.sentence for _, own in idles for each in own),
        notes=choice.notes,
    )
    told = dict.fromkeys([*description.notes, *choice.notes, *notes, *_forces_told(description, tree, choice.actuated)])
    IndependentCoordinates(tree, choice.actuated, here.q_free)  # refuses names that cannot be actuated
    check_independent(settled, choice.independent)
    return Mechanism(description, tree, choice.independent, choice.actuated, here.q_free, mobility, tuple(told))


def _forces_told(description: MechanismDescription, tree: Tree, actuated: tuple[str, ...]) -> list[str]:
    """Notes where joints state dry friction, and where one unit of u is not one N m (or N) on its joint."""
    told, rubbing = [], [joint.name for joint in tree.joints if joint.stated.friction]
    if rubbing:
        told.append(
            f"dry friction of {', '.join(rubbing)}: `simulate` has it, the smooth equations (dynamics, laws, "
            "certificates) have not"
        )
    geared = [f"{m.gear:g} on {m.joint}" for m in description.motors if m.gear != 1.0 and m.joint in actuated]
    if geared:
        told.append(f"u is the motors' own input: one unit is {', '.join(geared)} (N m or N)")
    return told
