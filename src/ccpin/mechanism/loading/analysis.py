"""From a description to a mechanism: loops closed, joints locked, motions counted, coordinates and motors chosen."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import reduce
from typing import NamedTuple

from ccpin.description.model import MechanismDescription
from ccpin.description.names import choices
from ccpin.errors import IndependentSetError, InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.tree import Tree, build_tree
from ccpin.mechanism.loading.closed_description import ClosedDescription, close_loops
from ccpin.mechanism.loading.fixing import component_locks, fixed, locked_joints
from ccpin.mechanism.loading.locking import Spin, hold, spins_of
from ccpin.mechanism.loading.reference_search import (
    check_independent,
    how_closed,
    how_moved,
    other_branches,
    stated_pose,
)
from ccpin.mechanism.mechanism import Mechanism
from ccpin.mechanism.motion.mobility import Mobility
from ccpin.mechanism.motion.selection import choose_independent
from ccpin.mechanism.repair.geometry import changed

ALL = "all"


class Wishes(NamedTuple):
    """What a user says of a mechanism's joints by name, as `ccpin.load` takes it."""

    independent: Sequence[str] | None = None
    actuated: Sequence[str] | None = None
    locked: tuple[str, ...] = ()
    free: tuple[str, ...] = ()


Close = Callable[[MechanismDescription], ClosedDescription]


class _LockedSoFar(NamedTuple):
    """A description closed with what has been locked in it so far.

    Attributes:
        first: As it was closed before anything was locked where the loops closed.
        closed: As it is closed now, with all locks.
        pending: Joints to lock on request that are not locked yet, and their components (none: whole).
        locked: All that is asked for, and what locks idle spins, by name.
        spinning: The description with those spins free and all else as in `closed`; ``None``: no spin is locked.
        told: What the locks entail, in sentences.
    """

    first: ClosedDescription
    closed: ClosedDescription
    pending: Mapping[str, tuple[str, ...]]
    locked: tuple[str, ...]
    told: tuple[str, ...]
    spinning: MechanismDescription | None = None


def analysed(description: MechanismDescription, floating_base: bool, wishes: Wishes, tolerance: float) -> Mechanism:
    """Close the loops, lock until nothing is left to lock, count the motions, settle who measures and who drives them.

    What is locked changes φ, so the loops are closed again with it, from where they were.
    """
    wanted = tuple(wishes.independent) if wishes.independent is not None else (description.independent or ())

    def close(description: MechanismDescription) -> ClosedDescription:
        return close_loops(description, floating_base, wanted, tolerance)

    stage = _begun(description, build_tree(description, floating_base), wishes, close)
    while (further := _locked_further(stage, wishes, close)) is not None:
        stage = further
    return _mechanism(stage, wishes)


def _begun(description: MechanismDescription, tree: Tree, wishes: Wishes, close: Close) -> _LockedSoFar:
    """The loops closed, whole joints that are asked for and have a stated place locked there."""
    asked = _asked(tree, wishes)
    stated = [joint for joint, parts in asked.items() if not parts and joint in description.reference]
    still, told = fixed(description, tree, stated_pose(tree, description), stated)
    closed = close(still)
    pending = {joint: parts for joint, parts in asked.items() if joint not in stated}
    names = [name for joint, parts in asked.items() for name in ([f"{joint}:{part}" for part in parts] or [joint])]
    return _LockedSoFar(closed, closed, pending, tuple(names), tuple(told))


def _locked_further(stage: _LockedSoFar, wishes: Wishes, close: Close) -> _LockedSoFar | None:
    """The next stage: joints asked for locked where the loops closed, then idle spins; ``None``: nothing is left."""
    here = stage.closed
    if stage.pending:
        still, told = _held_still(here, stage.pending)
        return stage._replace(closed=close(still), pending={}, told=(*stage.told, *told))
    spins = _spins_to_lock(stage, wishes)
    if not spins:
        return None
    held = hold(here.posed, here.tree, here.q_free, spins)
    closed = close(held.description)
    return stage._replace(
        closed=closed,
        locked=(*stage.locked, *held.locked),
        spinning=reduce(changed, closed.changes, here.posed if stage.spinning is None else stage.spinning),
        told=(*stage.told, *held.notes),
    )


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


def _spins_to_lock(stage: _LockedSoFar, wishes: Wishes) -> list[Spin]:
    """The idle spins to lock: all that nothing turns and nobody asked for, but never the last motion there is.

    Raises:
        InvalidInputError: A joint named as free has no idle spin.
    """
    here = stage.closed
    given = here.description
    measuring = wishes.independent or (() if given.independent_is_default else given.independent) or ()
    driving = wishes.actuated if wishes.actuated is not None else (given.actuated or ())
    coupled = [term.joint for coupling in given.couplings for term in coupling.terms]
    found = [spin for settled, own in here.idle for spin in spins_of(settled, own, coupled)]
    if stage.spinning is None:
        _check_free(found, wishes)
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
    return spins if len(spins) < here.n else []


def _check_free(found: Sequence[Spin], wishes: Wishes) -> None:
    for name in wishes.free:
        if name != ALL and not any(spin.named_by([name]) for spin in found):
            known = ", ".join(spin.lock.name for spin in found if spin.lock) or "none has"
            raise InvalidInputError(f"free: '{name}' has no spin that moves nothing else; those that have: {known}")


def _mechanism(stage: _LockedSoFar, wishes: Wishes) -> Mechanism:
    """The mechanism, with coordinates and motors chosen and all that had to be assumed among its notes."""
    here, first = stage.closed, stage.first
    description, tree, settled = here.description, here.tree, here.settled
    motions = [found.motion for found in settled]
    choice = choose_independent(tree, motions, description, wishes.independent, wishes.actuated, wishes.locked)
    IndependentCoordinates(tree, choice.actuated, here.q_free)  # refuses names that cannot be actuated
    check_independent(settled, choice.independent)
    rank = sum(found.tangent.rank for found in settled)
    mobility = Mobility(
        n_free=int(tree.model.nv),
        rows=sum(found.constraints.size for found in settled),
        rank=rank,
        mobility=int(tree.model.nv) - rank,
        idle=tuple(each.sentence for _, own in here.idle for each in own),
        notes=choice.notes,
    )
    closing = [*how_closed(first.settled), *how_moved(first.tree, first.description, first.q_free)]
    told = [*description.notes, *choice.notes, *closing, *stage.told]
    told += _forces_told(description, tree, choice.actuated)
    branches = other_branches(first.settled, first.tree, first.description, (*choice.independent, *stage.locked))
    return Mechanism(
        description=description if stage.spinning is None else stage.spinning,
        tree=tree,
        independent=choice.independent,
        actuated=choice.actuated,
        q_reference=here.q_free,
        mobility=mobility,
        notes=(*dict.fromkeys(told), *branches),
        locked=stage.locked,
        held=None if stage.spinning is None else description,
    )


def _forces_told(description: MechanismDescription, tree: Tree, actuated: tuple[str, ...]) -> list[str]:
    """Notes where joints state dry friction, and where one unit of u is not one N m (or N) on its joint."""
    told, rubbing = [], [joint.name for joint in tree.joints if joint.stated.breakaway_level]
    if rubbing:
        told.append(
            f"dry friction of {', '.join(rubbing)}: `simulate` has it, the smooth equations (dynamics, laws, "
            "certificates) have not"
        )
    geared = [f"{m.gear:g} on {m.joint}" for m in description.motors if m.gear != 1.0 and m.joint in actuated]
    if geared:
        told.append(f"u is the motors' own input: one unit is {', '.join(geared)} (N m or N)")
    return told
