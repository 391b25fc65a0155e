"""Who measures the motion and who drives it: the independent and the actuated joints, settled and explained."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import pinocchio as pin

from ccpin.description.model import MechanismDescription
from ccpin.description.names import choices
from ccpin.errors import IndependentSetError
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.tree import ROOT_JOINT, Tree
from ccpin.mechanism.motion.independence import MotionSpace, all_components, complete_independent, components_of


class JointChoice(NamedTuple):
    """The sets settled on, and where the author had not stated them exactly."""

    independent: tuple[str, ...]
    actuated: tuple[str, ...]
    notes: tuple[str, ...]


def choose_independent(
    tree: Tree,
    motions: Sequence[MotionSpace],
    description: MechanismDescription,
    independent: Sequence[str] | None,
    actuated: Sequence[str] | None,
    locked: Sequence[str] = (),
) -> JointChoice:
    """Settle the independent and actuated sets, and say where the author did not state them exactly.

    With joints `locked` on request the file's marks may be too many: they are then taken as what to choose from first.
    """
    n = sum(motion.n for motion in motions)
    motors = tuple(actuated) if actuated is not None else (description.actuated or ())
    for name in motors:
        if tree.split(name)[0] not in tree.names:
            raise IndependentSetError(f"actuated: '{name}' is not a movable joint; {choices(name, tree.names)}")
    base = (ROOT_JOINT,) if ROOT_JOINT in tree.names and tree.joint(ROOT_JOINT).kind.nv == 6 else ()
    notes: list[str] = []
    if independent is not None:
        names = _named(tree, tuple(independent), motions)
    elif description.independent is not None and not (locked and _count(motions, description.independent) > n):
        names = _marked(tree, description, motions, base, notes)
    else:
        names = _found(tree, description, motions, base, motors)
        notes += _how_found(description, names, motors, locked, n)
    driven = motors or _default_motors(tree, names, notes)
    if any(tree.split(name)[1] for name in driven) and driven != names:
        raise IndependentSetError(
            "a single component of a joint can be actuated only where the actuated coordinates are the independent ones"
        )
    return JointChoice(names, driven, tuple(notes))


def _named(tree: Tree, names: tuple[str, ...], motions: Sequence[MotionSpace]) -> tuple[str, ...]:
    """The set a caller names, in his order and words where these are whole joints' own."""
    _check_size(tree, names, motions)
    whole = complete_independent(motions, names, ()) if names else names
    return names if set(whole) == set(names) else whole


def _found(
    tree: Tree,
    description: MechanismDescription,
    motions: Sequence[MotionSpace],
    base: tuple[str, ...],
    motors: tuple[str, ...],
) -> tuple[str, ...]:
    """The set that measures the motion best: the motors before others, else what is marked, or not a successor."""
    hinted = description.dependent_hint
    masters = tuple(name for name in tree.names if hinted and name not in hinted)
    preferred = motors or description.independent or masters
    return _in_order(complete_independent(motions, (), (*base, *preferred)), dict.fromkeys(base + motors))


def _how_found(
    description: MechanismDescription, names: tuple[str, ...], motors: tuple[str, ...], locked: Sequence[str], n: int
) -> list[str]:
    """Why the independent set is not what the file says, in at most one sentence."""
    listed = ", ".join(names)
    added = ", ".join(name for name in names if name not in motors)
    if description.independent is not None:
        return [
            f"with {', '.join(locked)} locked the file marks more independent joints than there are motions ({n}): "
            f"{listed or 'none'} of them"
        ]
    if motors and added:
        return [
            f"the file names {len(motors)} motors and the mechanism has {n} independent motions: {added} completed the "
            "independent set"
        ]
    if motors:
        return []
    chosen = f"{listed} {'was' if len(names) == 1 else 'were'} chosen" if names else "none moves freely"
    return [f"the file marks no independent joints: {chosen}"]


def _default_motors(tree: Tree, names: tuple[str, ...], notes: list[str]) -> tuple[str, ...]:
    """The independent joints, for a file without motors; what floats freely carries none.

    Beside a floating joint single components of ball joints carry none either (S would not be constant).
    """
    joints = {name: tree.joint(tree.split(name)[0]) for name in names}
    floating = [name for name in names if joints[name].kind.nv == 6]
    if not floating:
        return names
    motors = tuple(n for n in names if n not in floating and (not tree.split(n)[1] or not joints[n].kind.unit))
    left = ", ".join(name for name in names if name not in motors)
    notes.append(f"no motor drives what floats freely ({left}); `actuated=` names what is driven")
    return motors


def _marked(
    tree: Tree,
    description: MechanismDescription,
    motions: Sequence[MotionSpace],
    base: tuple[str, ...],
    notes: list[str],
) -> tuple[str, ...]:
    """The set a file marks; the default marks of a coupling's successors are given up where it is too large."""
    marked = tuple(dict.fromkeys((*base, *(description.independent or ()))))
    if _count(motions, marked) > sum(motion.n for motion in motions) and description.independent_is_default:
        given_up = tuple(name for name in marked if name in description.dependent_hint)
        marked = tuple(name for name in marked if name not in given_up)
        notes.append(
            f"the file leaves `independent` out on both sides of couplings: {', '.join(given_up)} "
            "taken as dependent (the successors)"
        )
    try:
        _check_size(tree, marked, motions)
    except IndependentSetError as error:
        hint = "; a joint without `independent` counts as independent" if description.independent_is_default else ""
        raise IndependentSetError(f"{error}{hint}") from None
    return complete_independent(motions, marked, ())


def _in_order(names: Sequence[str], first: Collection[str]) -> tuple[str, ...]:
    """Names with the `first` among them before the others, in their order: q's order is that of the motors."""
    return (*(name for name in first if name in names), *(name for name in names if name not in first))


def _count(motions: Sequence[MotionSpace], names: tuple[str, ...]) -> int:
    """How many velocity components joints and components have."""
    return len(components_of(all_components(motions), names))


def _check_size(tree: Tree, names: tuple[str, ...], motions: Sequence[MotionSpace]) -> None:
    """Raise an IndependentSetError unless the set has n velocity components, saying what to add or take away."""
    IndependentCoordinates(tree, names, pin.neutral(tree.model))
    count, n = _count(motions, names), sum(motion.n for motion in motions)
    if count == n:
        return
    given = f"{count} independent velocities are named ({', '.join(names) or 'none'}) but the mobility is {n}"
    if count < n:
        whole = complete_independent(motions, names, ())
        missing = ", ".join(name for name in whole if name not in names)
        raise IndependentSetError(f"{given}: add {missing}, for instance")
    suggestion = complete_independent(motions, (), names)
    raise IndependentSetError(f"{given}: {', '.join(suggestion) or 'none'} would do")
