"""Joint friction, dry (Coulomb's, with breakaway and Stribeck's effect) and viscous: which joints rub, and how hard.

The force on joint j of the free system is set-valued in its rate q̇′_j, with c_j the Coulomb level, s_j ≥ c_j the
breakaway level, v_j the Stribeck speed and b_j the viscous coefficient:

    f_j = −b_j q̇′_j − [c_j + (s_j − c_j) exp(−(q̇′_j/v_j)²)] sign(q̇′_j)   sliding,       |f_j| ≤ s_j   at rest

(R. Stribeck, Die wesentlichen Eigenschaften der Gleit- und Rollenlager, 1902; B. Armstrong-Hélouvry, P. Dupont and
C. Canudas de Wit, A survey of models, analysis tools and compensation methods for the control of machines with
friction, Automatica 30, 1994). That is dry friction of the level s_j alone, and a smooth force beside it,

    f_j = −b_j q̇′_j − s_j Sign(q̇′_j) + h_j(q̇′_j),    h_j(r) = (s_j − c_j)(1 − exp(−(r/v_j)²)) sign r,

whose slope, √(2/e)(s_j − c_j)/v_j = 0.86 (s_j − c_j)/v_j at most, is a damper's of the wrong sign: the right-hand side
is monotone but for a Lipschitz function, so that from a state there is one motion forward, as without h; and h is zero
at rest, so that who rests and who starts is decided as without it. The power is −(b_j |q̇′_j| + [c_j + …])|q̇′_j| ≤ 0.
Where that slope is large against the mass, a motion is unstable at that rate, and steps are as short as it asks.

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

FrictionLike = Mapping[str, tuple[float, ...]] | tuple[ArrayLike, ...]
_WORDS = ("coulomb", "viscous", "breakaway", "Stribeck speed")


@dataclass(frozen=True, eq=False)
class JointFriction:
    """Friction of k joints (or single components of joints), checked against a mechanism.

    Attributes:
        names: The joints, ``joint`` or ``joint:axis``.
        index: Which component of q̇′ each is, of shape (k,).
        coordinate: Which independent velocity each is, −1 for the dependent ones, of shape (k,).
        coulomb: Coulomb level c, N m (or N), of shape (k,).
        viscous: Viscous coefficient b, N m s/rad (or N s/m), of shape (k,).
        breakaway: Breakaway level s, N m (or N), of shape (k,): c where there is no Stribeck effect.
        stribeck_speed: v_s, rad/s (or m/s), of shape (k,): 1 where there is none.
    """

    names: tuple[str, ...]
    index: NDArray[np.intp]
    coordinate: NDArray[np.intp]
    coulomb: Array
    viscous: Array
    breakaway: Array
    stribeck_speed: Array

    def level(self, rates: Array) -> Array:
        """c + (s − c) exp(−(q̇′/v_s)²) of each joint that slides at these rates, of shape (k,)."""
        fall = np.exp(-((rates / self.stribeck_speed) ** 2))
        return np.asarray(self.coulomb + (self.breakaway - self.coulomb) * fall)


def joint_friction(
    mechanism: Mechanism | ReducedModel, friction: FrictionLike | JointFriction | None = None
) -> JointFriction:
    """Check friction against a mechanism.

    Args:
        mechanism: What rubs: a mechanism or model.
        friction: ``{joint: (coulomb, viscous)}`` or ``{joint: (coulomb, viscous, breakaway, stribeck_speed)}`` for any
            joints, dependent or not (a component of a joint with several freedoms by ``joint:axis``); or two or four
            arrays in the same order, numbers or of shape (n,), for the independent joints in their order; default the
            dry friction that the mechanism's joints state. Viscous friction comes on top of the joints' dampers, which
            belong to the model.

    Raises:
        InvalidInputError: An unknown joint, a level that is negative or not finite, a breakaway level below Coulomb's,
            a Stribeck speed that is not positive, a wrong shape.
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
    levels = np.array([_levels(name, stated) for name, stated in entries.items()]).reshape(-1, 4)
    index = np.array([known.index(name) for name in entries], dtype=np.intp)
    found = JointFriction(tuple(entries), index, index, *levels.T.copy())
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


def stated_friction(mechanism: Mechanism) -> dict[str, tuple[float, ...]]:
    """The dry friction that a mechanism's joints state, as `joint_friction` takes it."""
    joints = mechanism.joints
    columns = (each.tolist() for each in (joints.friction, joints.breakaway, joints.stribeck_speed))
    stated = zip(joints.names, *columns, strict=True)
    return {name: (c, 0.0, s, speed) if s > c else (c, 0.0) for name, c, s, speed in stated if s}


def _of_independent(mechanism: Mechanism, given: tuple[ArrayLike, ...]) -> dict[str, tuple[float, ...]]:
    names = mechanism.independent
    if not isinstance(given, tuple) or len(given) not in (2, 4):
        raise InvalidInputError(
            "friction must be {joint: (coulomb, viscous)} or a pair of arrays (coulomb, viscous), which breakaway and "
            "Stribeck speed may follow"
        )
    columns = []
    for word, values in zip(_WORDS, given, strict=False):
        array = np.asarray(values, dtype=np.float64)
        if array.shape not in ((), (len(names),)):
            raise InvalidInputError(
                f"friction: {word} has shape {array.shape}; it must be a number or ({len(names)},), one for each of "
                f"{', '.join(names)}"
            )
        columns.append(np.broadcast_to(array, (len(names),)).tolist())
    return dict(zip(names, zip(*columns, strict=True), strict=True))


def _levels(name: str, stated: tuple[float, ...]) -> Array:
    """(c, b, s, v_s) of one joint."""
    try:
        levels = np.asarray(stated, dtype=np.float64)
    except (TypeError, ValueError):
        levels = np.empty(0)
    if levels.shape not in ((2,), (4,)) or not np.isfinite(levels).all() or levels.min() < 0:
        raise InvalidInputError(
            f"friction of '{name}' is {stated!r}; it must be (coulomb, viscous), two finite numbers of at least zero, "
            "or four: (coulomb, viscous, breakaway, stribeck_speed)"
        )
    if len(levels) == 2:
        return np.array([*levels, levels[0], 1.0])
    if levels[2] < levels[0] or not levels[3]:
        raise InvalidInputError(
            f"friction of '{name}' is {stated!r}; breakaway must not be below coulomb, and the Stribeck speed positive"
        )
    return levels
