"""What each closure kind asks for: the one definition of φ's rows, as data.

Every row of a closure is a sum of weighted scalar products,

    φ_i = Σ w (x·y),        x, y: a vector fixed in frame A, B or C, or the gap p_B − p_A,

A and B being the closure's two frames and C the body of their nearest common ancestor, so that a row depends on the
loop's own joints only. With e a unit vector of C, a of A and b of B the forms in use are

- point:      −e·(p_B − p_A),
- direction:  Σ w (a·b),
- offset:     a·(p_B − p_A),
- distance:   (|p_B − p_A|² − L²) / 2L, the constant L² being the product of a vector of C with itself.

A row may be evaluated in any algebra that has such vectors and their products: numbers, derivatives
(`ccpin.kinematics.constraints`), joint-space bounds, polynomials and tapes. Direction rows vanish at isolated wrong
orientations too (an axis turned end for end); `alignment` tells them apart.

A new closure kind is one entry of `CLOSURE_KINDS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from ccpin.arrays import Array
from ccpin.description.model import LoopClosure, rotation_to

PARALLEL = 1e-9  # sine of the angle below which two unit vectors are parallel
X, Y, Z = np.eye(3)

V = TypeVar("V")
S = TypeVar("S")
Frame = Literal["A", "B", "C"]


class Fixed(NamedTuple):
    """A vector that is constant in one of a closure's frames."""

    frame: Frame
    local: Array


class Gap(NamedTuple):
    """The vector p_B − p_A from the origin of frame A to that of frame B."""


Vector = Fixed | Gap
GAP = Gap()


class Product(NamedTuple):
    """weight · (left · right)."""

    weight: float
    left: Vector
    right: Vector


Row = tuple[Product, ...]


class LoopRows(NamedTuple):
    """The rows of one closure.

    Attributes:
        rows: Each a sum of products.
        alignment: Pairs (a in A, b in B) whose product must be positive when closed the right way round.
    """

    rows: tuple[Row, ...]
    alignment: tuple[tuple[Array, Array], ...] = ()

    @property
    def direction_rows(self) -> tuple[bool, ...]:
        """For each row whether it says how the ends are turned and nothing else."""
        return tuple(all(GAP not in (left, right) for _, left, right in row) for row in self.rows)

    def evaluate(
        self, vector: Callable[[Vector], V], dot: Callable[[V, V], S], combine: Callable[[Iterable[tuple[float, S]]], S]
    ) -> list[S]:
        """The rows in some algebra: `vector` gives a vector's value, `dot` x·y, `combine` Σ w s over pairs (w, s)."""
        return [combine((w, dot(vector(left), vector(right))) for w, left, right in row) for row in self.rows]


class PlaneNormal(NamedTuple):
    """The unit normal of a planar loop's plane in frames A, B and C (``None``: the loop is spatial)."""

    A: Array | None = None
    B: Array | None = None
    C: Array | None = None


def _same_point(normal: PlaneNormal) -> tuple[Row, ...]:
    """p_A = p_B: −e·gap for three axes e of C, the last along the normal."""
    return tuple((Product(-1.0, Fixed("C", e), GAP),) for e in plane_axes(normal.C))


def _perpendicular(a: Array, b: Array) -> Row:
    return (Product(1.0, Fixed("A", a), Fixed("B", b)),)


def _same_axis(normal: PlaneNormal) -> tuple[Row, ...]:
    """z_A ⟂ x_B and z_A ⟂ y_B."""
    x, y, z = _about_z(normal.B).T
    return _perpendicular(z, x), _perpendicular(z, y)


def _same_rotation(basis: Array) -> tuple[Row, ...]:
    """The skew part of R_Aᵀ R_B: ½ (e_i^A · e_k^B − e_k^A · e_i^B), the rotation vector to third order."""
    x, y, z = basis.T
    return tuple(
        (Product(-0.5, Fixed("A", e), Fixed("B", f)), Product(0.5, Fixed("A", f), Fixed("B", e)))
        for e, f in ((y, z), (z, x), (x, y))
    )


def _no_offset(axes: Iterable[Array]) -> tuple[Row, ...]:
    return tuple((Product(1.0, Fixed("A", a), GAP),) for a in axes)


def _about_z(hint: Array | None) -> Array:
    """A basis (columns x, y, z) with the given z kept and y along the hint's part perpendicular to it."""
    if hint is None or np.linalg.norm(np.cross(hint, Z)) < PARALLEL:
        return np.eye(3)
    y = hint - (hint @ Z) * Z
    y = y / np.linalg.norm(y)
    return np.column_stack([np.cross(y, Z), y, Z])


def plane_axes(normal: Array | None) -> Array:
    """Three unit vectors, the last the normal, the coordinate axes where they span the plane (rows)."""
    if normal is None:
        return np.eye(3)
    main = int(np.argmax(np.abs(normal)))
    axis = np.eye(3)[0 if main else 1]
    first = axis - (axis @ normal) * normal
    first = first / np.linalg.norm(first)
    second = np.cross(normal, first) * (1.0 if main in (0, 2) else -1.0) * np.sign(normal[main])
    return np.vstack([first, second, normal])


def _across_z(normal: PlaneNormal) -> tuple[Row, ...]:
    """No offset along the x and y axes of A."""
    return _no_offset(_about_z(normal.A).T[:2])


def _distance(closure: LoopClosure, normal: PlaneNormal) -> LoopRows:
    assert closure.length is not None  # checked with the description
    rod, scale = Fixed("C", closure.length * X), 0.5 / closure.length
    return LoopRows(((Product(scale, GAP, GAP), Product(-scale, rod, rod)),))


_XYZ = ((X, X), (Y, Y), (Z, Z))
CLOSURE_KINDS: dict[str, Callable[[LoopClosure, PlaneNormal], LoopRows]] = {
    "spherical": lambda _, n: LoopRows(_same_point(n)),
    "revolute": lambda _, n: LoopRows(_same_point(n) + _same_axis(n), ((Z, Z),)),
    "fixed": lambda _, n: LoopRows(_same_point(n) + _same_rotation(rotation_to(Z if n.A is None else n.A)), _XYZ),
    "prismatic": lambda _, n: LoopRows(_same_rotation(_about_z(n.A)) + _across_z(n), _XYZ),
    "cylindrical": lambda _, n: LoopRows(_same_axis(n) + _across_z(n), ((Z, Z),)),
    "universal": lambda _, n: LoopRows((*_same_point(n), _perpendicular(X, Y))),
    "planar": lambda _, n: LoopRows(_same_axis(n) + _no_offset([Z]), ((Z, Z),)),
    "perpendicular": lambda _, __: LoopRows((_perpendicular(X, Y),)),
    "in_plane": lambda _, __: LoopRows(_no_offset([X])),
    "distance": _distance,
}


def rows_of(closure: LoopClosure, normal: PlaneNormal) -> LoopRows:
    """The rows of a closure, without those that planar motion keeps constant.

    In a planar loop all bodies move parallel to the plane, so a vector along its normal keeps its product with any
    vector of the loop; a row of such products only is constant. The kinds build their rows so that these stand alone.
    """
    built = CLOSURE_KINDS[closure.kind](closure, normal)
    rows = (row for row in built.rows if not all(_along(p.left, normal) or _along(p.right, normal) for p in row))
    return built._replace(rows=tuple(rows))


def _along(vector: Vector, normal: PlaneNormal) -> bool:
    if isinstance(vector, Gap):
        return False
    axis: Array | None = getattr(normal, vector.frame)
    return axis is not None and float(np.linalg.norm(np.cross(vector.local, axis))) < PARALLEL
