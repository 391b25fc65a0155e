"""Coulomb and viscous joint friction: which joints rub, how hard, and the force of it at a state.

The force on joint j of the free system is set-valued in its rate q̇′_j, with c_j the Coulomb level (the breakaway
level as well: no Stribeck effect) and b_j the viscous coefficient:

    f_j = −b_j q̇′_j − c_j sign(q̇′_j)   sliding,       |f_j| ≤ c_j   at rest.

The independent coordinates feel ρᵀf, so friction of passive joints counts as much as that of driven ones. At rest
the force is whatever keeps the joint at rest, as long as that is within the level; `stick_slip` tells how it is found
and why it is not smoothed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import Array
from ccpin.dynamics.reduced_model import ReducedModel, coordinates_of
from ccpin.errors import InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates, component_names
from ccpin.mechanism.mechanism import Mechanism, mechanism_of

FrictionLike = Mapping[str, tuple[float, float]] | tuple[ArrayLike, ArrayLike]


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Friction of k joints (or single components of joints), checked against a mechanism.

    Attributes:
        names: The joints, ``joint`` or ``joint:axis``.
        index: Which component of q̇′ each is, of shape (k,).
        coordinate: Which independent velocity each is, −1 for the dependent ones, of shape (k,).
        coulomb: Coulomb and breakaway level c, N m (or N), of shape (k,).
        viscous: Viscous coefficient b, N m s/rad (or N s/m), of shape (k,).
    """

    names: tuple[str, ...]
    index: NDArray[np.intp]
    coordinate: NDArray[np.intp]
    coulomb: Array
    viscous: Array


def joint_friction(
    mechanism: Mechanism | ReducedModel, friction: FrictionLike | JointFriction | None = None
) -> JointFriction:
    """Check friction against a mechanism.

    Args:
        mechanism: What rubs: a mechanism or model.
        friction: ``{joint: (coulomb, viscous)}`` for any joints, dependent or not (a component of a joint with
            several freedoms by ``joint:axis``); or a pair of arrays (coulomb, viscous), numbers or of shape (n,), for
            the independent joints in their order; default the Coulomb levels that the mechanism's joints state. Viscous
            friction comes on top of the joints' dampers, which belong to the model.

    Raises:
        InvalidInputError: An unknown joint, a level that is negative or not finite, a wrong shape.
    """
    if isinstance(friction, JointFriction):
        return friction
    whole = mechanism_of(mechanism)
    if friction is None:
        entries = stated_friction(whole)
    else:
        entries = dict(friction) if isinstance(friction, Mapping) else _of_independent(whole, friction)
    known = component_names(whole.tree)
    for name in entries:
        if name not in known:
            raise InvalidInputError(f"friction: '{name}' is not one of the joints {', '.join(known)}")
    levels = np.array([_levels(name, pair) for name, pair in entries.items()]).reshape(-1, 2)
    index = np.array([known.index(name) for name in entries], dtype=np.intp)
    found = JointFriction(tuple(entries), index, index, levels[:, 0].copy(), levels[:, 1].copy())
    return moved_friction(found, coordinates_of(mechanism))


def moved_friction(friction: JointFriction, coordinates: IndependentCoordinates) -> JointFriction:
    """The same friction, with the places of its joints among other independent coordinates, also of another tree."""
    known = component_names(coordinates.tree)
    index = np.array([known.index(name) for name in friction.names], dtype=np.intp)
    owner = np.full(coordinates.tree.model.nv, -1, dtype=np.intp)
    for part in coordinates.parts:
        if part.component is None:
            owner[part.v_free] = np.arange(part.v.start, part.v.stop)
    return replace(friction, index=index, coordinate=owner[index])


def stated_friction(mechanism: Mechanism) -> dict[str, tuple[float, float]]:
    """The Coulomb levels that a mechanism's joints state, as `joint_friction` takes them."""
    joints = mechanism.joints
    return {name: (level, 0.0) for name, level in zip(joints.names, joints.friction.tolist(), strict=True) if level}


def _of_independent(mechanism: Mechanism, pair: tuple[ArrayLike, ArrayLike]) -> dict[str, tuple[float, float]]:
    names = mechanism.independent
    if not isinstance(pair, tuple) or len(pair) != 2:
        raise InvalidInputError("friction must be {joint: (coulomb, viscous)} or a pair of arrays (coulomb, viscous)")
    columns = []
    for word, values in zip(("coulomb", "viscous"), pair, strict=True):
        array = np.asarray(values, dtype=np.float64)
        if array.shape not in ((), (len(names),)):
            raise InvalidInputError(
                f"friction: {word} has shape {array.shape}; it must be a number or ({len(names)},), one for each of "
                f"{', '.join(names)}"
            )
        columns.append(np.broadcast_to(array, (len(names),)).tolist())
    return dict(zip(names, zip(*columns, strict=True), strict=True))


def _levels(name: str, pair: tuple[float, float]) -> Array:
    try:
        levels = np.asarray(pair, dtype=np.float64)
    except (TypeError, ValueError):
        levels = np.empty(0)
    if levels.shape != (2,) or not np.isfinite(levels).all() or levels.min() < 0:
        raise InvalidInputError(
            f"friction of '{name}' is {pair!r}; it must be (coulomb, viscous), two finite numbers of at least zero"
        )
    return levels
