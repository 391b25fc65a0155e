"""Boxes of constants that an adaptive law looks for, and whether bodies can have all that is in them.

A body's pseudo-inertia P(π) = [[½ tr(I) 1 − I, h], [hᵀ, m]] is linear in its ten numbers, and the positive definite
matrices are convex: where P ≻ 0 at all corners of a box it is so in all of it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, Indices, frozen, least_eigenvalue, positive, records, vector
from ccpin.dynamics.changed_constants import bodies
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.errors import InvalidInputError

_AT_LEAST_ZERO = ("armature", "damping", "stiffness")


class ConstantBox(NamedTuple):
    """Constants that are looked for, between bounds.

    Attributes:
        names: Of the constants, k of them. places: where they stand among all.
        lower, upper: The bounds, of shape (k,).
    """

    names: tuple[str, ...]
    places: Indices
    lower: Array
    upper: Array


def constant_box(
    stated: DynamicParameters, adapted: Sequence[str], bounds: float | tuple[ArrayLike, ArrayLike]
) -> ConstantBox:
    """A box of constants, each of whose points bodies can have.

    Args:
        stated: All constants, as the model states them.
        adapted: Names of constants, or of kinds of them (``inertia``: the ten of a body).
        bounds: Lower and upper ones, of shape (k,) each; or a share of what is stated, of those that are not 0.

    Raises:
        InvalidInputError: There is no such constant, it is dry friction, bounds are no such numbers, a body cannot have
            a corner of the box (it is named), or a damper, armature or stiffness may be negative.
    """
    places = _places(stated, records([adapted] if isinstance(adapted, str) else adapted, "adapted", str))
    if isinstance(bounds, tuple | list):
        if len(bounds) != 2:
            raise InvalidInputError(f"bounds are a pair (lower, upper), not {len(bounds)}")
        low, high = (vector(bound, "bounds", len(places)) for bound in bounds)
    else:
        share = positive(bounds, "bounds", "a share of what is stated, or a pair (lower, upper)")
        places = places[stated.values[places] != 0.0]
        values = stated.values[places]
        low, high = values - share * np.abs(values), values + share * np.abs(values)
    names = tuple(stated.names[place] for place in places)
    if not names:
        raise InvalidInputError("nothing to adapt: all these constants are stated as 0; give bounds=(lower, upper)")
    for name, below, above in zip(names, low.tolist(), high.tolist(), strict=True):
        if not below < above:
            raise InvalidInputError(f"bounds of {name}: {below:g} is not less than {above:g}")
        if name.partition(":")[0] in _AT_LEAST_ZERO and below < 0.0:
            raise InvalidInputError(f"bounds of {name}: {below:g} is negative")
    box = ConstantBox(names, places, frozen(low), frozen(high))
    _require_bodies(stated, box)
    return box


def pseudo_inertia(values: Array) -> Array:
    """P of a body's ten numbers, of shape (4, 4)."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = values.tolist()
    half = 0.5 * (xx + yy + zz)
    return np.array([[half - xx, -xy, -xz, hx], [-xy, half - yy, -yz, hy], [-xz, -yz, half - zz, hz], [hx, hy, hz, m]])


def _places(stated: DynamicParameters, adapted: tuple[str, ...]) -> Indices:
    known, found = {name: place for place, name in enumerate(stated.names)}, list[int]()
    for name in adapted:
        if ":" in name and name not in known:
            raise InvalidInputError(f"there is no constant '{name}'; `model.parameters.names` are {', '.join(known)}")
        found += [known[name]] if name in known else stated.of(name).tolist()
    if any(stated.kinds[place] == "friction" for place in found):
        raise InvalidInputError("dry friction is neither adapted nor compensated: sign(q̇′) is not known at rest")
    if len(set(found)) != len(found):
        raise InvalidInputError(f"adapted names a constant twice: {', '.join(adapted)}")
    return np.array(sorted(found), dtype=np.intp)


def _require_bodies(stated: DynamicParameters, box: ConstantBox) -> None:
    """No corner of a body's constants is one that no body has."""
    for body in bodies(stated):
        inside = np.flatnonzero((box.places >= body.start) & (box.places < body.stop))
        if not inside.size:
            continue
        values = np.array(stated.values[body])
        for corner in itertools.product((False, True), repeat=len(inside)):
            values[box.places[inside] - body.start] = np.where(corner, box.upper[inside], box.lower[inside])
            if not _positive(pseudo_inertia(values)):
                name = stated.names[body.start].partition(":")[2]
                at = ", ".join(
                    f"{box.names[k].partition(':')[0]} = {values[box.places[k] - body.start]:.6g}" for k in inside
                )
                raise InvalidInputError(
                    f"no body can have the constants of '{name}' at a corner of the bounds, {at}: its pseudo-inertia "
                    "is not positive definite; narrow the bounds, or adapt fewer of its constants"
                )


def _positive(P: Array) -> bool:
    """Whether a pseudo-inertia is positive definite, in units in which its diagonal is 1."""
    size = np.diag(P)
    return bool((size > 0.0).all()) and least_eigenvalue(P / np.sqrt(np.outer(size, size))) > 0.0
