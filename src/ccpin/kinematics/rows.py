"""Each closure kind as constraint rows, each row with its exact derivative, on the manifold and off it.

Four forms of row suffice (p, d: points; a, b: unit directions, A-side fixed in body A, B-side in body B; all
measured from the loop's nearest common ancestor body C, so that a row depends on the loop's own joints only):

- point:      E (p_A − p_B), E constant in C,              rate  E (v_A − v_B)
- direction:  Σ w (a·b),                                    rate  Σ w (a × b)·(ω_A − ω_B)
- offset:     a·(p_B − p_A),                                rate  a·(v_B − v_A) + (a × (p_B − p_A))·ω_A
- distance:   (|p_B − p_A|² − L²) / 2L,                     rate  (p_B − p_A)·(v_B − v_A) / L

All are polynomial in points and directions. Direction rows vanish at isolated wrong orientations too (an axis
turned end for end); `aligned` tells them apart.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import ClosureKind, LoopClosure, rotation_to

X, Y, Z = np.eye(3)
PARALLEL = 1e-9


class DirectionRow(NamedTuple):
    """Σ weight (a·b) over (weight, a in frame A, b in frame B)."""

    products: tuple[tuple[float, Array, Array], ...]


class KindRows(NamedTuple):
    """The rows of one closure, in the closure's own frames A and B.

    Attributes:
        point: Whether p_A = p_B is asked for.
        directions: Direction rows.
        offsets: Directions a in frame A of offset rows.
        distance: The length L of a distance row, or ``None``.
        alignment: Pairs (a, b) whose product must be positive when closed the right way round.
    """

    point: bool = False
    directions: tuple[DirectionRow, ...] = ()
    offsets: tuple[Array, ...] = ()
    distance: float | None = None
    alignment: tuple[tuple[Array, Array], ...] = ()


def _perpendicular(a: Array, b: Array) -> DirectionRow:
    return DirectionRow(((1.0, a, b),))


def _same_axis(basis: Array) -> tuple[DirectionRow, ...]:
    """z_A ⟂ x_B and z_A ⟂ y_B."""
    x, y, z = basis.T
    return _perpendicular(z, x), _perpendicular(z, y)


def _same_rotation(basis: Array) -> tuple[DirectionRow, ...]:
    """The skew part of R_Aᵀ R_B: ½ (e_i^A · e_k^B − e_k^A · e_i^B), the rotation vector to third order."""
    x, y, z = basis.T
    return tuple(DirectionRow(((-0.5, e, f), (0.5, f, e))) for e, f in ((y, z), (z, x), (x, y)))


def _about_z(hint: Array | None) -> Array:
    """A basis (columns x, y, z) with the given z kept and y along the hint's part perpendicular to it."""
    if hint is None or np.linalg.norm(np.cross(hint, Z)) < PARALLEL:
        return np.eye(3)
    y = hint - (hint @ Z) * Z
    y = y / np.linalg.norm(y)
    return np.column_stack([np.cross(y, Z), y, Z])


def _any_basis(hint: Array | None) -> Array:
    return np.eye(3) if hint is None else rotation_to(hint)


class PlaneNormal(NamedTuple):
    """The unit normal of a planar loop's plane in closure frames A and B (``None``: the loop is spatial)."""

    a: Array | None = None
    b: Array | None = None


def _spherical(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    return KindRows(point=True)


def _revolute(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    return KindRows(point=True, directions=_same_axis(_about_z(normal.b)), alignment=((Z, Z),))


def _fixed(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    return KindRows(point=True, directions=_same_rotation(_any_basis(normal.a)), alignment=((X, X), (Y, Y), (Z, Z)))


def _prismatic(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    basis = _about_z(normal.a)
    rotation = _same_rotation(basis)
    return KindRows(directions=rotation, offsets=tuple(basis.T[:2]), alignment=((X, X), (Y, Y), (Z, Z)))


def _cylindrical(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    return KindRows(
        directions=_same_axis(_about_z(normal.b)), offsets=tuple(_about_z(normal.a).T[:2]), alignment=((Z, Z),)
    )


def _universal(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    return KindRows(point=True, directions=(_perpendicular(X, Y),))


def _planar(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    return KindRows(directions=_same_axis(_about_z(normal.b)), offsets=(Z,), alignment=((Z, Z),))


def _distance(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    return KindRows(distance=closure.length)


KINDS: dict[ClosureKind, Callable[[LoopClosure, PlaneNormal], KindRows]] = {
    "spherical": _spherical,
    "revolute": _revolute,
    "fixed": _fixed,
    "prismatic": _prismatic,
    "cylindrical": _cylindrical,
    "universal": _universal,
    "planar": _planar,
    "distance": _distance,
}


def rows_of(closure: LoopClosure, normal: PlaneNormal) -> KindRows:
    """The rows of a closure, built so that those which a planar motion keeps constant stand alone."""
    return KINDS[closure.kind](closure, normal)
