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

from ccpin.arrays import Array, frozen, least_eigenvalue, positive, records, vector
from ccpin.dynamics.changed_constants import AT_LEAST_ZERO, bodies
from ccpin.dynamics.parameters import DynamicParameters
from ccpin.errors import InvalidInputError


class ConstantBox(NamedTuple):
    """Constants θ that are looked for, between bounds: π = known + B θ.

    Attributes:
        names: Of the constants, k of them. units: of each.
        basis: B, of shape (p, k): 1 at a constant of `model.parameters`, the ten numbers stated of a body's factor.
        stated: What the model states of θ, of shape (k,).
        lower, upper: The bounds, alike.
        known: What is not looked for, as stated, 0 for dry friction, of shape (p,).
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    basis: Array
    stated: Array
    lower: Array
    upper: Array
    known: Array


def constant_box(
    parameters: DynamicParameters, adapted: Sequence[str], bounds: float | tuple[ArrayLike, ArrayLike]
) -> ConstantBox:
    """A box of constants, each of whose points bodies can have.

    Args:
        parameters: All constants, as the model states them.
        adapted: Names of constants, of kinds of them, or ``body:LINK`` (``body``: of all), a factor of all ten.
        bounds: Lower and upper ones, of shape (k,) each; or a share of what is stated, of those that are not 0.

    Raises:
        InvalidInputError: There is no such constant, it is dry friction, or one of a body with a factor, bounds are no
            such numbers, a body cannot have a corner of the box, or a damper, armature or stiffness may be negative.
    """
    found = _named(parameters, records([adapted] if isinstance(adapted, str) else adapted, "adapted", str))
    names, basis = tuple(found), np.array(list(found.values())).reshape(len(found), len(parameters)).T
    single = np.array([not name.startswith("body:") for name in names], dtype=np.bool_)
    stated = np.where(single, parameters.values @ basis, 1.0)
    if isinstance(bounds, tuple | list):
        if len(bounds) != 2:
            raise InvalidInputError(f"bounds are a pair (lower, upper), not {len(bounds)}")
        lower, upper = (vector(bound, "bounds", len(names)) for bound in bounds)
    else:
        share = positive(bounds, "bounds", "a share of what is stated, or a pair (lower, upper)") * np.abs(stated)
        names = tuple(name for name, wide in zip(names, share, strict=True) if wide)
        basis, single, stated, share = (
            basis[:, share > 0.0],
            single[share > 0.0],
            stated[share > 0.0],
            share[share > 0.0],
        )
        lower, upper = stated - share, stated + share
    if not names:
        raise InvalidInputError("nothing to adapt: none named, or all are stated as 0; give bounds=(lower, upper)")
    if ((basis != 0.0).sum(axis=1) > 1).any():
        raise InvalidInputError(f"adapted: {', '.join(names)} has a body's factor and single ones of its constants")
    for name, below, above in zip(names, lower.tolist(), upper.tolist(), strict=True):
        if not below < above:
            raise InvalidInputError(f"bounds of {name}: {below:g} is not less than {above:g}")
        if name.partition(":")[0] in AT_LEAST_ZERO and below < 0.0:
            raise InvalidInputError(f"bounds of {name}: {below:g} is negative")
    known = np.where((basis != 0.0).any(axis=1), 0.0, parameters.values)
    known[parameters.of("friction", "stribeck")] = 0.0
    units = tuple(
        parameters.units[int(row.argmax())] if alone else "1" for row, alone in zip(basis.T, single, strict=True)
    )
    box = ConstantBox(names, units, *map(frozen, (basis, stated, lower, upper, known)))
    _require_bodies(parameters, box)
    return box


def pseudo_inertia(values: Array) -> Array:
    """P of a body's ten numbers, of shape (4, 4)."""
    m, hx, hy, hz, xx, xy, yy, xz, yz, zz = values.tolist()
    half = 0.5 * (xx + yy + zz)
    return np.array([[half - xx, -xy, -xz, hx], [-xy, half - yy, -yz, hy], [-xz, -yz, half - zz, hz], [hx, hy, hz, m]])


def _named(parameters: DynamicParameters, adapted: tuple[str, ...]) -> dict[str, Array]:
    """The columns of B by their names, in the order of all constants, factors of bodies first."""
    units, count = np.eye(len(parameters)), len(parameters)
    factors = {
        f"body:{parameters.names[body.start].partition(':')[2]}": np.where(
            np.isin(np.arange(count), range(body.start, body.stop)), parameters.values, 0.0
        )
        for body in bodies(parameters)
        if parameters.values[body.start] > 0.0
    }
    known, wanted = factors | dict(zip(parameters.names, units, strict=True)), list[str]()
    for name in adapted:
        if ":" in name and name not in known:
            raise InvalidInputError(f"there is no constant '{name}'; there are {', '.join(known)}")
        several = (
            factors if name == "body" else [] if name in known else [parameters.names[k] for k in parameters.of(name)]
        )
        wanted += [name] if name in known else several
    if any(name.partition(":")[0] in ("friction", "stribeck") for name in wanted):
        raise InvalidInputError("dry friction is neither adapted nor compensated: sign(q̇′) is not known at rest")
    if len(set(wanted)) != len(wanted):
        raise InvalidInputError(f"adapted names a constant twice: {', '.join(adapted)}")
    return {name: column for name, column in known.items() if name in wanted}


def _require_bodies(parameters: DynamicParameters, box: ConstantBox) -> None:
    """No corner of a body's constants is one that no body has."""
    for body in bodies(parameters):
        inside = np.flatnonzero((box.basis[body] != 0.0).any(axis=0))
        for corner in itertools.product((False, True), repeat=len(inside)) if inside.size else ():
            theta = np.where(corner, box.upper[inside], box.lower[inside])
            if not _positive(pseudo_inertia(box.known[body] + box.basis[body][:, inside] @ theta)):
                name = parameters.names[body.start].partition(":")[2]
                at = ", ".join(f"{box.names[k]} = {value:.6g}" for k, value in zip(inside, theta, strict=True))
                remedy = f"narrow the bounds, or adapt its factor, body:{name}"
                if box.names[inside[0]].startswith("body:"):
                    remedy = "a factor must be above 0"
                if not _positive(pseudo_inertia(parameters.values[body])):
                    remedy = "neither is what the model states of it: give the link an inertia that a body can have"
                raise InvalidInputError(
                    f"no body can have the constants of '{name}' at a corner of the bounds, {at}: its pseudo-inertia "
                    f"is not positive definite; {remedy}"
                )


def _positive(P: Array) -> bool:
    """Whether a pseudo-inertia is positive definite, in units in which its diagonal is 1."""
    size = np.diag(P)
    return bool((size > 0.0).all()) and least_eigenvalue(P / np.sqrt(np.outer(size, size))) > 0.0
